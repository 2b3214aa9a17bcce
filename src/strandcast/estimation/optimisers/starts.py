"""Start candidates of searches."""

import numpy as np

from strandcast.estimation.descent import apart
from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit_objective import EvaluationLog
from strandcast.estimation.optimisers.optimiser import SearchProblem
from strandcast.estimation.unknowns import prior_exponents

# All chosen.
DRAWS = 192  # a third of them ignores the prior
KNOWN_DRAWS = 32  # beside the previous ensemble
POPULATION = 32


def draw_starts(problem: SearchProblem, log: EvaluationLog) -> None:
    """Evaluate strings of the prior and a Latin hypercube or, after the first fit, the previous ensemble."""
    space, model = problem.objective.space, problem.objective.model
    if problem.start.previous is not None:
        log(space.chi_of(problem.start.previous))
        log(prior_exponents(space, model, KNOWN_DRAWS, problem.rng))
        return
    draws = min(DRAWS, problem.evaluations // 12)
    log(prior_exponents(space, model, draws - draws // 3, problem.rng))
    log(latin_hypercube(draws // 3, space.dimension, problem.rng))


def spread_population(log: EvaluationLog) -> tuple[Array, Array]:
    """Return candidates (P, d), as different as possible, the best first, and their E (P,)."""
    chi, values = log.all()
    rows = apart(chi, values, POPULATION)
    others = np.argsort(values, kind="stable")
    rows = np.concatenate([rows, others[~np.isin(others, rows)]])[:POPULATION]
    return chi[rows], values[rows]


def latin_hypercube(count: int, dimension: int, rng: np.random.Generator) -> Array:
    """`count` points in the unit box, one in each of `count` slices of every dimension."""
    slices = np.array([rng.permutation(count) for _ in range(dimension)]).T
    return np.asarray((slices + rng.random((count, dimension))) / count)
