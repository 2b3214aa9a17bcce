"""The cost of a motion in the searches: its miss over the ensemble, and everything else in metres too."""

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.reach import roughly_outside_m
from strandcast.planning.assessment import CLEARANCE_M, Assessment
from strandcast.planning.paths import JointPaths
from strandcast.planning.reachability import WHOLE_STRING, goals
from strandcast.planning.task import PlanningTask

# The weights are chosen; docs/explanation/throws.md has what the planner as a whole achieves with them.
# 1 - cos of a bend of about 57 degrees between neighbours: beyond it the model is wrong.
FREE_FOLD = 0.45
FOLD_COST_M = 0.05
OUTSIDE_COST = 2.0
TOUCH_COST = 1.0
HIDDEN_COST = 3.0
START_COST = 10.0
# The model's error grows with time.
LATE_COST_M_S = 0.01
LIMIT_COST_M = 1.0
# More than any miss can gain: a motion that is not allowed is never better than one that is.
FORBIDDEN_M = 10.0
EFFORT_COST_M_S_RAD = 0.0008
NEAR_HAND_M = 0.06  # string this near to the hand cannot be far from it; chosen
HANGING_SPACING_M = 0.015  # between the places of the hanging string that are checked; chosen
LONGER = 1.05  # how much longer than specified a string may be; chosen


def rollout_cost(assessment: Assessment, strings: int, step_s: float) -> np.ndarray:
    """Return (P,) rms miss over the strings, plus the price of everything else that spoils a throw [m]."""
    miss, index = assessment.miss_m.reshape(-1, strings), assessment.hit_index.reshape(-1, strings)
    faults = fault_costs(assessment).reshape(len(miss), -1).sum(axis=1) / strings
    late = LATE_COST_M_S * step_s * index.mean(axis=1)
    return np.asarray(np.sqrt(np.mean(miss**2, axis=1)) + late + faults)


def fault_costs(assessment: Assessment) -> np.ndarray:
    """Return (B, 4) the prices of folding, leaving the workspace, touching the arm, hiding the tip [m]."""
    fold = FOLD_COST_M * np.maximum(0.0, assessment.fold - FREE_FOLD)
    places = OUTSIDE_COST * assessment.outside_m, TOUCH_COST * assessment.touch_m
    return np.column_stack([fold, *places, HIDDEN_COST * assessment.hidden_m])


def motion_costs(task: PlanningTask, paths: JointPaths) -> np.ndarray:
    """Return (P,) the price of breaking the arm's limits, plus a small one for fast joints [m]."""
    over = paths.excess(task.arm)
    return np.asarray(
        FORBIDDEN_M * (over > 0.0) + LIMIT_COST_M * over + EFFORT_COST_M_S_RAD * paths.effort_rad_s
    )


def stop_cost(task: PlanningTask, paths: JointPaths) -> np.ndarray:
    """Return (P,) the price of arm or string out of the arm's workspace after a stop; none in space [m]."""
    if task.in_space:
        return np.zeros(len(paths.q))
    return OUTSIDE_COST * roughly_outside_m(task.arm, paths.q, task.step_s, task.hanging_m)


def start_cost(task: PlanningTask, postures_rad: np.ndarray) -> np.ndarray:
    """Return (P,) the price of a string that starts over the arm, out of the box or at the target [m]."""
    places_m = [goal.alternatives_m for goal in goals(task.aim) if goal.along_m == WHOLE_STRING]
    clear_of = (np.concatenate(places_m), task.hit_radius_m + CLEARANCE_M) if places_m else None
    away_m = start_violation_m(task.arm, task.model.length_m, task.box(), postures_rad, clear_of)
    return np.where(away_m > 0.0, FORBIDDEN_M + START_COST * away_m, 0.0)


def start_violation_m(
    arm: Arm,
    length_m: float,
    box: np.ndarray,
    q0: np.ndarray,
    clear_of: tuple[np.ndarray, float] | None = None,
) -> np.ndarray:
    """Return how deep the hanging string is in the capsules, out of the box, or at the target, at the start.

    The string hangs straight down from the hand; no model's stretch enters.

    Parameters
    ----------
    length_m
        The string's free length [m].
    box
        (2 or 3, 2) low and high of each coordinate [m].
    q0
        (P, J) postures [rad].
    clear_of
        Places (A, 2 or 3) of the target, and how far from them the string must hang [m].

    Returns
    -------
    (P,) [m], 0 where a start posture is allowed.
    """
    hand = arm.hand_m(q0)
    upwards = np.eye(hand.shape[1])[-1]
    down = np.append(np.arange(NEAR_HAND_M, length_m, HANGING_SPACING_M), LONGER * length_m)
    hanging = hand[:, None] - down[:, None] * upwards
    away = _distances(hanging, arm.capsules(q0))
    deep = np.maximum(arm.capsule_radii(CLEARANCE_M) - away, 0.0).max(axis=(1, 2))
    shown = np.concatenate([hand[:, None], hanging], axis=1)
    out = np.maximum(box[:, 0] - shown, shown - box[:, 1]).max(axis=(1, 2))
    wrong = np.maximum(deep, np.maximum(out, 0.0))
    if clear_of is not None:
        places_m, clear_m = clear_of
        apart_m = places_m - hand[:, None]
        apart_m[..., -1] += np.clip(-apart_m[..., -1], 0.0, LONGER * length_m)
        wrong = np.maximum(wrong, clear_m - np.linalg.norm(apart_m, axis=-1).min(axis=1))
    return np.asarray(wrong)


def _distances(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return (P, D, S) distances of points (P, D, 2 or 3) to segments (P, S, 2, 2 or 3)."""
    start, step = ends[:, None, :, 0], (ends[:, :, 1] - ends[:, :, 0])[:, None]
    from_start = points[:, :, None] - start
    share = (from_start * step).sum(axis=-1) / np.maximum((step**2).sum(axis=-1), 1e-300)
    return np.asarray(np.linalg.norm(from_start - np.clip(share, 0.0, 1.0)[..., None] * step, axis=-1))
