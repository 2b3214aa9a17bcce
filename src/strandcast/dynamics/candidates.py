"""Candidates as the kernels take them: coefficients and start of each, in the columns of work arrays."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from strandcast.dynamics.elements import (
    BEND_AT_REST,
    C_MORE,
    C_PH,
    C_S,
    C_SH,
    CLAMP_OFFSET,
    CLAMP_TURN,
    DRAG_1,
    DRAG_2,
    DRY,
    FLOOR,
    FRICTION,
    GRAVITY,
    K_MORE,
    K_PH,
    K_S,
    K_SH,
    REST_BEND,
    SPACING,
    SWAY,
    SWAY_RATE,
)
from strandcast.dynamics.equilibrium import hanging, respaced
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.schemes.lfcn import STABLE, stretch_damping
from strandcast.dynamics.schemes.scheme import StringArrays, StringMotion
from strandcast.dynamics.simd import CACHED, INLINED

HANGING, RESPACED, AS_GIVEN = range(3)

_LINE = 64  # bytes of a cache line


class Candidates(NamedTuple):
    """B candidates.

    Attributes
    ----------
    parameters, masses, factor
        (B, 10), (B, n) of points 1…n, (B, n) multipliers of bending at joints 0…n-1.
    fixed
        (B, FIXED) columns as listed in `strandcast.dynamics.elements`.
    shift_m
        (B, 2) what is added to the simulated points before they are compared [m].
    """

    parameters: Array
    masses: Array
    factor: Array
    fixed: Array
    shift_m: Array


class StartArrays(NamedTuple):
    """HANGING, RESPACED or AS_GIVEN; (n, 2) positions [m] and velocities [m/s] of points 1…n."""

    mode: int
    points_m: Array
    velocity_m_s: Array


@njit(**INLINED)
def work_rows(count: int, like: Any) -> Any:
    """Work array (count, width) that begins on a cache line, so that vectors do not straddle two."""
    width = like.shape[1]
    flat = np.empty(count * width + _LINE, like.dtype)
    first = (-flat.ctypes.data % _LINE) // like.itemsize
    return flat[first : first + count * width].reshape((count, width))


@njit(**CACHED)
def _prepare(
    candidates: Candidates,
    b: int,
    pose: Array,
    start: StartArrays,
    reading: int,
    step: float,
    lane: int,
    string: StringArrays,
    motion: StringMotion,
) -> None:
    """Write coefficients and start of candidate b, from the hand's first pose (3,), into column `lane`."""
    p, m, fixed = candidates.parameters[b], candidates.masses[b], candidates.fixed[b]
    factor = candidates.factor[b]
    n, c, d, v = len(m), string.c, motion.d, motion.v
    lightest = np.min(m)
    c[K_S, lane], c[C_S, lane] = p[0], p[1] + stretch_damping(p[0], step, lightest)
    c[K_SH, lane], c[K_MORE, lane] = p[4], p[2] - p[4]
    c[C_SH, lane], c[C_MORE, lane] = p[5], p[3] - p[5]
    c[DRAG_1, lane], c[DRAG_2, lane], c[K_PH, lane], c[C_PH, lane] = p[6], p[7], p[8], p[9]
    c[REST_BEND, lane], c[CLAMP_OFFSET, lane] = fixed[BEND_AT_REST], fixed[CLAMP_TURN]
    c[FLOOR, lane], c[FRICTION, lane] = STABLE * lightest, fixed[DRY]
    x = np.empty((n + 1, 2))
    if start.mode == HANGING:
        hanging(pose, p, m, factor, fixed, reading, x)
    elif start.mode == RESPACED:
        respaced(pose, start.points_m, p, m, fixed[SPACING], fixed[GRAVITY], x)
    else:
        x[0, 0], x[0, 1] = pose[0], pose[1]
        x[1:] = start.points_m
    cos, sin, rate = math.cos(fixed[SWAY]), math.sin(fixed[SWAY]), fixed[SWAY_RATE]
    v[0, lane], v[1, lane] = 0.0, 0.0
    away_x, away_y = 0.0, 0.0
    for i in range(n):
        string.mass[i, lane], string.factor[i, lane] = m[i], factor[i]
        along, across = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
        dx, dy = cos * along - sin * across, sin * along + cos * across
        away_x, away_y = away_x + dx, away_y + dy
        d[2 * i, lane], d[2 * i + 1, lane] = dx, dy
        v[2 * i + 2, lane] = start.velocity_m_s[i, 0] - rate * away_y
        v[2 * i + 3, lane] = start.velocity_m_s[i, 1] + rate * away_x


@njit(**CACHED)
def prepare_vector(
    candidates: Candidates,
    first: int,
    poses: Array,
    start: StartArrays,
    reading: int,
    step: float,
    string: StringArrays,
    motion: StringMotion,
    shift: Any,
) -> None:
    """Fill all lanes from candidate `first` on; those after the last candidate repeat it."""
    for lane in range(shift.shape[1]):
        b = min(first + lane, len(candidates.masses) - 1)
        pose = poses[b if len(poses) > 1 else 0, 0]
        _prepare(candidates, b, pose, start, reading, step, lane, string, motion)
        shift[:, lane] = candidates.shift_m[b]
