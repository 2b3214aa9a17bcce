"""Planning tasks in the plane and in space: arm, string, target, workspace and objective."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from strandcast.arm.dynamics import NO_DYNAMICS, PlanarDynamics, dynamics_of
from strandcast.arm.load import AnyArm, Arm
from strandcast.arm.spatial import SpatialArm
from strandcast.arm.spatial_dynamics import SpatialDynamics, spatial_dynamics_of
from strandcast.core.box import Box
from strandcast.core.objectives import Objective, PointInSpace, PointObjective
from strandcast.dynamics.model import StringModel

# Least step of the simulation in a search: single precision and this step are four times as fast, and the tip
# is some hundredths of a millimetre away.
ROUGH_STEP_S = 2e-3

HIT_THE_TARGET = PointObjective()

AnyDynamics = PlanarDynamics | SpatialDynamics


Task = TypeVar("Task", bound="AnyTask")


@dataclass(frozen=True, eq=False)
class AnyTask(ABC):
    """Hit a target with the tip of a string on an arm: in the plane (`PlanningTask`) or in space.

    Attributes
    ----------
    arm, model
        The arm and the fixed properties of its string.
    target_m
        (2 or 3,) the target in the world frame [m].
    hit_radius_m
        A miss up to this is a hit [m].
    """

    arm: AnyArm
    model: StringModel
    target_m: np.ndarray
    hit_radius_m: float

    @property
    @abstractmethod
    def aim(self) -> Objective:
        """The objective with the target."""

    @abstractmethod
    def box(self) -> np.ndarray:
        """Return the workspace as (2 or 3, 2): low and high of each coordinate [m]."""

    @property
    def dynamics(self) -> AnyDynamics:
        """The arm's dynamics, if its torques are limited."""
        return self._dynamics() if np.isfinite(self.arm.limits.torque_n_m).any() else NO_DYNAMICS

    @abstractmethod
    def _dynamics(self) -> AnyDynamics:
        """Return the arm's dynamics."""

    @property
    def step_s(self) -> float:
        """Time between the motion's points [s]."""
        return 1.0 / self.arm.log_rate_hz

    def rough(self: Task) -> Task:
        """Return the task with the string in single precision and with steps of at least `ROUGH_STEP_S`."""
        model = replace(self.model, precision="f32", dt_s=max(self.model.dt_s, ROUGH_STEP_S))
        return replace(self, model=model)

    @property
    def hanging_m(self) -> float:
        """Greatest distance of the string from the hand, the part inside the clamp included [m]."""
        return self.model.length_m + self.arm.clamp.clamped_length_m


@dataclass(frozen=True, eq=False)
class PlanningTask(AnyTask):
    """Hit a target with the tip of a string on an arm in the plane, or reach another objective with it.

    Attributes
    ----------
    workspace
        The box that hand and string must not leave.
    objective
        The throw's objective; by default, the tip hits the target.
    price_stops
        Whether a search also keeps arm and string in the arm's workspace if the arm is stopped on the way.
    """

    arm: Arm
    workspace: Box
    objective: Objective = HIT_THE_TARGET
    price_stops: bool = False

    @property
    def aim(self) -> Objective:
        """The objective with the target."""
        return self.objective.aimed_at((self.target_m[0], self.target_m[1]))

    def _dynamics(self) -> PlanarDynamics:
        return dynamics_of(self.arm)

    def box(self) -> np.ndarray:
        """Return the workspace as (2, 2): low and high of x and y [m]."""
        return np.array([self.workspace.x_m, self.workspace.y_m])


@dataclass(frozen=True, eq=False)
class SpatialTask(AnyTask):
    """Hit a target anywhere in space; the workspace is the arm's."""

    arm: SpatialArm

    @property
    def aim(self) -> Objective:
        """The objective with the target."""
        if len(self.target_m) != 3:
            raise ValueError(f"target_m: {len(self.target_m)} coordinates; a target in space has x, y and z")
        x, y, z = map(float, self.target_m)
        return PointInSpace(target_m=(x, y, z))

    def _dynamics(self) -> SpatialDynamics:
        return spatial_dynamics_of(self.arm)

    def box(self) -> np.ndarray:
        """Return the workspace as (3, 2): low and high of x, y and z [m]."""
        return self.arm.workspace_m
