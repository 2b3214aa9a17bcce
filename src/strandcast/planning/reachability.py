"""Refuse targets that no throw can reach, and report the least distance that a throw can reach."""

import math
from functools import singledispatch
from typing import NamedTuple

import numpy as np

from strandcast.core.objectives import (
    AimedPoint,
    Objective,
    PointInSpace,
    SegmentObjective,
    ShapeObjective,
)
from strandcast.errors import StrandcastError
from strandcast.planning.task import PlanningTask

WHOLE_STRING = math.inf
BAR_PLACES = 33  # of a bar, checked for reach; chosen, not sensitive


class Goal(NamedTuple):
    """One of the places alternatives_m (A, 2 or 3) must be reached by the point `along_m` from the hand."""

    alternatives_m: np.ndarray
    along_m: float


@singledispatch
def goals(objective: Objective) -> list[Goal]:
    """Return the places that must be within reach; none for a kind without a registered function."""
    return []


@goals.register
def _point_goals(objective: AimedPoint | PointInSpace) -> list[Goal]:
    return [Goal(np.array([objective.target_m]), WHOLE_STRING)]


@goals.register
def _segment_goals(objective: SegmentObjective) -> list[Goal]:
    share = np.linspace(0.0, 1.0, BAR_PLACES)[:, None]
    one, other = np.array(objective.ends_m, float)
    return [Goal((1.0 - share) * one + share * other, WHOLE_STRING)]


@goals.register
def _shape_goals(objective: ShapeObjective) -> list[Goal]:
    return [Goal(np.array([place.at_m]), place.along_m) for place in objective.places]


def refuse_unreachable(task: PlanningTask) -> None:
    """Refuse a task that no throw can reach.

    Raises
    ------
    StrandcastError
        A place is beyond arm and string, or outside the workspace.
    """
    for goal in goals(task.aim):
        _refuse_goal(task, goal)


def _refuse_goal(task: PlanningTask, goal: Goal) -> None:
    box, (origin_m, arm_m) = task.box(), task.arm.reach()
    along_m = min(goal.along_m, task.model.length_m)
    reach_m = float(arm_m + along_m)
    away_m = float(np.linalg.norm(goal.alternatives_m - origin_m, axis=1).min())
    if away_m > reach_m:
        raise StrandcastError(
            "SC-P002",
            f"the target is {away_m:.3f} m from the arm's first joint; arm and string reach {reach_m:.3f} m",
            field=task.aim.target_field,
            cost=f"no throw comes nearer than {away_m - reach_m:.3f} m",
            fix="move the target, or use a longer string",
        )
    out = np.maximum(box[:, 0] - goal.alternatives_m, goal.alternatives_m - box[:, 1])
    out_m = float(out.max(axis=1).min())
    if out_m > 0.0:
        sides = ", ".join(f"{axis} {side.tolist()}" for axis, side in zip("xyz", box, strict=False))
        raise StrandcastError(
            "SC-P002",
            f"the target lies {out_m:.3f} m outside the workspace {sides} m",
            field=task.aim.target_field,
            fix="move the target, or widen workspace_m",
        )
