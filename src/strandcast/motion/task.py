"""What a planner is given: the task, the strings it may be, and what it may spend."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.arm.dynamics import NO_DYNAMICS, PlanarDynamics, dynamics_of
from strandcast.arm.load import Arm, Box
from strandcast.errors import StrandcastError
from strandcast.motion.objective import Objective, Places
from strandcast.motion.objectives import Point
from strandcast.string.model import StringModel

ROUGH_STEP_S = 2e-3


@dataclass(frozen=True, eq=False)
class Task:
    """Hit a target with the tip of a string on an arm, or reach another objective with it.

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
    objective
        What the throw is for, None: the tip hits the target.
    price_stops
        Whether a search is to keep arm and string in the arm's workspace also where the arm is stopped.
    """

    arm: Arm
    model: StringModel
    target_m: np.ndarray
    hit_radius_m: float
    workspace: Box
    objective: Objective | None = None
    price_stops: bool = False

    @property
    def goal(self) -> Objective:
        """What the throw is for."""
        return (
            Point((float(self.target_m[0]), float(self.target_m[1])))
            if self.objective is None
            else self.objective
        )

    @property
    def dynamics(self) -> PlanarDynamics:
        """What the arm's torques come from, nothing where they have no limit."""
        return dynamics_of(self.arm) if np.isfinite(self.arm.limits.torque_n_m).any() else NO_DYNAMICS

    @property
    def step_s(self) -> float:
        """Time between the motion's points [s]."""
        return 1.0 / self.arm.log_rate_hz

    def rough(self) -> Task:
        """Return the task with the string in single precision and steps as long as its samples' distance.

        Four times as fast; the tip is some hundredths of a millimetre away.
        """
        model = replace(self.model, precision="f32", dt_s=max(self.model.dt_s, ROUGH_STEP_S))
        return replace(self, model=model)

    @property
    def hanging_m(self) -> float:
        """How far from the hand the string may be, what the clamp swallows included, as the player has it."""
        return self.model.length_m + self.arm.clamp.swallowed_m

    def box(self) -> np.ndarray:
        """Return the workspace as (2, 2): low and high of x and y [m]."""
        return np.array([self.workspace.x_m, self.workspace.y_m])


@dataclass(frozen=True)
class PaperReading:
    """How section V is read where its text allows more than one way.

    Attributes
    ----------
    altered_from
        Whose heights a later motion's tries alter: ``executed``, those of the motion thrown last, or
        ``walking``, those of the nearest try so far.
    accept
        ``first_hit``: the search ends with the first simulated hit; ``best``: all tries are made, the nearest
        is thrown.
    ends
        ``ramp``: eq. 1 leaves the last height free, and a ramp stops the arm; ``rest``: two heights at
        either end are zero, as an arm with limited jerk needs it.
    altered_rad_s
        How far a try alters a height.
    largest_slope_rad_s2
        The slopes alpha_k of eq. 1 are uniform within this; not given in the paper.
    """

    altered_from: str = "executed"
    accept: str = "first_hit"
    ends: str = "ramp"
    altered_rad_s: float = 0.5
    largest_slope_rad_s2: float = 60.0


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
        Motions that a first motion's searches may try; a later one's may try two thirds as many.
    members
        Strings that new motions are searched with, those given in turn, each with other disturbances.
    use_servo
        Plan with the servo's response, not with the commanded angles.
    disturbances
        Size of what differs from throw to throw, 1 as usual; predictions reckon with it too.
    finer
        Whether every other string of a search for a new motion is a chain of twice as many points.
    carry_residual
        Whether what the simulation missed by in earlier throws is added to a later one's.
    largest_acceleration_rad_s2
        Of the random slopes alpha_k of eq. 1.
    paper
        Readings of the paper's own planner.
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
    screening: int = 1500
    evaluations: int = 3000
    members: int = 16
    use_servo: bool = True
    disturbances: float = 1.0
    carry_residual: bool = True
    finer: bool = True
    largest_acceleration_rad_s2: float = 60.0
    paper: PaperReading = PaperReading()
    change_cost_m_s_rad: float = 0.008
    replan_from_E_m: float = 0.008
    replan_from_miss_m: float = 0.020
    clearance_m: float = 0.035


def refuse_unreachable(task: Task) -> None:
    """Refuse what no throw can reach, telling how near it gets.

    Raises
    ------
    StrandcastError
        A place is beyond arm and string, or outside the workspace.
    """
    for places in task.goal.places():
        _refuse_place(task, places)


def _refuse_place(task: Task, places: Places) -> None:
    chain, box = task.arm.chain, task.box()
    along_m = min(places.along_m, task.model.length_m)
    reach_m = float(chain.lengths_m.sum() + np.hypot(*task.arm.clamp.offset_m) + along_m)
    away_m = float(np.linalg.norm(places.alternatives_m - chain.origin_m, axis=1).min())
    field = "target_m" if isinstance(task.goal, Point) else "objective"
    if away_m > reach_m:
        raise StrandcastError(
            "SC-P002",
            f"the target is {away_m:.3f} m from the arm's first joint; arm and string reach {reach_m:.3f} m",
            field=field,
            cost=f"no throw comes nearer than {away_m - reach_m:.3f} m",
            fix="move the target, or take a longer string",
        )
    out = np.maximum(box[:, 0] - places.alternatives_m, places.alternatives_m - box[:, 1])
    out_m = float(out.max(axis=1).min())
    if out_m > 0.0:
        raise StrandcastError(
            "SC-P003",
            f"the target lies {out_m:.3f} m outside the workspace x {box[0].tolist()}, y {box[1].tolist()} m",
            field=field,
            fix="move the target, or widen workspace_m",
        )
