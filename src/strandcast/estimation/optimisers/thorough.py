"""Independent searches, each by descents on growing parts of the throw; then evolution of their ends."""

from dataclasses import replace
from functools import partial

import numpy as np

from strandcast.estimation.descent import (
    DERIVATIVE_FRAMES,
    GaussNewtonModel,
    apart,
    descend,
    descent_batch,
)
from strandcast.estimation.evaluation import Array, lengths
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.optimisers.evolution import evolve
from strandcast.estimation.optimisers.optimiser import SearchProblem
from strandcast.estimation.optimisers.starts import draw_starts

# All chosen; 16 starts and these parts of the used frames found more of the true strings than fewer did, at
# the same number of simulations.
RESTARTS, LEAST_EVALUATIONS = 8, 5000  # a smaller budget buys fewer restarts
STARTS = 16
PARTS = (0.25, 0.35, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
ROUNDS, POLISH_ROUNDS = 6, 20
ENDS = 4
EVOLUTION_SHARE, POLISH_SHARE = 0.4, 0.15  # of a restart's evaluations
SQUARES_BELOW_M = 0.1  # far distances would stop a descent early: E is as steep near a string as far from it


def _squared_distances(objective: FitObjective, chi: Array) -> Array:
    """Return a cost like E of candidates (B, d), with the squares of distances up to `SQUARES_BELOW_M`."""
    difference, weight = objective.residuals(chi)
    distance = lengths(difference)
    near = 0.5 * distance**2 / SQUARES_BELOW_M
    cost = np.where(distance < SQUARES_BELOW_M, near, distance - 0.5 * SQUARES_BELOW_M) @ weight
    cost = cost + objective.space.penalty(chi)
    return np.where(np.isfinite(cost), cost, np.inf)


def search_thoroughly(problem: SearchProblem, log: EvaluationLog) -> bool:
    """Search several times, each time from other draws; then evolve and polish the ends of all searches.

    E has many local minima, the more the longer the throw: a string that explains its first quarter is found
    easily and leads to one that explains more of it.
    """
    restarts = min(max(problem.evaluations // LEAST_EVALUATIONS, 1), RESTARTS)
    share = problem.evaluations // (restarts + 1)
    found = []
    for number in range(restarts):
        # The first restart goes on from the previous estimate, the others owe it nothing.
        start = problem.start if number == 0 else replace(problem.start, previous=None)
        begun = len(log.chi)
        _search_once(replace(problem, start=start, evaluations=share), log)
        chi, values = _best_apart(log, begun, ENDS)
        found.append(chi)
        log.ends.append(float(values.min(initial=np.inf)))
    population = np.vstack(found)
    evolve(log, population, problem.left(log) - int(POLISH_SHARE * share), problem.rng)
    return _polish(problem, log, 0, problem.left(log))


def _search_once(problem: SearchProblem, log: EvaluationLog) -> None:
    """Descend from draws on growing parts of the throw, then evolve the ends together with other draws."""
    first, end = len(log.chi), log.count + int((1.0 - POLISH_SHARE) * problem.evaluations)
    draw_starts(problem, log)
    chi, _ = _best_apart(log, first, 2 * STARTS)
    if not len(chi):  # no string could be simulated
        return
    starts = _by_growing_parts(problem, log, chi[:STARTS], end - int(EVOLUTION_SHARE * problem.evaluations))
    slopes = GaussNewtonModel(problem.objective)
    ends = descend(log, slopes, descent_batch(starts, log(starts)), end - log.count, ROUNDS).chi
    evolve(log, np.vstack([ends, chi[STARTS:]]), end - log.count, problem.rng)
    _polish(problem, log, first, end + int(POLISH_SHARE * problem.evaluations) - log.count)


def _by_growing_parts(problem: SearchProblem, log: EvaluationLog, starts: Array, end: int) -> Array:
    """Descend on the first part of the throw's frames, then on more and more of them."""
    for part in PARTS:
        left = end - log.count - len(starts)
        if left < 0:
            break
        throws = tuple(throw.until(part) for throw in problem.objective.throws)
        some = replace(problem.objective, throws=throws).thinned(DERIVATIVE_FRAMES)
        own = EvaluationLog(partial(_squared_distances, some))
        slopes = GaussNewtonModel(some, SQUARES_BELOW_M)
        starts = descend(own, slopes, descent_batch(starts, own(starts)), left, ROUNDS).chi
        log.count += own.count
    return starts


def _polish(problem: SearchProblem, log: EvaluationLog, first: int, evaluations: int) -> bool:
    """Descend from the best that differ of the batches since `first`; return whether all converged."""
    ends = descent_batch(*_best_apart(log, first, ENDS))
    slopes = GaussNewtonModel(problem.objective)
    return bool(descend(log, slopes, ends, evaluations, POLISH_ROUNDS).done.all())


def _best_apart(log: EvaluationLog, first: int, count: int) -> tuple[Array, Array]:
    """Return the best candidates (N, d) of the batches since `first` that differ, and their costs (N,)."""
    chi, values = (np.concatenate(column[first:]) for column in (log.chi, log.values))
    rows = apart(chi, values, count)
    return chi[rows], values[rows]
