"""Candidates as the kernels take them: coefficients and start of each, in the columns of work arrays."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.dynamics.elements import (
    ALONG,
    BEND_AT_REST,
    C_MORE,
    C_PH,
    C_S,
    C_SH,
    CLAMP_OFFSET,
    CLAMP_TURN,
    COEFFICIENTS,
    DRAG_1,
    DRAG_2,
    DRAG_ALONG,
    DRY,
    FLOOR,
    FRICTION,
    GRAVITY,
    K_MORE,
    K_PH,
    K_S,
    K_SH,
    PER_STICK,
    REST_BEND,
    SPACING,
    STICK,
    STICKING,
    SWAY,
    SWAY_RATE,
)
from strandcast.dynamics.equilibrium import hanging, respaced
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import CACHED, INLINED
from strandcast.dynamics.step import STABLE, stretch_damping
from strandcast.dynamics.string_state import ReadyStrings, StepSettings
from strandcast.threads import over_ranges

HANGING, RESPACED, AS_GIVEN, SETTLED = range(4)


class Candidates(NamedTuple):
    """B candidates.

    Attributes
    ----------
    parameters, masses, factor
        (B, 10), (B, n) of points 1…n, (B, n) multipliers of bending at joints 0…n-1.
    fixed
        (B, FIXED) columns as listed in `strandcast.dynamics.elements`.
    shift_m
        (B, 2 or 3) what is added to the simulated points before they are compared [m].
    """

    parameters: Array
    masses: Array
    factor: Array
    fixed: Array
    shift_m: Array


class StartArrays(NamedTuple):
    """How strings start; (n, 2 or 3) positions [m] and velocities [m/s] of points 1…n.

    In space there are no positions of strings that hang.
    """

    mode: int
    points_m: Array
    velocity_m_s: Array


def columns_of(candidates: Candidates, coefficients: int) -> ReadyStrings:
    """Return candidates in columns, at rest; their coefficients and segments are not yet filled in."""
    (count, n), axes = candidates.masses.shape, candidates.shift_m.shape[1]
    rows = (candidates.masses, candidates.factor, candidates.shift_m)
    mass, factor, shift = (np.ascontiguousarray(each.T) for each in rows)
    d, v = np.empty((axes * n, count)), np.zeros((axes * (n + 1), count))
    return ReadyStrings(np.zeros((coefficients, count)), mass, factor, d, v, shift)


def ready(candidates: Candidates, poses: Array, start: StartArrays, settings: StepSettings) -> ReadyStrings:
    """Return what steps need of candidates on the hand's paths `poses` (1 or B, T, 3)."""
    strings, step, reading = columns_of(candidates, COEFFICIENTS), settings.step, settings.reading
    over_ranges(
        len(candidates.masses),
        lambda first, last: _prepare(first, last, candidates, poses, start, reading, step, strings),
    )
    return strings


@njit(**INLINED)
def put_coefficients(p: Array, m: Array, fixed: Array, step: float, c: Array) -> None:
    """Write the coefficients of one candidate but those of its rest shape into `c` (COEFFICIENTS or more,).

    `p` (10,) parameters, `m` (n,) masses, `fixed` (FIXED or more,) columns, `step` [s].
    """
    lightest = m[0]
    for i in range(1, len(m)):
        lightest = min(lightest, m[i])
    c[K_S], c[C_S] = p[0], p[1] + stretch_damping(p[0], step, lightest)
    c[K_SH], c[K_MORE] = p[4], p[2] - p[4]
    c[C_SH], c[C_MORE] = p[5], p[3] - p[5]
    c[DRAG_1], c[DRAG_2], c[K_PH], c[C_PH] = p[6], p[7], p[8], p[9]
    c[FLOOR], c[FRICTION], c[ALONG] = STABLE * lightest, fixed[DRY], fixed[DRAG_ALONG]
    c[STICKING], c[PER_STICK] = 0.0, 0.0
    if fixed[STICK] > 0.0:
        c[FRICTION], c[STICKING], c[PER_STICK] = 0.0, fixed[DRY], 1.0 / fixed[STICK]


@njit(nogil=True, **CACHED)
def _prepare(
    first: int,
    last: int,
    candidates: Candidates,
    poses: Array,
    start: StartArrays,
    reading: int,
    step: float,
    strings: ReadyStrings,
) -> None:
    """Fill the columns `first` to `last` of the strings."""
    n, c, d, v = candidates.masses.shape[1], strings.c, strings.d, strings.v
    x = np.empty((n + 1, 2))
    for b in range(first, last):
        p, m, fixed = candidates.parameters[b], candidates.masses[b], candidates.fixed[b]
        pose = poses[b if len(poses) > 1 else 0, 0]
        put_coefficients(p, m, fixed, step, c[:, b])
        c[REST_BEND, b], c[CLAMP_OFFSET, b] = fixed[BEND_AT_REST], fixed[CLAMP_TURN]
        if start.mode == HANGING:
            hanging(pose, p, m, candidates.factor[b], fixed, reading, x)
        elif start.mode == RESPACED:
            respaced(pose, start.points_m, p, m, fixed[SPACING], fixed[GRAVITY], x)
        else:
            x[0, 0], x[0, 1] = pose[0], pose[1]
            for i in range(n):
                x[i + 1, 0], x[i + 1, 1] = start.points_m[i, 0], start.points_m[i, 1]
        cos, sin, rate = math.cos(fixed[SWAY]), math.sin(fixed[SWAY]), fixed[SWAY_RATE]
        away_x, away_y = 0.0, 0.0
        for i in range(n):
            along, across = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
            dx, dy = cos * along - sin * across, sin * along + cos * across
            away_x, away_y = away_x + dx, away_y + dy
            d[2 * i, b], d[2 * i + 1, b] = dx, dy
            v[2 * i + 2, b] = start.velocity_m_s[i, 0] - rate * away_y
            v[2 * i + 3, b] = start.velocity_m_s[i, 1] + rate * away_x
