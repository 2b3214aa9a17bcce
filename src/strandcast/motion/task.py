"""What a planner is given: the task, the strings it may be, and what it may spend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.arm.load import Arm, Box
from strandcast.errors import StrandcastError
from strandcast.string.model import StringModel


@dataclass(frozen=True, eq=False)
class Task:
    """Hit a target with the tip of a string on an arm.

    Attributes
    ----------
    arm, model
        The arm and what is fixed about its string.
    target_m
        (2,) the target in the world frame [m].
    hit_radius_m
        A miss up to this is a hit [m].
    workspace
        The box that hand and string must not leave.
    """

    arm: Arm
    model: StringModel
    target_m: np.ndarray
    hit_radius_m: float
    workspace: Box

    @property
    def step_s(self) -> float:
        """Time between the motion's points [s]."""
        return 1.0 / self.arm.log_rate_hz

    def box(self) -> np.ndarray:
        """Return the workspace as (2, 2): low and high of x and y [m]."""
        return np.array([self.workspace.x_m, self.workspace.y_m])


@dataclass(frozen=True)
class Options:
    """What a planner may spend, and its tastes.

    Attributes
    ----------
    planner
        ``ensemble`` or ``paper``.
    duration_s
        Shortest and longest time of a first motion [s].
    free_heights
        Free control heights of each joint.
    screening
        Random motions tried before the search of a first motion; of the paper's planner, all that it may try.
    evaluations
        Motions that a first motion's searches may try; a later one's may try half as many.
    members
        Fitted strings that a later motion is searched with; a first one is, with all that are given.
    use_servo
        Plan with the servo's response, not with the commanded angles.
    largest_acceleration_rad_s2
        Of the random slopes alpha_k of eq. 1.
    altered_rad_s
        How far the paper's planner alters a height for a later motion.
    change_cost_m_s_rad
        Price of changing a later motion's heights [m per rad/s rms].
    replan_from_E_m, replan_from_miss_m
        A later motion is planned anew if both the first fit's E and the least miss so far are above these.
    clearance_m
        How near to the middle of the arm's links the string may come [m].
    """

    planner: str = "ensemble"
    duration_s: tuple[float, float] = (0.35, 0.9)
    free_heights: int = 6
    screening: int = 480
    evaluations: int = 800
    members: int = 4
    use_servo: bool = True
    largest_acceleration_rad_s2: float = 60.0
    altered_rad_s: float = 0.5
    change_cost_m_s_rad: float = 0.008
    replan_from_E_m: float = 0.008
    replan_from_miss_m: float = 0.020
    clearance_m: float = 0.035


def refuse_unreachable(task: Task) -> None:
    """Refuse a target that no throw can reach, telling how near it gets.

    Raises
    ------
    StrandcastError
        The target is beyond arm and string, or outside the workspace.
    """
    chain = task.arm.chain
    reach_m = float(chain.lengths_m.sum() + np.hypot(*task.arm.clamp.offset_m) + task.model.length_m)
    away_m = float(np.hypot(*(task.target_m - chain.origin_m)))
    if away_m > reach_m:
        raise StrandcastError(
            "SC-P002",
            f"the target is {away_m:.3f} m from the arm's first joint; arm and string reach {reach_m:.3f} m",
            field="target_m",
            cost=f"no throw comes nearer than {away_m - reach_m:.3f} m",
            fix="move the target, or take a longer string",
        )
    box = task.box()
    out_m = float(np.max([box[:, 0] - task.target_m, task.target_m - box[:, 1]]))
    if out_m > 0.0:
        raise StrandcastError(
            "SC-P003",
            f"the target lies {out_m:.3f} m outside the workspace x {box[0].tolist()}, y {box[1].tolist()} m",
            field="target_m",
            fix="move the target, or widen workspace_m",
        )
