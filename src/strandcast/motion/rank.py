"""How near earlier trials came, also those whose tip was hidden when it mattered."""

from __future__ import annotations

import numpy as np

from strandcast.motion.earlier import Earlier
from strandcast.motion.objective import closest_approach
from strandcast.motion.residual import filled
from strandcast.motion.strings import Strings
from strandcast.motion.task import Task
from strandcast.motion.throws import World, throw


def likely_miss_m(task: Task, strings: Strings, trial: Earlier) -> float:
    """Return the measured miss or, where the tip was not seen, that of the best string on the same joints.

    Where the tip was seen its path is as seen; between, the simulation misses by what it missed by before and
    after.
    """
    if trial.miss_m is not None:
        return trial.miss_m
    last = len(trial.q) - 1
    world = World(start_m=trial.start_m)
    simulated = throw(task, strings.take([0]), world, trial.q[None], np.array([last])).points_m[0, :, -1]
    path = simulated + filled((trial.tip_m - simulated)[None])[0]
    if not np.isfinite(path).all():
        return np.inf
    return float(closest_approach(path, last, *task.target_m)[0])
