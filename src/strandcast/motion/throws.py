"""Throw many motions with many strings in the simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.servo import Servo, respond
from strandcast.motion.bars import bar_radii, bars
from strandcast.motion.bezier import Curve, Samples, sample
from strandcast.motion.objective import Assessment, assess
from strandcast.motion.strings import Strings
from strandcast.motion.task import Task
from strandcast.string.simulate import simulate_batch

AFTER_END_S = 0.3  # the miss's window ends this long after the motion


@dataclass(frozen=True, eq=False)
class World:
    """What the throws have in common beside the strings.

    Attributes
    ----------
    servo
        Response of the joints, None where they follow exactly.
    start_m
        (n, 2) where the string's points 1…n are at the start [m], None for hanging at rest.
    """

    servo: Servo | None = None
    start_m: np.ndarray | None = None


class Thrown(NamedTuple):
    """P motions thrown with K strings each: B = P * K, motion by motion.

    Attributes
    ----------
    time_s
        (T,) from the motion's start.
    points_m
        (B, T, n+1, 2).
    bars_m
        (P, T, S, 2, 2) of the arm.
    last
        (P,) last sample of the miss's window.
    """

    time_s: np.ndarray
    points_m: np.ndarray
    bars_m: np.ndarray
    last: np.ndarray


def commands(motions: list[Samples], step_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time (T,), commanded angles (P, T, J), held at the end, the last sample of each window (P,)."""
    after = round(AFTER_END_S / step_s)
    ends = np.array([len(motion.time_s) for motion in motions])
    count = int(ends.max()) + after
    q = np.empty((len(motions), count, motions[0].q.shape[1]))
    for p, motion in enumerate(motions):
        q[p, : ends[p]] = motion.q
        q[p, ends[p] :] = motion.q[-1]
    return np.arange(count) * step_s, q, ends - 1 + after


def throw(task: Task, strings: Strings, world: World, q: np.ndarray, last: np.ndarray) -> Thrown:
    """Simulate joint paths with every string.

    Parameters
    ----------
    q
        (P, T, J) angles that the joints take [rad].
    last
        (P,) last sample of each window.
    """
    time_s = np.arange(q.shape[1], dtype=np.float64) * task.step_s
    pose = hand_pose(task.arm.chain, task.arm.clamp, q)[:, None]
    # A longer string hangs out further: the hand of the nominal one is further out.
    out = strings.longer_m[:, None, None] * np.stack([np.cos(pose[..., 2]), np.sin(pose[..., 2])], axis=-1)
    poses = np.broadcast_to(pose, (len(q), len(strings), *pose.shape[2:])).copy()
    poses[..., :2] += out
    points, _ = simulate_batch(
        task.model,
        np.tile(strings.parameters, (len(q), 1)),
        np.tile(strings.masses, (len(q), 1)),
        time_s,
        poses.reshape(-1, len(time_s), 3),
        time_s,
        world.start_m,
        rest_curl_rad_m=np.tile(strings.curl_rad_m, len(q)),
        clamp_offset_rad=np.tile(strings.clamp_offset_rad, len(q)),
        bend_factor=np.tile(strings.bend_factor, (len(q), 1)),
        bend_friction=np.tile(strings.bend_friction, len(q)),
    )
    return Thrown(time_s, points, bars(task.arm, q), last)


def throw_curves(task: Task, strings: Strings, world: World, curves: list[Curve]) -> Thrown:
    """Simulate motions, the servo's response included, with every string."""
    time_s, q, last = commands([sample(curve, task.step_s) for curve in curves], task.step_s)
    if world.servo is not None:
        q = respond(world.servo, time_s, q)
    return throw(task, strings, world, q, last)


def assessed(
    task: Task, thrown: Thrown, shift_m: np.ndarray | None = None, clearance_m: float = 0.0
) -> Assessment:
    """Assess throws; `shift_m` (B, T, 2) is added to the tip."""
    if shift_m is None:
        shift_m = np.broadcast_to(0.0, (*thrown.points_m.shape[:2], 2))
    return Assessment(
        *assess(
            thrown.points_m,
            np.ascontiguousarray(shift_m),
            thrown.bars_m,
            bar_radii(task.arm, clearance_m),
            thrown.last,
            np.asarray(task.target_m, float),
            task.box(),
            task.model.spacing_m,
            task.step_s,
        )
    )
