"""Optional forces of the model: each is tried, and kept where it predicts better what was not fitted."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import ForceName, StringBatch, Unknown
from strandcast.estimation.cross_validation import fold_errors, folds_of
from strandcast.estimation.ensemble import distant_members
from strandcast.estimation.fit import PAYS
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.optimisers.optimiser import SearchStart
from strandcast.estimation.search import search, search_budget
from strandcast.estimation.space import Space
from strandcast.estimation.throws import TrialParts
from strandcast.records.estimate import ForceTried

FEWEST_COMPARED = 3  # parts that were not fitted; chosen


def kept_forces(tried: Sequence[ForceName], space: Space, previous: StringBatch | None) -> list[ForceName]:
    """Return which of the forces that are tried the estimate before has kept."""
    if previous is None:
        return []
    return [
        force
        for force in tried
        if (rows := space.unknowns_of(force))
        and all((previous[row.name] != row.absent).any() for row in rows)
    ]


class _Search(NamedTuple):
    """A search with one more force."""

    force: ForceName
    objective: FitObjective
    log: EvaluationLog


def with_forces_that_pay(
    tried: Sequence[ForceName],
    objective: FitObjective,
    log: EvaluationLog,
    parts: TrialParts,
    settings: EstimateSettings,
    rng: np.random.Generator,
    start: SearchStart,
) -> tuple[FitObjective, EvaluationLog, list[ForceTried]]:
    """Add one force after the other to a search, the one that lowers the cost most first, while that pays.

    A force that lowers the cost too little is tried once; one that stands for another's effect is tried again
    beside it. `parts`: of the trials.
    """
    found: list[ForceTried] = []
    left = [force for force in tried if objective.space.unknowns_of(force)]
    # A search that has not converged gains by any that follows.
    while left and log.converged and np.isfinite(log.best()[1]):
        searches = [_search_with(force, objective, log, settings, rng, start) for force in left]
        searches.sort(key=lambda search: search.log.best()[1])
        judged = []
        for each in searches:
            judged.append(_judged(each, objective, log, parts))
            if judged[-1].kept:
                break
        kept = [force for force in judged if force.kept]
        found += [force for force in judged if force.kept or force.held_out_m is None or not kept]
        left = [each.force for each in searches if each.force not in {force.name for force in found}]
        if not kept:
            break
        # Whether independent searches agree shows in those without it: the others began with their strings.
        gain = each.log.best()[1] / log.best()[1]
        each.log.ends = [gain * end for end in log.ends]
        objective, log = each.objective, each.log
    return objective, log, found


def _search_with(
    force: ForceName,
    objective: FitObjective,
    log: EvaluationLog,
    settings: EstimateSettings,
    rng: np.random.Generator,
    start: SearchStart,
) -> _Search:
    """Search with one more force, from the strings that were found without it.

    A search from nothing with more unknowns finds what it found without them less surely.
    """
    chi, values = log.all()
    freer = replace(objective, space=objective.space.with_force(force))
    own_rng = rng.spawn(1)[0]  # what follows does not depend on a search that did not pay
    near = objective.space.strings(chi[distant_members(chi, values)])
    starts = replace(start, previous=_starts(objective.space.unknowns_of(force), near))
    return _Search(force, freer, search(freer, settings, own_rng, starts, search_budget(objective, settings)))


def _judged(found: _Search, objective: FitObjective, log: EvaluationLog, parts: TrialParts) -> ForceTried:
    """Return what a force is worth beside the search without it."""
    cost_m = [log.best()[1], found.log.best()[1]]
    if not cost_m[1] < PAYS * cost_m[0]:
        return ForceTried(name=found.force, kept=False, cost_m=cost_m if np.isfinite(cost_m[1]) else None)
    without_m, with_m = (
        fold_errors(folds_of(each, parts), own.best()[0])
        for each, own in ((objective, log), (found.objective, found.log))
    )
    known = np.isfinite(without_m) & np.isfinite(with_m)  # a string may fail in a trial that was not fitted
    if known.sum() < FEWEST_COMPARED:
        return ForceTried(name=found.force, kept=False, cost_m=cost_m)
    gain_m = (without_m - with_m)[known]
    gain_sd_m = float(gain_m.std(ddof=1) / np.sqrt(len(gain_m)))
    kept = found.log.converged and bool(gain_m.mean() > gain_sd_m)
    held_out_m = [float(without_m[known].mean()), float(with_m[known].mean())]
    return ForceTried(name=found.force, kept=kept, cost_m=cost_m, held_out_m=held_out_m, gain_sd_m=gain_sd_m)


def _starts(rows: Sequence[Unknown], found: StringBatch) -> StringBatch:
    """Return strings with each first value of the new unknowns; those without one are absent."""
    for row in rows:
        if row.starts:
            tiled = found.take(np.tile(np.arange(len(found)), len(row.starts)))
            found = tiled.with_values(**{row.name: np.repeat(row.starts, len(found))})
    return found
