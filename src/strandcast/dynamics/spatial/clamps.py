"""Clamps that move in space: their poses, and their motion at every step."""

import math
from typing import Any

import numpy as np
from numba import njit

from strandcast.dynamics.hand import interpolate, slopes
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import CACHED

_REVERSED = 1e-9  # 1 + cosine of a turn: within 0.003 degrees of a half turn, its axis is not known (chosen)
POSE = 9  # columns of one clamp's pose: place, direction, normal

# Rows of `drive_clamps` per step and clamp, three each.
SPEED, CHANGE, ALONG_CLAMP, LEFT, UP, TURN_RATE, TURN_CHANGE, PLACE = range(0, 24, 3)
CLAMP = 24


def clamp_poses(place_m: Array, direction: Array) -> Array:
    """Return poses of a clamp if its roll about its own axis was not measured.

    The normals are transported along the path without spin about the direction.

    Parameters
    ----------
    place_m
        (T, 3) where the string leaves the clamp [m].
    direction
        (T, 3) in which the clamp holds the string, away from the clamp; any length above 0.

    Returns
    -------
    (T, 9) poses as `strandcast.dynamics.batch.HandPath` takes them.

    Raises
    ------
    ValueError
        For a direction that has no length or is not finite, or that is reversed from one sample to the next.
    """
    along = _of_length_one(direction)
    normal = np.empty_like(along)
    least = np.eye(3)[np.argmin(np.abs(along[0]))]
    normal[0] = np.cross(along[0], least)
    for k in range(1, len(along)):
        turned = 1.0 + along[k - 1] @ along[k]
        if turned < _REVERSED:
            raise ValueError(f"the clamp's direction is reversed at sample {k}: no normal follows from it")
        normal[k] = normal[k - 1] - (normal[k - 1] @ along[k]) / turned * (along[k - 1] + along[k])
    normal -= (normal * along).sum(axis=1, keepdims=True) * along
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.hstack([place_m, along, normal])


def _of_length_one(direction: Array) -> Array:
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    if not np.all((length > 0.0) & np.isfinite(length)):
        raise ValueError("a clamp's direction needs a finite length above 0 at every sample")
    return np.asarray(direction / length)


def hanging_clamp_poses(place_m: Array, direction: Array) -> Array:
    """Return the same as `clamp_poses` of a clamp that turns as little as its direction needs from downwards.

    The roll then depends on the direction alone, as that of a wrist that does not twist, and is the same in
    all recordings.

    Raises
    ------
    ValueError
        For a direction that has no length or is not finite, or that is straight up.
    """
    along, down = _of_length_one(direction), np.array([0.0, 0.0, -1.0])
    turned = 1.0 + along @ down
    if (turned < _REVERSED).any():
        raise ValueError("no least turn leads a clamp from downwards to straight up")
    normal = [1.0, 0.0, 0.0] - (along[:, :1] / turned[:, None]) * (along + down)
    return np.hstack([place_m, along, normal])


@njit(**CACHED)
def orthonormal(pose: Array, frame: Array) -> None:
    """Write direction, normal and their vector product (3, 3) of a pose (9,)."""
    length = math.sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2)
    for c in range(3):
        frame[0, c] = pose[3 + c] / length
    inside = pose[6] * frame[0, 0] + pose[7] * frame[0, 1] + pose[8] * frame[0, 2]
    length = 0.0
    for c in range(3):
        frame[1, c] = pose[6 + c] - inside * frame[0, c]
        length += frame[1, c] ** 2
    length = math.sqrt(length)
    for c in range(3):
        frame[1, c] /= length
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        frame[2, c] = frame[0, a] * frame[1, b] - frame[0, b] * frame[1, a]


@njit(**CACHED)
def _turn_between(before: Array, after: Array, turn: Array) -> None:
    """Write the rotation vector (3,) [rad] from one frame (3, 3) to another."""
    cosine, size = -0.5, 0.0
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        turn[c] = 0.0
        for e in range(3):
            turn[c] += 0.5 * (before[e, a] * after[e, b] - before[e, b] * after[e, a])
            cosine += 0.5 * before[e, c] * after[e, c]
        size += turn[c] ** 2
    size = math.sqrt(size)
    if size > 0.0:
        for c in range(3):
            turn[c] *= math.atan2(size, cosine) / size


@njit(**CACHED)
def _first_rate(pose: Array, slope: Array, rate: Array) -> None:
    """Write the clamp's own rate of turning (3,) [rad/s] at its first sample: the change within 1 us."""
    tick = 1e-6
    before, after = np.empty((3, 3)), np.empty((3, 3))
    moved = np.empty(POSE)
    for c in range(POSE):
        moved[c] = pose[c] + tick * slope[c]
    orthonormal(pose, before)
    orthonormal(moved, after)
    _turn_between(before, after, rate)
    for c in range(3):
        rate[c] /= tick


@njit(**CACHED)
def drive_clamps(time_s: Array, pose: Array, h: float, steps: int, lane: int, out: Any) -> None:
    """Write the clamps' motion at every step into column `lane` of `out` (steps * clamps * CLAMP, width).

    Velocity (SPEED) and turn rate in the middle of the step before, the changes of both to the middle of the
    step ahead, the frame (ALONG_CLAMP, LEFT, UP) now, and the place at the step's end; see
    `strandcast.dynamics.hand.drive`.

    Parameters
    ----------
    time_s
        (T,) increasing times [s]; the first step begins at the first.
    pose
        (T, 9 or 18) poses of one or two clamps.
    h, steps
        Step [s] and their number.
    """
    columns = pose.shape[1]
    slope = np.empty((columns, len(time_s)))
    for c in range(columns):
        slopes(time_s, pose[:, c], slope[c])
    now, after, ahead = np.empty((3, 3)), np.empty((3, 3)), np.empty(6)
    value = np.empty((2, columns))
    for end in range(columns // POSE):
        first = end * POSE
        own = slice(first, first + POSE)
        before = np.empty(6)
        before[:3] = slope[first : first + 3, 0]
        _first_rate(pose[0, own], np.ascontiguousarray(slope[own, 0]), before[3:])
        value[0] = pose[0]
        orthonormal(pose[0, own], now)
        knot: Any = np.int64(0)
        for k in range(steps):
            knot = interpolate(time_s, pose, slope, knot, min(time_s[0] + (k + 1) * h, time_s[-1]), value[1])
            orthonormal(value[1, own], after)
            _turn_between(now, after, ahead[3:])
            r = (k * (columns // POSE) + end) * CLAMP
            for c in range(3):
                ahead[c] = (value[1, first + c] - value[0, first + c]) / h
                ahead[3 + c] /= h
                out[r + SPEED + c, lane], out[r + CHANGE + c, lane] = before[c], ahead[c] - before[c]
                out[r + TURN_RATE + c, lane] = before[3 + c]
                out[r + TURN_CHANGE + c, lane] = ahead[3 + c] - before[3 + c]
                out[r + PLACE + c, lane] = value[1, first + c]
                out[r + ALONG_CLAMP + c, lane] = now[0, c]
                out[r + LEFT + c, lane] = now[1, c]
                out[r + UP + c, lane] = now[2, c]
            before[:] = ahead
            now[:] = after
            value[0] = value[1]
