"""The searches: the paper's shrinking random search, differential evolution and CMA-ES.

(Levenberg-Marquardt is in `refine`.) Each takes a `Ledger`, spends its evaluations in batches, and leaves the
result there.
"""

from __future__ import annotations

import warnings
from typing import Any

import cma
import numpy as np
from scipy.optimize import Bounds, OptimizeResult, differential_evolution

from strandcast.estimation.evaluation import Array
from strandcast.estimation.objective import Ledger

STALL = 60  # generations of CMA-ES without a gain


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


def evolution(
    ledger: Ledger, population: Array, evaluations: int, rng: np.random.Generator, *, patience: float = 1e-3
) -> bool:
    """Differential evolution (SciPy), best1bin with dithered scale.

    Parameters
    ----------
    ledger, evaluations, rng
        As for `paper`.
    population
        (P, d) first generation, evaluated again; every generation is one batch of P.
    patience
        Ends when the population's E spread by less than this share of their mean.

    Returns
    -------
    Whether it ended so, not for want of evaluations.
    """
    begun, size = ledger.count, len(population)

    def value(chi: Any) -> Any:
        return ledger(chi.T)

    def stop_when_spent(intermediate_result: OptimizeResult) -> None:
        if ledger.count - begun + size > evaluations:
            raise StopIteration

    # An infinite E is worse than any other, and the spread of the population is then no number.
    with np.errstate(invalid="ignore"):
        result = differential_evolution(
            value,
            Bounds(np.zeros(population.shape[1]), np.ones(population.shape[1])),
            maxiter=evaluations // size,
            tol=patience,
            init=population,
            callback=stop_when_spent,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=rng,
        )
    return bool(result.success)


def evolve(
    ledger: Ledger,
    start: Array,
    evaluations: int,
    rng: np.random.Generator,
    *,
    sigma: float = 0.25,
    population: int = 16,
    patience: float = 1e-4,
) -> bool:
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
    patience
        Ends when the best E gained less than this share in the last generations.

    Returns
    -------
    Whether it ended so, not for want of evaluations.
    """
    options = {
        "popsize": population,
        "seed": np.nan,
        "randn": lambda *shape: rng.standard_normal(shape),
        "verbose": -9,
        "verb_log": 0,
        "tolfun": 0.0,
        "tolx": 1e-5,
    }
    begun = ledger.count
    bests: list[float] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        strategy = cma.CMAEvolutionStrategy(np.clip(start, 0.01, 0.99), sigma, options)
        while ledger.count - begun + population <= evaluations:
            candidates = np.array(strategy.ask())
            strategy.tell(list(candidates), list(_ranked(candidates, ledger(candidates))))
            bests.append(ledger.best()[1])
            stalled = len(bests) > STALL and bests[-STALL] - bests[-1] <= patience * bests[-1]
            if stalled or strategy.stop():
                return True
    return False


def _ranked(candidates: Array, values: Array) -> Array:
    """Finite numbers in the order of E, for CMA-ES; what had to be clipped costs more, invalid ones most."""
    outside = ((candidates - np.clip(candidates, 0.0, 1.0)) ** 2).sum(axis=1)
    finite = values[np.isfinite(values)]
    worst = 10.0 * (finite.max() if len(finite) else 1.0)
    return np.asarray(np.where(np.isfinite(values), values * (1.0 + outside), worst))


def latin_hypercube(count: int, dimension: int, rng: np.random.Generator) -> Array:
    """`count` points in the unit box, one in each of `count` slices of every dimension."""
    slices = np.array([rng.permutation(count) for _ in range(dimension)]).T
    return np.asarray((slices + rng.random((count, dimension))) / count)
