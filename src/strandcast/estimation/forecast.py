"""What a fit would have said of frames not seen: each part of the newest throw is left out once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.estimation.evaluation import Array, evaluation_of_points
from strandcast.estimation.objective import Ledger, Objective, play
from strandcast.estimation.refine import LADDER, Slope, descend, valleys
from strandcast.estimation.throw import Task

PARTS = 4
CHOSEN_FROM = 32

REFITTED = f"each of {PARTS} parts of the throw, from a fit to the others"
CHOSEN = f"each of {PARTS} parts of the throw, from the best of the strings tried for the others"


@dataclass(frozen=True, eq=False)
class HeldOut:
    """E (w = 0) on data that the fit behind it had not seen [m]."""

    what: str
    E_m: float


def refitted(objective: Objective, ledger: Ledger, evaluations: int) -> HeldOut:
    """Leave each part out of the fit, and hold it against the string that is found without it.

    These fits start where the whole one ended and walk downhill; they share `evaluations`. Where few steps
    are affordable the end still knows the part: the error is then told too small. NaN where none is.
    """
    best, ends = ledger.best()[0], []
    if evaluations // PARTS - 1 < len(best) + 1 + len(LADDER):
        return HeldOut(REFITTED, float("nan"))  # not one step is affordable: nothing would be refitted
    parts = _parts(objective.tasks[-1])
    for part in parts:
        fold = replace(objective, tasks=(*objective.tasks[:-1], _without(objective.tasks[-1], part)))
        own = Ledger(fold.cost)
        now = valleys(best[None], own(best[None]))
        ends.append(descend(own, Slope(fold), now, evaluations // PARTS - 1).chi[0])
        ledger.count += own.count
    return HeldOut(REFITTED, _mean(objective, parts, ends))


def chosen_again(objective: Objective, ledger: Ledger) -> HeldOut:
    """Leave each part out of the choice among the best strings tried: for searches that only choose."""
    chi, values = ledger.all()
    tried = chi[np.argsort(values, kind="stable")[:CHOSEN_FROM]]
    parts = _parts(objective.tasks[-1])
    simulated, _ = play(objective.model, objective.tasks[-1], objective.space.strings(tried))
    ledger.count += len(tried)
    ends = []
    for part in parts:
        seen = _without(objective.tasks[-1], part)
        error = evaluation_of_points(objective.point_values(seen, simulated), objective.w)
        ends.append(tried[int(np.argmin(np.where(np.isfinite(error), error, np.inf)))])
    return HeldOut(CHOSEN, _mean(objective, parts, ends))


def _parts(task: Task) -> list[Task]:
    """Return the task's parts, each with a measured point in it and in what is left."""
    parts = [task.part(k, PARTS) for k in range(PARTS)]
    return [part for part in parts if part.weight.any() and (task.weight > part.weight).any()]


def _without(task: Task, part: Task) -> Task:
    return replace(task, weight=task.weight - part.weight)


def _mean(objective: Objective, parts: list[Task], ends: list[Array]) -> float:
    """Return the mean of E on each part under the string found without it, by weight; NaN without parts."""
    if not parts:
        return float("nan")
    errors = [
        float(objective.value(part, objective.space.strings(chi), 0.0)[0])
        for part, chi in zip(parts, ends, strict=True)
    ]
    return float(np.average(errors, weights=[part.weight.sum() for part in parts]))
