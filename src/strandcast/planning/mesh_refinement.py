"""The same string with more mass points: where a refined chain moves differently, do not trust the model.

How a chain whips depends on its spacing long before it depends on what the string is made of. A motion that
brings the tip to the target with one spacing and with half of it does not rely on what the model cannot know.
"""

from dataclasses import replace

import numpy as np

from strandcast.core.strings import BEND_FRICTION, PARAMETERS, StringBatch
from strandcast.dynamics.masses import plain_masses
from strandcast.planning.task import PlanningTask

# Per unit of a plain point's mass, bending stiffness grows with the square of the number of points; drag does
# not. Stretching stiffness only keeps the cord's length: it stays as high as the time step allows.
UNCHANGED = ("C_c1", "C_c2", "k_s", "c_s")


def refined_task(task: PlanningTask, factor: int = 2) -> PlanningTask:
    """Return the task with `factor` times as many mass points."""
    return replace(task, model=replace(task.model, points=factor * task.model.points))


def refined_strings(strings: StringBatch, factor: int = 2) -> StringBatch:
    """Return the same strings as chains of `factor` times as many points.

    Masses beyond those of plain points with a free end keep their places; bending stiffness and density are
    the same.
    """
    between = np.array([1.0 if name in UNCHANGED else factor**2 for name in PARAMETERS])
    count = strings.masses.shape[1]
    strings = strings.applied()
    masses = np.tile(plain_masses(factor * count), (len(strings), 1))
    masses[:, factor - 1 :: factor] += factor * (strings.masses - plain_masses(count))
    return replace(
        strings.with_values(bend_friction=strings[BEND_FRICTION] * factor**2),
        parameters=strings.parameters * between,
        masses=masses,
        bend_factor=np.repeat(strings.bend_factor, factor, axis=1),
        stiff_joints=np.repeat(strings.stiff_joints, factor),
    )
