"""Throw many motions with many strings in the simulation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from strandcast.arm.servo import Servo, respond
from strandcast.motion.bars import bar_radii, bars
from strandcast.motion.bezier import Curve, Samples, sample
from strandcast.motion.objective import Assessment, Throws, assess
from strandcast.motion.paths import Paths
from strandcast.motion.strings import Strings
from strandcast.motion.task import Task
from strandcast.string.simulate import simulate_batch

ROUGH_STRIDE = 4  # samples at which a search looks at bends and places
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


@njit(cache=True, parallel=True)
def hand_poses(
    q: np.ndarray,
    zero_rad: np.ndarray,
    longer_m: np.ndarray,
    angles_rad: np.ndarray,
    signs: np.ndarray,
    lengths_m: np.ndarray,
    origin_m: np.ndarray,
    offset_m: np.ndarray,
    clamp_rad: float,
) -> np.ndarray:
    """Return the hand's poses (P * K, T, 3) of joint paths (P, T, J) with K strings.

    Parameters
    ----------
    zero_rad
        (K, J) added to the joints' angles [rad].
    longer_m
        (K,) a longer string hangs out further: the hand of the nominal one is further out [m].
    angles_rad, signs, lengths_m, origin_m, offset_m, clamp_rad
        Of the chain and the clamp, see `strandcast.arm.kinematics`.
    """
    paths, count, joints = q.shape
    strings = len(longer_m)
    poses = np.empty((paths * strings, count, 3))
    for b in prange(paths * strings):
        p, k = b // strings, b % strings
        for t in range(count):
            angle, x, y = 0.0, origin_m[0], origin_m[1]
            cos, sin = 1.0, 0.0
            for j in range(joints):
                angle += angles_rad[j] + signs[j] * (q[p, t, j] + zero_rad[k, j])
                cos, sin = math.cos(angle), math.sin(angle)
                x, y = x + lengths_m[j] * cos, y + lengths_m[j] * sin
            x, y = x + offset_m[0] * cos - offset_m[1] * sin, y + offset_m[0] * sin + offset_m[1] * cos
            angle += clamp_rad
            poses[b, t, 0] = x + longer_m[k] * math.cos(angle)
            poses[b, t, 1] = y + longer_m[k] * math.sin(angle)
            poses[b, t, 2] = angle
    return poses


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
    chain, clamp = task.arm.chain, task.arm.clamp
    zeros = strings.joint_zero_rad if strings.joint_zero_rad.size else np.zeros((len(strings), q.shape[2]))
    poses = hand_poses(
        np.ascontiguousarray(q), zeros, strings.longer_m, chain.angles_rad, chain.signs.astype(float),
        chain.lengths_m, np.asarray(chain.origin_m, float), np.asarray(clamp.offset_m, float),
        clamp.angle_rad,
    )  # fmt: skip
    points, _ = simulate_batch(
        task.model,
        np.tile(strings.parameters, (len(q), 1)),
        np.tile(strings.masses, (len(q), 1)),
        time_s,
        poses,
        time_s,
        world.start_m,
        rest_curl_rad_m=np.tile(strings.curl_rad_m, len(q)),
        clamp_offset_rad=np.tile(strings.clamp_offset_rad, len(q)),
        bend_factor=np.tile(strings.bend_factor, (len(q), 1)),
        bend_friction=np.tile(strings.bend_friction, len(q)),
        sway=np.tile(strings.sway, (len(q), 1)),
    )
    return Thrown(time_s, points, bars(task.arm, q), last)


def throw_curves(task: Task, strings: Strings, world: World, curves: list[Curve]) -> Thrown:
    """Simulate motions, the servo's response included, with every string."""
    time_s, q, last = commands([sample(curve, task.step_s) for curve in curves], task.step_s)
    if world.servo is not None:
        q = respond(world.servo, time_s, q)
    return throw(task, strings, world, q, last)


def throw_paths(task: Task, strings: Strings, world: World, paths: Paths) -> Thrown:
    """Simulate motions side by side, sampled until the end of the miss's window, with every string."""
    time_s = np.arange(paths.q.shape[1]) * task.step_s
    q = paths.q if world.servo is None else respond(world.servo, time_s, paths.q)
    return throw(task, strings, world, q, paths.last + round(AFTER_END_S / task.step_s))


def throws_of(task: Task, thrown: Thrown, shift_m: np.ndarray | None = None) -> Throws:
    """Return throws as an objective sees them; `shift_m` (B, T, 2) is added to the tip."""
    points = thrown.points_m
    if shift_m is None:
        shift_m = np.zeros((len(points), points.shape[1], 2))
    last = np.repeat(thrown.last, len(points) // len(thrown.last))
    return Throws(points, np.ascontiguousarray(shift_m), last, task.step_s, task.model.spacing_m)


def assessed(
    task: Task, thrown: Thrown, shift_m: np.ndarray | None = None, clearance_m: float = 0.0
) -> Assessment:
    """Assess throws by the task's objective; `shift_m` (B, T, 2) is added to the tip."""
    return assess(
        task.goal,
        throws_of(task, thrown, shift_m),
        thrown.bars_m,
        bar_radii(task.arm, clearance_m),
        task.box(),
        ROUGH_STRIDE if task.model.precision == "f32" else 1,
    )
