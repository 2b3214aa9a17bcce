"""Planning tasks in the plane and in space: arm, string, target, workspace and objective."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.arm.dynamics import NO_DYNAMICS, Dynamics
from strandcast.arm.load import Arm
from strandcast.core.box import Box
from strandcast.core.objectives import Objective, PointInSpace, PointObjective
from strandcast.dynamics.model import StringModel

# Least step of the simulation in a search: single precision and this step are four times as fast, and the tip
# is some hundredths of a millimetre away.
ROUGH_STEP_S = 2e-3

HIT_THE_TARGET = PointObjective()


@dataclass(frozen=True, eq=False)
class PlanningTask:
    """Hit a target with the tip of a string on an arm, or in a plane reach another objective with it.

    Attributes
    ----------
    model
        The fixed properties of the string.
    target_m
        (2 or 3,) the target in the world frame [m].
    hit_radius_m
        A miss up to this is a hit [m].
    workspace
        The box in the plane that hand and string must not leave; the arm's by default, and in space always.
    objective
        The throw's objective in a plane; by default, and in space always, the tip hits the target.
    """

    arm: Arm
    model: StringModel
    target_m: np.ndarray
    hit_radius_m: float
    workspace: Box | None = None
    objective: Objective = HIT_THE_TARGET

    @property
    def in_space(self) -> bool:
        """Whether the arm throws in space."""
        return self.arm.axes == 3

    @property
    def aim(self) -> Objective:
        """The objective with the target."""
        if not self.in_space:
            return self.objective.aimed_at((self.target_m[0], self.target_m[1]))
        if len(self.target_m) != 3:
            raise ValueError(f"target_m: {len(self.target_m)} coordinates; a target in space has x, y and z")
        x, y, z = map(float, self.target_m)
        return PointInSpace(target_m=(x, y, z))

    def box(self) -> np.ndarray:
        """Return the workspace as (2 or 3, 2): low and high of each coordinate [m]."""
        own = self.workspace
        return self.arm.box_m if own is None else np.array([own.x_m, own.y_m])

    @property
    def dynamics(self) -> Dynamics:
        """The arm's dynamics, if its torques are limited."""
        return self.arm.dynamics if np.isfinite(self.arm.limits.torque_n_m).any() else NO_DYNAMICS

    @property
    def step_s(self) -> float:
        """Time between the motion's points [s]."""
        return 1.0 / self.arm.log_rate_hz

    def rough(self) -> PlanningTask:
        """Return the task with the string in single precision and with steps of at least `ROUGH_STEP_S`."""
        model = replace(self.model, precision="f32", dt_s=max(self.model.dt_s, ROUGH_STEP_S))
        return replace(self, model=model)

    @property
    def hanging_m(self) -> float:
        """Greatest distance of the string from the hand, the part inside the clamp included [m]."""
        return self.model.length_m + self.arm.clamp.clamped_length_m
