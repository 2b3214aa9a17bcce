"""CMA-ES within the box of the unknowns."""

import warnings

import numpy as np

from strandcast.core.cma_es import cma_es
from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit_objective import EvaluationLog
from strandcast.estimation.optimisers.optimiser import SearchProblem
from strandcast.estimation.optimisers.starts import draw_starts

# All chosen.
SIGMA = 0.25  # first standard deviation, as a share of the ranges
STALL = 60  # generations in which the best E must improve …
GAIN = 1e-4  # … by this share


def search_by_cma_es(problem: SearchProblem, log: EvaluationLog) -> bool:
    """CMA-ES from the best draw."""
    draw_starts(problem, log)
    return minimise_by_cma_es(log, log.best()[0], problem.left(log), problem.rng)


def minimise_by_cma_es(
    log: EvaluationLog,
    start: Array,
    evaluations: int,
    rng: np.random.Generator,
    population: int = 16,
) -> bool:
    """CMA-ES within the box [0, 1]^d.

    Parameters
    ----------
    log, evaluations, rng
        As for `strandcast.estimation.optimisers.paper.shrinking_search`.
    start
        (d,) first mean.
    population
        Candidates per generation, evaluated together.

    Returns
    -------
    Whether it ended before the evaluations were spent: the library stopped, or E did not improve any more.
    """
    begun = log.count
    bests: list[float] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        strategy = cma_es(np.clip(start, 0.01, 0.99), SIGMA, population, rng, tolfun=0.0)
        while log.count - begun + population <= evaluations:
            candidates = np.array(strategy.ask())
            strategy.tell(list(candidates), list(_ranked(candidates, log(candidates))))
            bests.append(log.best()[1])
            stalled = len(bests) > STALL and bests[-STALL] - bests[-1] <= GAIN * bests[-1]
            if stalled or strategy.stop():
                return True
    return False


def _ranked(candidates: Array, values: Array) -> Array:
    """Finite numbers in the order of E, for CMA-ES; clipped candidates cost more, invalid ones most."""
    outside = ((candidates - np.clip(candidates, 0.0, 1.0)) ** 2).sum(axis=1)
    finite = values[np.isfinite(values)]
    worst = 10.0 * (finite.max() if len(finite) else 1.0)
    return np.asarray(np.where(np.isfinite(values), values * (1.0 + outside), worst))
