"""Gauss-Newton descent over motions.

The simulated tips say in which direction each height of the velocity curves moves the misses: a few
derivatives lead further than a thousand random changes.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from strandcast.arm.load import Arm
from strandcast.core.objectives import AimedPoint, PointInSpace
from strandcast.core.strings import StringBatch
from strandcast.planning.assessment import Assessment, assess_rollouts
from strandcast.planning.cost import (
    LIMIT_COST_M,
    fault_costs,
    motion_costs,
    rollout_cost,
    start_cost,
    stop_cost,
)
from strandcast.planning.paths import Curves, JointPaths, paths_of
from strandcast.planning.rollouts import AFTER_END_S, RolloutConditions, Rollouts, rollouts_of_paths
from strandcast.planning.task import PlanningTask

# All chosen.
HEIGHT_RAD_S = 1.5  # unit of the heights in a search
STEP = 0.02  # of finite differences, in units of the search
# Dampings tried at once, times the last one that was taken; relative to the mean curvature. Directions to
# which no tip is sensitive must not be walked along, so all unknowns are damped the same.
LADDER = 10.0 ** np.arange(-3.0, 3.0)
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 0.1, 1e-5, 1e3
GAIN = 1e-3  # smallest relative improvement that counts
ROOM = 0.02  # before a joint's limit, relative to it, where the descent begins to turn away


class MotionResiduals(NamedTuple):
    """Residuals (P, R) of P motions, with squares that add up to about their squared cost; costs (P,) [m]."""

    parts_m: np.ndarray
    cost_m: np.ndarray


def motion_residuals(
    task: PlanningTask,
    strings: StringBatch,
    conditions: RolloutConditions,
    curves: Curves,
    *,
    stops: bool = False,
) -> MotionResiduals:
    """Simulate motions with every string, and return what there is to reduce.

    The residuals are the misses, what else spoils the throws, how far joints go beyond their limits or come
    near them, and if `stops`, which takes time, how far a stop would take arm or string out of the workspace.
    """
    paths = paths_of(curves, task.step_s, AFTER_END_S, task.dynamics)
    rollouts = rollouts_of_paths(task, strings, conditions, paths)
    found = rollout_residuals(task, rollouts, paths, len(strings), stops=stops)
    return found._replace(cost_m=found.cost_m + start_cost(task, curves.q0_rad))


def rollout_residuals(
    task: PlanningTask, rollouts: Rollouts, paths: JointPaths, strings: int, *, stops: bool
) -> MotionResiduals:
    """Return the residuals of motions that were simulated with so many strings, start postures apart."""
    assessment = assess_rollouts(task, rollouts)
    stops_m = stop_cost(task, paths) if stops else np.zeros(len(paths.q))
    cost_m = rollout_cost(assessment, strings, task.step_s) + motion_costs(task, paths) + stops_m
    of_strings = np.column_stack([miss_parts(task, rollouts, assessment), fault_costs(assessment)])
    over = LIMIT_COST_M * near_limits(paths, task.arm)
    parts_m = np.hstack([of_strings.reshape(len(paths.q), -1) / np.sqrt(strings), over, stops_m[:, None]])
    return MotionResiduals(np.nan_to_num(parts_m, nan=1.0), cost_m)


def miss_parts(task: PlanningTask, rollouts: Rollouts, assessment: Assessment) -> np.ndarray:
    """Return (B, 2 or 3) offsets of the tips from the point to hit, or of other aims (B, 1) misses [m]."""
    aim, after = task.aim, np.clip(assessment.hit_index, 1, rollouts.last)
    if not isinstance(aim, AimedPoint | PointInSpace) or getattr(aim, "has_velocity", False):
        return assessment.miss_m[:, None]
    tip_m, each = rollouts.tip_m(), np.arange(len(after))
    start, way = tip_m[each, after - 1], tip_m[each, after] - tip_m[each, after - 1]
    along = ((task.target_m - start) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-12)
    return np.asarray(start + np.clip(along, 0.0, 1.0)[:, None] * way - task.target_m)


def near_limits(paths: JointPaths, arm: Arm) -> np.ndarray:
    """Return (P, L) how far joints and places are beyond `ROOM` before their limits, relative to these."""
    return np.maximum(np.hstack(paths.excesses(arm)) + ROOM, 0.0)


def descend_motion(
    residuals: Callable[[np.ndarray], MotionResiduals], start: np.ndarray, free: int, evaluations: int
) -> tuple[np.ndarray, float, int]:
    """Reduce the cost of a motion by damped Gauss-Newton steps.

    Parameters
    ----------
    residuals
        Of points (P, d).
    start
        (d,) the point to begin with.
    free
        Number of the unknowns to change, the first ones.
    evaluations
        How many points it may try, those for derivatives included.

    Returns
    -------
    The best point, its cost [m], and how many points were tried.
    """
    point, (parts, (best_m,)) = start, residuals(start[None])
    tried, damping = 1, FIRST_DAMPING
    steps = STEP * np.eye(free, len(start))
    while tried + free + len(LADDER) <= evaluations and damping <= MOST_DAMPING:
        jacobian = (residuals(point + steps).parts_m - parts).T / STEP
        curvature, gradient = jacobian.T @ jacobian, jacobian.T @ parts[0]
        tried += free
        if not gradient.any():  # nothing is missed
            break
        improved = False
        while not improved and tried + len(LADDER) <= evaluations and damping <= MOST_DAMPING:
            dampings = damping * LADDER
            damped = [curvature + one * np.trace(curvature) / free * np.eye(free) for one in dampings]
            candidates = np.tile(point, (len(LADDER), 1))
            candidates[:, :free] -= np.linalg.solve(np.array(damped), gradient[None, :, None])[..., 0]
            found = residuals(candidates)
            tried += len(LADDER)
            k = int(np.argmin(found.cost_m))
            improved = bool(found.cost_m[k] < (1.0 - GAIN) * best_m)
            if improved:
                point, parts, best_m = candidates[k], found.parts_m[k : k + 1], found.cost_m[k]
                damping = max(float(dampings[k]), LEAST_DAMPING)
            else:
                damping *= MOST_DAMPING
    return point, float(best_m), tried
