"""The same string with more mass points: where it goes elsewhere then, the model is not to be trusted.

How a chain whips depends on its spacing long before it depends on what the string is made of. A motion that
brings the tip to the target with one spacing and with half of it does not lean on what the model cannot know.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strandcast.motion.strings import Strings
from strandcast.motion.task import Task
from strandcast.string.parameters import PARAMETERS

# Per unit of a plain point's mass, what bends grows with the square of the points' number, drag does not.
# What stretches only keeps a cord's length: it stays as stiff as the step can take.
AS_THEY_ARE = ("C_c1", "C_c2", "k_s", "c_s")


def finer_task(task: Task, factor: int = 2) -> Task:
    """Return the task with `factor` times as many mass points."""
    return replace(task, model=replace(task.model, points=factor * task.model.points))


def finer_strings(strings: Strings, factor: int = 2) -> Strings:
    """Return the same strings as chains of `factor` times as many points.

    Masses beyond that of a plain point stay where they are; bending stiffness and density stay what they are.
    """
    between = np.array([1.0 if name in AS_THEY_ARE else factor**2 for name in PARAMETERS])
    masses = np.ones((len(strings), factor * strings.masses.shape[1]))
    masses[:, factor - 1 :: factor] += factor * (strings.masses - 1.0)
    return replace(
        strings,
        parameters=strings.parameters * between,
        masses=masses,
        bend_friction=strings.bend_friction * factor**2,
        bend_factor=np.repeat(strings.bend_factor, factor, axis=1),
    )
