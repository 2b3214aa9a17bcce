"""The search of the settings, in ranges that are wide enough."""

from dataclasses import replace

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.estimation.fit import PAYS
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.optimisers.optimiser import SearchProblem, SearchStart
from strandcast.estimation.optimisers.registry import OPTIMISERS
from strandcast.estimation.unknowns import widened
from strandcast.progress import Progress

# Chosen.
NEAR_SAMPLES = 64
CROSS_VALIDATION_SHARE = 0.08  # of the evaluations


def search(
    objective: FitObjective,
    settings: EstimateSettings,
    rng: np.random.Generator,
    start: SearchStart,
    evaluations: int,
) -> EvaluationLog:
    """Run the search of the settings with at most so many simulations; the log holds all strings tried."""
    progress = Progress("estimate", evaluations)

    def report(count: int, best: float) -> None:
        more = f", {count - evaluations} more for the uncertainty" if count > evaluations else ""
        progress(min(count, evaluations), f"best cost {1e3 * best:.2f} mm{more}")

    searched = replace(objective, model=replace(objective.model, precision=objective.space.precision))
    log = EvaluationLog(searched.cost, report)
    problem = SearchProblem(searched, settings, start, rng, evaluations)
    log.converged = OPTIMISERS.get(settings.search)(problem, log)
    return log


def search_in_wide_enough_ranges(
    objective: FitObjective, settings: EstimateSettings, rng: np.random.Generator, start: SearchStart
) -> tuple[FitObjective, EvaluationLog]:
    """Search; where a stiffness ended at its upper bound, search wider ranges while that pays.

    A fit at a bound says little of where the best string beyond it lies: the wider search starts again.
    """
    budget = search_budget(objective, settings)
    log = search(objective, settings, rng, start, budget)
    while settings.ranges == "wide" and np.isfinite(log.best()[1]):
        best, value = log.best()
        space = widened(objective.space, best)
        if space is None:
            break
        wider = replace(objective, space=space)
        own_rng = rng.spawn(1)[0]  # what follows does not depend on a search that did not pay
        beyond = search(wider, settings, own_rng, replace(start, previous=None), budget)
        if beyond.best()[1] > PAYS * value:
            break
        objective, log = wider, beyond
    return objective, log


def search_budget(objective: FitObjective, settings: EstimateSettings) -> int:
    """Return the evaluations left for the search itself."""
    if settings.search == "paper" or not objective.space.in_plane:
        return settings.evaluations
    return max(int((1.0 - CROSS_VALIDATION_SHARE) * settings.evaluations) - NEAR_SAMPLES, NEAR_SAMPLES)
