"""The hand's path: cubic Hermite between the given samples, and the hand's motion at every step."""

import math
from typing import Any

import numpy as np
from numba import njit

from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import CACHED, INLINED

# Values of `drive` per step.
VX, VY, COS, SIN, RATE, DVX, DVY, DRATE, X, Y = range(10)
DRIVING = 10


@njit(**CACHED)
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
        out[0] = out[1] = (value[1] - value[0]) / (time_s[1] - time_s[0])
        return
    for k in range(1, last):
        before = time_s[k] - time_s[k - 1]
        after = time_s[k + 1] - time_s[k]
        rise_before = (value[k] - value[k - 1]) / before
        rise_after = (value[k + 1] - value[k]) / after
        out[k] = (after * rise_before + before * rise_after) / (before + after)
    out[0] = 2.0 * (value[1] - value[0]) / (time_s[1] - time_s[0]) - out[1]
    out[last] = 2.0 * (value[last] - value[last - 1]) / (time_s[last] - time_s[last - 1]) - out[last - 1]


@njit(**INLINED)
def interpolate(time_s: Array, pose: Array, slope: Array, knot: int, t: float, out: Array) -> int:
    """Write the pose at time t, not before knot number `knot`, into `out`; return the knot before it."""
    while knot < len(time_s) - 2 and time_s[knot + 1] <= t:
        knot += 1
    width = time_s[knot + 1] - time_s[knot]
    s = (t - time_s[knot]) / width
    for c in range(len(out)):
        y0, y1 = pose[knot, c], pose[knot + 1, c]
        d0, d1 = slope[c, knot] * width, slope[c, knot + 1] * width
        out[c] = y0 + s * (d0 + s * (3.0 * (y1 - y0) - 2.0 * d0 - d1 + s * (2.0 * (y0 - y1) + d0 + d1)))
    return knot


@njit(**CACHED)
def drive(time_s: Array, pose: Array, h: float, steps: int, lane: int, out: Any) -> None:
    """Write the hand's motion at every step into column `lane` of `out` (steps * DRIVING, width).

    Velocity (VX, VY) and turn RATE in the middle of the step before, COS and SIN of the hand's angle now, the
    change of the rates to the middle of the step ahead, and the place (X, Y) at the step's end. The rates are
    those that move the hand from step to step; at the start its own. The hand rests at its last pose after
    the last sample.

    Parameters
    ----------
    time_s
        (T,) increasing times [s]; the first step begins at the first.
    pose
        (T, 3) x, y [m] and unwrapped angle [rad].
    h, steps
        Step [s] and their number.
    """
    slope = np.empty((3, len(time_s)))
    for c in range(3):
        slopes(time_s, pose[:, c], slope[c])
    knot: Any = np.int64(0)  # a literal would have `interpolate` compiled twice
    ahead, after = np.empty(3), np.empty(3)
    before, here = np.empty(3), np.empty(3)
    for c in range(3):
        before[c], here[c] = slope[c, 0], pose[0, c]
    for k in range(steps):
        t = min(time_s[0] + (k + 1) * h, time_s[-1])
        knot = interpolate(time_s, pose, slope, knot, t, after)
        r = k * DRIVING
        out[r + COS, lane], out[r + SIN, lane] = math.cos(here[2]), math.sin(here[2])
        for c in range(3):
            ahead[c] = (after[c] - here[c]) / h
            here[c] = after[c]
        out[r + VX, lane], out[r + VY, lane], out[r + RATE, lane] = before[0], before[1], before[2]
        out[r + DVX, lane] = ahead[0] - before[0]
        out[r + DVY, lane] = ahead[1] - before[1]
        out[r + DRATE, lane] = ahead[2] - before[2]
        out[r + X, lane], out[r + Y, lane] = here[0], here[1]
        for c in range(3):
            before[c] = ahead[c]


@njit(**CACHED)
def places(time_s: Array, pose: Array, wanted_s: Array, out: Array) -> None:
    """Places of the hand at increasing times `wanted_s` (F,), into `out` (F, 2 or 3) [m]."""
    slope = np.empty((out.shape[1], len(time_s)))
    for c in range(out.shape[1]):
        slopes(time_s, pose[:, c], slope[c])
    knot: Any = np.int64(0)
    for f in range(len(wanted_s)):
        knot = interpolate(time_s, pose, slope, knot, min(wanted_s[f], time_s[-1]), out[f])
