"""How near earlier trials came, also those whose tip was hidden when it mattered."""

from __future__ import annotations

import numpy as np

from strandcast.motion.earlier import Earlier
from strandcast.motion.residual import missed_by
from strandcast.motion.strings import Strings
from strandcast.motion.task import Task
from strandcast.motion.throws import World, throw, throws_of


def likely_miss_m(task: Task, strings: Strings, trial: Earlier) -> float:
    """Return the measured miss or, where there is none, that of the best string on the same joints.

    Where the tip was seen its path is as seen; between, the simulation misses by what it missed by before and
    after.
    """
    if trial.miss_m is not None:
        return trial.miss_m
    last = np.array([len(trial.q) - 1])
    thrown = throw(task, strings.take([0]), World(start_m=trial.start_m), trial.q[None], last)
    residual = missed_by(trial, thrown.points_m[:, :, -1], task.step_s)
    if not np.isfinite(thrown.points_m).all():
        return np.inf
    return float(task.goal.miss(throws_of(task, thrown, residual))[0][0])
