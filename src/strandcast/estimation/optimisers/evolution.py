"""Differential evolution (SciPy)."""

from typing import Any

import numpy as np
import scipy

from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit_objective import EvaluationLog

FEWEST = 5  # candidates of a generation, as SciPy asks for


def evolve(
    log: EvaluationLog, population: Array, evaluations: int, rng: np.random.Generator, patience: float = 1e-3
) -> bool:
    """Differential evolution (SciPy), best1bin with dithered scale.

    Parameters
    ----------
    log, evaluations, rng
        As for `strandcast.estimation.optimisers.paper.shrinking_search`.
    population
        (P, d) first generation, evaluated again; every generation is one batch of P.
    patience
        Ends when the standard deviation of the population's E is below this share of their mean.

    Returns
    -------
    Whether it ended this way, before the evaluations were spent.
    """
    begun, size = log.count, len(population)
    if size < FEWEST or size > evaluations:
        return False

    def value(chi: Any) -> Any:
        return log(chi.T)

    def stop_when_spent(intermediate_result: scipy.optimize.OptimizeResult) -> None:
        if log.count - begun + size > evaluations:
            raise StopIteration

    # With an infinite E, the population's standard deviation is NaN.
    with np.errstate(invalid="ignore"):
        result = scipy.optimize.differential_evolution(
            value,
            scipy.optimize.Bounds(np.zeros(population.shape[1]), np.ones(population.shape[1])),
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
