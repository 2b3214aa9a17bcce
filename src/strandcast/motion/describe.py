"""A found motion with what the simulation expects of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strandcast.arm.limits import peaks, violations
from strandcast.arm.reach import outside_m, reach_of
from strandcast.arm.weight import torque_gap
from strandcast.errors import StrandcastError
from strandcast.motion.bezier import Curve, Samples, sample
from strandcast.motion.cost import start_cost, throw_cost
from strandcast.motion.objective import Assessment
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import Thrown, assessed


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion and what is expected of it.

    Attributes
    ----------
    planner, kind
        ``ensemble`` or ``paper``; ``first``, ``refined`` (near an earlier motion) or ``replanned`` (anew).
    curve, motion
        The velocity curves, and the motion's points.
    strings
        The strings that it was planned with, the best first.
    objective
        What the throw is for, in words.
    miss_m, ensemble_miss_m
        Expected miss with the best string, and with every string (K,), undisturbed.
    disturbed_miss_m, hit_probability
        Expected misses of every string with every disturbance of the design, and the share of them that hit.
    cost_m
        The rms of these misses, and the price of lateness, folding, leaving, touching and hiding.
    hit_time_s, tip_speed_m_s, largest_bend_rad
        When and how fast the best string's tip comes nearest, and its largest bend until then.
    time_s, hand_m, tip_m
        (T,), (T, 2), (T, 2) expected paths until 0.3 s after the motion, what was carried over included.
    peaks
        Largest speed, acceleration, jerk, torque of each joint, by name.
    room_m
        Least distance of the hand and the best string to the workspace's edges, below 0 outside.
    parent_trial
        The trial whose motion was altered, None for a motion planned anew.
    simulations
        Throws simulated by the search.
    flags
        What a reader should know.
    """

    planner: str
    kind: str
    objective: str
    curve: Curve
    motion: Samples
    strings: Strings
    miss_m: float
    ensemble_miss_m: np.ndarray
    disturbed_miss_m: np.ndarray
    hit_probability: float
    cost_m: float
    hit_time_s: float
    tip_speed_m_s: float
    largest_bend_rad: float
    time_s: np.ndarray
    hand_m: np.ndarray
    tip_m: np.ndarray
    peaks: dict[str, np.ndarray]
    room_m: float
    parent_trial: int | None
    simulations: int
    flags: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Found:
    """What a planner found: the motion, how it came about, and with what it is to be described."""

    kind: str
    curve: Curve
    simulations: int
    flags: list[str]
    parent_trial: int | None = None


def described(
    task: Task,
    strings: Strings,
    options: Options,
    found: Found,
    throws: tuple[Thrown, np.ndarray | None],
    disturbed_miss_m: np.ndarray,
) -> Plan:
    """Return the plan with what the throws say of it; refuse a motion that breaks the arm's limits.

    Parameters
    ----------
    throws
        The motion thrown with every string, and what is carried over to the tips (K, T, 2).
    disturbed_miss_m
        The misses of every string with every disturbance.

    Raises
    ------
    StrandcastError
        SC-P006.
    """
    thrown, shift_m = throws
    motion = sample(found.curve, task.step_s)
    _refuse_violations(task, motion)
    told = assessed(task, thrown, shift_m, options.clearance_m)
    path = thrown.points_m[0, : thrown.last[0] + 1]
    return Plan(
        planner=options.planner,
        kind=found.kind,
        objective=str(task.goal),
        curve=found.curve,
        motion=motion,
        strings=strings,
        miss_m=float(told.miss_m[0]),
        ensemble_miss_m=told.miss_m,
        disturbed_miss_m=disturbed_miss_m,
        hit_probability=float(np.mean(disturbed_miss_m <= task.hit_radius_m)),
        cost_m=float(throw_cost(told, len(strings), task.step_s)[0]),
        hit_time_s=float(thrown.time_s[told.hit_index[0]]),
        tip_speed_m_s=float(told.tip_speed_m_s[0]),
        largest_bend_rad=float(np.arccos(np.clip(1.0 - told.fold[0], -1.0, 1.0))),
        time_s=thrown.time_s[: len(path)],
        hand_m=path[:, 0],
        tip_m=path[:, -1] + (0.0 if shift_m is None else shift_m[0, : len(path)]),
        peaks=peaks(task.arm, motion.time_s, motion.q, motion.qd, motion.qdd),
        room_m=_room_m(task, thrown.points_m[0, : len(path)]),
        parent_trial=found.parent_trial,
        simulations=found.simulations,
        flags=(*found.flags, *expectation_flags(task, found.curve, told, options.clearance_m)),
    )


def expectation_flags(task: Task, curve: Curve, told: Assessment, clearance_m: float) -> list[str]:
    """Say what the best string's throw leaves to be desired, and what any string's may spoil."""
    flags = _reach_flags(task, curve) + _torque_flags(task)
    if told.miss_m[0] > task.hit_radius_m:
        by = f"{1000 * told.miss_m[0]:.0f} mm"
        flags.append(f"not expected to hit: the best that was found within the arm's limits misses by {by}")
    for depth_m, words in (
        (told.outside_m, "may leave the workspace by {} mm"),
        (told.touch_m, "the string may come {} mm too near to the arm"),
        (told.hidden_m, "at the closest approach the tip may lie {} mm over the arm"),
    ):
        if depth_m.max() > 0.0:
            flags.append(words.format(math.ceil(1000 * depth_m.max())) + _how_many(depth_m > 0.0))
    if start_cost(task, curve.q0_rad[None], clearance_m)[0] > 0.0:
        flags.append("at the start the string hangs over the arm or out of the workspace")
    return flags


def _how_many(strings: np.ndarray) -> str:
    return "" if strings.all() else f", with {strings.sum()} of {len(strings)} strings"


def stopped_outside_m(task: Task, curve: Curve) -> float:
    """Return how far out of the arm's workspace arm or string may be if stopped at the worst instant [m]."""
    motion = sample(curve, task.step_s)
    moves = (motion.time_s, motion.q, motion.qd, motion.qdd)
    return outside_m(task.arm, reach_of(task.arm, *moves, task.hanging_m).swept_m)


def _reach_flags(task: Task, curve: Curve) -> list[str]:
    """Say what the player will refuse."""
    out_m = stopped_outside_m(task, curve)
    if out_m == 0.0:
        return []
    return [
        f"stopped at the worst instant, arm or string may be {1000 * out_m:.0f} mm out of the arm's workspace"
    ]


def _torque_flags(task: Task) -> list[str]:
    """Say that limits of torque, though wished for, hold nothing back."""
    wished = np.isfinite(task.arm.limits.torque_n_m).any()
    gap = torque_gap(task.arm) if wished else None
    return [] if gap is None else [gap]


def _room_m(task: Task, points_m: np.ndarray) -> float:
    low, high = task.box().T
    room = np.minimum(points_m - low, high - points_m)
    return float(room.min()) if np.isfinite(room).all() else 0.0


def _refuse_violations(task: Task, motion: Samples) -> None:
    found = violations(task.arm, motion.time_s, motion.q, motion.qd, motion.qdd)
    if found:
        raise StrandcastError(
            "SC-P006",
            "the motion that was found breaks the arm's limits: " + "; ".join(map(str, found)),
            file=task.arm.path,
            cost="the search found nothing within the limits: no motion is written",
            fix="allow longer motions (plan.duration_s) or more evaluations",
        )
