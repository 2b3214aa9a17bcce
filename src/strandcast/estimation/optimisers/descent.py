"""Descent from several draws, with evolution in between: the default search."""

from dataclasses import replace

import numpy as np

from strandcast.estimation.descent import LADDER, GaussNewtonModel, apart, descend, descent_batch
from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit_objective import EvaluationLog
from strandcast.estimation.optimisers.evolution import evolve
from strandcast.estimation.optimisers.optimiser import SearchProblem
from strandcast.estimation.optimisers.starts import draw_starts, spread_population

# All chosen.
ROUNDS = 2  # of a descent at a time
EARLY = (0.4, 0.7)  # of the used frames
EARLY_SHARE, WALK_SHARE, POLISH_SHARE = 0.085, 0.17, 0.15  # of the evaluations
ENDS = 2  # candidates that are polished


def search_by_descent(problem: SearchProblem, log: EvaluationLog) -> bool:
    """Descend from many draws for a few rounds, evolve the results, then descend from the best to the end.

    A descent ends in the local minimum where it began, and E has many; evolution finds the right one, but
    converges slowly.
    """
    draw_starts(problem, log)
    population, values = spread_population(log)
    if not np.isfinite(values[0]):
        return False
    effort = ROUNDS * (population.shape[1] + 1 + len(LADDER))
    if problem.start.previous is None:
        few = int(EARLY_SHARE * problem.evaluations / (len(EARLY) * effort))
        population[:few] = _by_early_frames(problem, log, population[:few])
        values[:few] = log(population[:few])
    many = int(WALK_SHARE * problem.evaluations / effort)
    walked = descent_batch(population[:many], values[:many])
    population[:many] = descend(
        log, GaussNewtonModel(problem.objective), walked, problem.left(log), ROUNDS
    ).chi
    polish = int(POLISH_SHARE * problem.evaluations)
    evolve(log, population, problem.left(log) - polish, problem.rng)
    return _polish(problem, log)


def _by_early_frames(problem: SearchProblem, log: EvaluationLog, starts: Array) -> Array:
    """Descend on the early frames, then on more of them: early E has fewer local minima."""
    for share in EARLY if len(starts) else ():
        throws = tuple(throw.until(share) for throw in problem.objective.throws)
        early = replace(problem.objective, throws=throws)
        own = EvaluationLog(early.cost)
        now = descent_batch(starts, own(starts))
        starts = descend(own, GaussNewtonModel(early), now, problem.left(log), ROUNDS).chi
        log.count += own.count
    return starts


def _polish(problem: SearchProblem, log: EvaluationLog) -> bool:
    """Descend from the best candidates that differ; drop the worse half after every two rounds.

    Returns
    -------
    Whether the best one converged.
    """
    chi, values = log.all()
    rows = apart(chi, values, ENDS)
    now, slope = descent_batch(chi[rows], values[rows]), GaussNewtonModel(problem.objective)
    before = -1
    while not now.done.all() and log.count > before:
        before = log.count
        now = descend(log, slope, now, problem.left(log), ROUNDS)
        now = now.pick(np.argsort(now.value, kind="stable")[: max(len(now.value) // 2, 1)])
    return bool(now.done.all())
