"""The cost of a motion in the searches: its miss over the ensemble, and everything else in metres too."""

import numpy as np

from strandcast.arm.reach import roughly_outside_m
from strandcast.planning.assessment import Assessment
from strandcast.planning.capsules import start_violation_m
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
# How near the string may come to the middle of the arm's links, and at the start to a hit; chosen.
CLEARANCE_M = 0.035


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
    away_m = start_violation_m(task.arm, task.model.length_m, task.box(), CLEARANCE_M, postures_rad, clear_of)
    return np.where(away_m > 0.0, FORBIDDEN_M + START_COST * away_m, 0.0)
