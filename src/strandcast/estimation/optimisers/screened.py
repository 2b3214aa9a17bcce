"""Descents from the best of many draws that are apart: the default search in space."""

from dataclasses import replace

import numpy as np

from strandcast.estimation.descent import GaussNewtonModel, apart, descend, descent_batch
from strandcast.estimation.fit_objective import EvaluationLog
from strandcast.estimation.optimisers.optimiser import SearchProblem

# All chosen.
SCREENED, DESCENTS = 64, 3
TOGETHER = 8  # steps of all descents, before the best one goes on alone
SCREENING_FRAMES = 60  # of each series


def search_screened(problem: SearchProblem, log: EvaluationLog) -> bool:
    """Screen draws, descend from the best that are apart, and from the best of these ends to its end.

    With dry friction, a string without is fitted before, and one more descent starts from it: two unknowns
    more make the search miss what it finds without them.
    """
    from scipy.stats import qmc  # takes half a second: only for a search that needs it

    objective, space = problem.objective, problem.objective.space
    # Turns and curls start near zero, where clamps and cables are made to be.
    draw = space.without_turns(qmc.Sobol(space.dimension, rng=problem.rng).random(SCREENED))
    values = EvaluationLog(objective.thinned(SCREENING_FRAMES).cost)(draw)
    starts = draw[apart(draw, values, DESCENTS)]
    if problem.start.previous is not None:
        starts = np.vstack([starts, space.chi_of(problem.start.previous.take(0))])
    plain = space.without_friction()
    if plain.dimension < space.dimension:
        before = EvaluationLog(replace(objective, space=plain).cost)
        search_screened(replace(problem, objective=replace(objective, space=plain)), before)
        starts = np.vstack([starts, space.with_least_friction(plain, before.best()[0])])
    slopes = GaussNewtonModel(objective)
    descents = descend(log, slopes, descent_batch(starts, log(starts)), problem.evaluations, TOGETHER)
    best = descents.pick(np.array([np.argmin(descents.value)]))
    converged = bool(descend(log, slopes, best, problem.left(log)).done.all())
    log.count += SCREENED
    return converged
