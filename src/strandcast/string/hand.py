"""The hand's path at every step: cubic Hermite between the given samples."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from strandcast.string.forces import KERNEL
from strandcast.string.parameters import Array

HAND_COLUMNS = 7  # x, y, vx, vy, cos and sin of the angle, angular rate


@njit(**KERNEL)
def slopes(time_s: Array, value: Array, out: Array) -> None:
    """Slope at each knot of the parabola through it and its neighbours (not-a-knot at the ends).

    Parameters
    ----------
    time_s, value
        (T,) knots and values, T ≥ 2.
    out
        (T,) filled here.
    """
    last = len(time_s) - 1
    if last == 1:
        out[:] = (value[1] - value[0]) / (time_s[1] - time_s[0])
        return
    for k in range(1, last):
        before = time_s[k] - time_s[k - 1]
        after = time_s[k + 1] - time_s[k]
        rise_before = (value[k] - value[k - 1]) / before
        rise_after = (value[k + 1] - value[k]) / after
        out[k] = (after * rise_before + before * rise_after) / (before + after)
    out[0] = 2.0 * (value[1] - value[0]) / (time_s[1] - time_s[0]) - out[1]
    out[last] = 2.0 * (value[last] - value[last - 1]) / (time_s[last] - time_s[last - 1]) - out[last - 1]


@njit(**KERNEL)
def hand_at_steps(time_s: Array, pose: Array, h: float, steps: int) -> Array:
    """Hand at times ``time_s[0] + k h``, k = 0…steps; it rests at its last pose after the last sample.

    Parameters
    ----------
    time_s
        (T,) increasing times [s].
    pose
        (T, 3) x, y [m] and unwrapped angle [rad].

    Returns
    -------
    (steps + 1, 7) x, y, vx, vy, cos, sin, angular rate.
    """
    slope = np.empty((3, len(time_s)))
    for c in range(3):
        slopes(time_s, pose[:, c], slope[c])
    out = np.empty((steps + 1, HAND_COLUMNS))
    knot = 0
    value = np.empty(3)
    rate = np.empty(3)
    for k in range(steps + 1):
        t = min(time_s[0] + k * h, time_s[-1])
        while knot < len(time_s) - 2 and time_s[knot + 1] <= t:
            knot += 1
        width = time_s[knot + 1] - time_s[knot]
        s = (t - time_s[knot]) / width
        moving = 1.0 if time_s[0] + k * h <= time_s[-1] else 0.0
        for c in range(3):
            y0, y1 = pose[knot, c], pose[knot + 1, c]
            d0, d1 = slope[c, knot] * width, slope[c, knot + 1] * width
            second = 3.0 * (y1 - y0) - 2.0 * d0 - d1
            third = 2.0 * (y0 - y1) + d0 + d1
            value[c] = y0 + s * (d0 + s * (second + s * third))
            rate[c] = moving * (d0 + s * (2.0 * second + 3.0 * s * third)) / width
        out[k, 0], out[k, 1] = value[0], value[1]
        out[k, 2], out[k, 3] = rate[0], rate[1]
        out[k, 4], out[k, 5] = math.cos(value[2]), math.sin(value[2])
        out[k, 6] = rate[2]
    return out
