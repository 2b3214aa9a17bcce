"""The searches, by name: the paper's shrinking random search and CMA-ES.

Each takes a `Ledger`, spends its evaluations in batches, and leaves the result there.
"""

from __future__ import annotations

import warnings

import cma
import numpy as np

from strandcast.estimation.evaluation import Array
from strandcast.estimation.objective import Ledger


def paper(
    ledger: Ledger,
    chi_best: Array,
    evaluations: int,
    rng: np.random.Generator,
    *,
    trials: int = 1,
    centre: str = "running",
    chi_0: float = 1.0,
    beta: float = 0.999,
    batch: int = 16,
) -> None:
    """Shrinking random search, eq. (3): chi_m = chi_best + chi_0 / M beta^m RAND(-1, 1), clipped to [0, 1].

    Parameters
    ----------
    ledger
        Evaluates and remembers.
    chi_best
        (d,) centre: the estimate after the previous trial.
    evaluations
        Number of parameter changes m.
    rng
        Source of chance.
    trials
        M, the number of real trials so far.
    centre
        ``fixed``: chi_best stays the previous estimate, as printed. ``running``: it moves to the best found
        so far, batch by batch.
    chi_0, beta
        Not printed in the paper; beta is "slightly less than 1".
    batch
        Candidates evaluated together; with ``running``, how often the centre can move.
    """
    start = ledger.count
    best_chi, best_value = np.clip(chi_best, 0.0, 1.0), float(ledger(chi_best[None])[0])
    while (done := ledger.count - start) < evaluations:
        m = np.arange(done, min(done + batch, evaluations))
        reach = chi_0 / trials * beta ** m[:, None]
        step = reach * rng.uniform(-1.0, 1.0, (len(m), len(chi_best)))
        candidates = np.clip((best_chi if centre == "running" else chi_best) + step, 0.0, 1.0)
        values = ledger(candidates)
        k = int(np.argmin(values))
        if values[k] < best_value:
            best_chi, best_value = candidates[k], float(values[k])


def evolve(
    ledger: Ledger,
    start: Array,
    evaluations: int,
    rng: np.random.Generator,
    *,
    sigma: float = 0.25,
    population: int = 16,
) -> None:
    """CMA-ES within the box [0, 1]^d.

    Parameters
    ----------
    ledger, evaluations, rng
        As for `paper`.
    start
        (d,) first mean.
    sigma
        First standard deviation, as a share of the ranges.
    population
        Candidates per generation, evaluated together.
    """
    options = {
        "bounds": [0.0, 1.0],
        "popsize": population,
        "seed": np.nan,
        "randn": lambda *shape: rng.standard_normal(shape),
        "verbose": -9,
        "verb_log": 0,
        "tolfun": 1e-7,
        "tolx": 1e-5,
    }
    begun = ledger.count
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        strategy = cma.CMAEvolutionStrategy(np.clip(start, 0.01, 0.99), sigma, options)
        while ledger.count - begun + population <= evaluations and not strategy.stop():
            candidates = np.array(strategy.ask())
            values = ledger(candidates)
            # Invalid candidates rank last; CMA-ES uses ranks only, and wants finite numbers.
            finite = values[np.isfinite(values)]
            worst = 10.0 * (finite.max() if len(finite) else 1.0)
            strategy.tell(list(candidates), list(np.where(np.isfinite(values), values, worst)))


def latin_hypercube(count: int, dimension: int, rng: np.random.Generator) -> Array:
    """`count` points in the unit box, one in each of `count` slices of every dimension."""
    slices = np.array([rng.permutation(count) for _ in range(dimension)]).T
    return np.asarray((slices + rng.random((count, dimension))) / count)
