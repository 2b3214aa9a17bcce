"""What a motion costs in the searches: metres of miss over the ensemble, and everything else as metres."""

from __future__ import annotations

import numpy as np

from strandcast.arm.reach import roughly_outside_m
from strandcast.motion.bars import start_blame
from strandcast.motion.objective import Assessment
from strandcast.motion.paths import Paths
from strandcast.motion.task import Task

# Beyond a bend of about 57 degrees between neighbours the model is wrong.
FREE_FOLD = 0.45
FOLD_COST_M = 0.05
OUTSIDE_COST = 2.0
TOUCH_COST = 1.0
HIDDEN_COST = 3.0
START_COST = 10.0
# What the model gets wrong grows with time.
LATE_COST_M_S = 0.01
LIMIT_COST_M = 1.0
# More than any miss can gain: what may not be is never better than what may.
FORBIDDEN_M = 10.0
EFFORT_COST_M_S_RAD = 0.0008


def throw_cost(assessment: Assessment, strings: int, step_s: float) -> np.ndarray:
    """Return (P,) rms miss over the strings, and the price of all that makes a throw a bad one [m]."""
    miss, index, fold, outside, touch, hidden = (
        getattr(assessment, name).reshape(-1, strings)
        for name in ("miss_m", "hit_index", "fold", "outside_m", "touch_m", "hidden_m")
    )
    return np.asarray(
        np.sqrt(np.mean(miss**2, axis=1))
        + LATE_COST_M_S * step_s * index.mean(axis=1)
        + FOLD_COST_M * np.maximum(0.0, fold - FREE_FOLD).mean(axis=1)
        + OUTSIDE_COST * outside.mean(axis=1)
        + TOUCH_COST * touch.mean(axis=1)
        + HIDDEN_COST * hidden.mean(axis=1)
    )


def motion_costs(task: Task, paths: Paths) -> np.ndarray:
    """Return (P,) the price of breaking the arm's limits, and a small one of fast joints [m]."""
    over = paths.excess(task.arm.limits)
    price = FORBIDDEN_M * (over > 0.0) + LIMIT_COST_M * over + EFFORT_COST_M_S_RAD * paths.effort_rad_s
    if task.price_stops:
        price = price + OUTSIDE_COST * roughly_outside_m(task.arm, paths.q, task.step_s, task.hanging_m)
    return np.asarray(price)


def start_cost(task: Task, postures_rad: np.ndarray, clearance_m: float) -> np.ndarray:
    """Return (P,) the price of a string that hangs over the arm or out of the box at the start [m]."""
    blame = start_blame(task.arm, task.model.length_m, task.box(), clearance_m, postures_rad)
    return np.where(blame > 0.0, FORBIDDEN_M + START_COST * blame, 0.0)
