"""Descents from the best of many draws that are apart: the default search in space, and of captures."""

from dataclasses import replace

import numpy as np

from strandcast.core.strings import PARAMETERS
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import Array, to_exponent
from strandcast.estimation.cable_space import space_of_cable
from strandcast.estimation.descent import GaussNewtonModel, apart, descend, descent_batch
from strandcast.estimation.fit_objective import EvaluationLog
from strandcast.estimation.optimisers.optimiser import SearchProblem
from strandcast.estimation.space import Space

# All chosen.
SCREENED, DESCENTS = 64, 3
IN_PLANE = 2  # times as many: some unknowns hardly matter there
TOGETHER = 8  # steps of all descents, before the best one goes on alone
SCREENING_FRAMES = 60  # of each series


def search_screened(problem: SearchProblem, log: EvaluationLog) -> bool:
    """Screen draws, descend from the best that are apart, and from the best of these ends to its end.

    With dry friction, a string without is fitted before, and one more descent starts from it: two unknowns
    more make the search miss what it finds without them.
    """
    from scipy.stats import qmc  # takes half a second: only for a search that needs it

    objective, space = problem.objective, problem.objective.space
    times = IN_PLANE if space.in_plane else 1
    drawn = qmc.Sobol(space.dimension, rng=problem.rng).random(times * SCREENED)
    draw = plausible(space, objective.model, drawn)
    values = EvaluationLog(objective.thinned(SCREENING_FRAMES).cost)(draw)
    starts = draw[apart(draw, values, times * DESCENTS)]
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
    log.count += times * SCREENED
    return converged


def plausible(space: Space, model: StringModel, draw: Array) -> Array:
    """Return exponents (B, d) of plausible strings, given uniform ones.

    Turns and curls are zero, where clamps and cables are made to be. In the plane the ten parameters are
    those of cables in space, which scale with the length: few strings of ten independent ones are plausible.
    """
    plausible = space.without_turns(draw)
    if space.in_plane:
        cable, own = space_of_cable(model.length_m, False, points=model.points)[1], len(PARAMETERS)
        parameters = cable.strings(cable.without_turns(draw[:, : cable.dimension])).parameters
        plausible[:, :own] = np.clip(to_exponent(parameters, space.bounds[:own]), 0.0, 1.0)
    return plausible
