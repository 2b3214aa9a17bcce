"""Forces on the points of the string: the equations of the model, one function per element.

All functions are numba kernels on plain arrays in SI units. Segment j joins points j and j + 1 (the paper's
segment j + 1). The hand is one row: x, y, vx, vy, cos and sin of its angle, angular rate.
"""

from __future__ import annotations

import math

from numba import njit

from strandcast.string.parameters import Array

# Columns of the work array that `forces` fills for each segment.
UX, UY, LENGTH, PULL, RATE, RATE_NOW = range(6)
SEGMENT_COLUMNS = 6

RATE_READING, SIGN_READING, STRAIN_READING = range(3)

KERNEL = {"cache": True, "error_model": "numpy", "fastmath": {"contract"}}


@njit(**KERNEL)
def blend(switch: float) -> float:
    """Share of the h parameters: 0 at -1 and below, 1 at 1 and above, smooth between."""
    t = min(max(0.5 + 0.5 * switch, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@njit(**KERNEL)
def switch_value(reading: int, bend: float, rate: float, pull: float, weight: float) -> float:
    """Quantity whose sign chooses h (positive) or sh (negative), before division by the switch width.

    Parameters
    ----------
    reading
        Which reading of the paper's "compression" and "tensile" direction.
    bend, rate
        Bend from rest [rad] and its rate [rad/s].
    pull
        Mean spring force of the two segments [N/kg], positive in tension.
    weight
        Weight of the point [N/kg].
    """
    if reading == RATE_READING:
        return bend * rate
    if reading == SIGN_READING:
        return bend
    return -pull / weight


@njit(**KERNEL)
def segments(x: Array, v: Array, v_now: Array, k_s: float, l0: float, seg: Array) -> float:
    """Geometry, spring force and turn rates of all segments, into `seg`.

    Parameters
    ----------
    x, v
        (n+1, 2) positions [m] and velocities [m/s] that the dampers act on.
    v_now
        (n+1, 2) velocities at the time of the positions, for the switch between h and sh.
    seg
        (n, 6) filled here: unit vector, length, spring force, turn rate by `v` and by `v_now`.

    Returns
    -------
    Length of the longest segment [m]; NaN if any is NaN.
    """
    longest = 0.0
    for j in range(len(seg)):
        dx = x[j + 1, 0] - x[j, 0]
        dy = x[j + 1, 1] - x[j, 1]
        length = math.sqrt(dx * dx + dy * dy)
        ux = dx / length
        uy = dy / length
        seg[j, UX] = ux
        seg[j, UY] = uy
        seg[j, LENGTH] = length
        seg[j, PULL] = k_s * (length - l0)
        seg[j, RATE] = (ux * (v[j + 1, 1] - v[j, 1]) - uy * (v[j + 1, 0] - v[j, 0])) / length
        seg[j, RATE_NOW] = (
            ux * (v_now[j + 1, 1] - v_now[j, 1]) - uy * (v_now[j + 1, 0] - v_now[j, 0])
        ) / length
        if not length <= longest:
            longest = length
    return longest


@njit(**KERNEL)
def forces(
    x: Array,
    v: Array,
    v_now: Array,
    hand: Array,
    p: Array,
    m: Array,
    factor: Array,
    fixed: Array,
    reading: int,
    seg: Array,
    joint: Array,
    force: Array,
) -> float:
    """Force per nominal point mass on every point.

    Parameters
    ----------
    x, v, v_now
        See `segments`.
    hand
        (7,) the hand now.
    p, m
        (10,) parameters, (n,) relative masses.
    factor
        (n,) multiplier of bending at joints 0…n-1.
    fixed
        (5,) rest spacing [m], rest bend per joint [rad], clamp offset [rad], gravity [m/s^2], switch width.
    reading
        See `switch_value`.
    seg, joint, force
        Filled here: (n, 6) segments, (n, 2) bending stiffness and damping at joints 0…n-1, (n+1, 2) forces
        [N/kg].

    Returns
    -------
    Length of the longest segment [m].
    """
    n = len(m)
    longest = segments(x, v, v_now, p[0], fixed[0], seg)
    force[0, 0] = 0.0
    force[0, 1] = 0.0
    for i in range(1, n + 1):
        speed = math.sqrt(v[i, 0] * v[i, 0] + v[i, 1] * v[i, 1])
        drag = p[6] + p[7] * speed
        force[i, 0] = -drag * v[i, 0]
        force[i, 1] = -drag * v[i, 1] - m[i - 1] * fixed[3]
    for j in range(n):
        ux = seg[j, UX]
        uy = seg[j, UY]
        stretching = (v[j + 1, 0] - v[j, 0]) * ux + (v[j + 1, 1] - v[j, 1]) * uy
        axial = seg[j, PULL] + p[1] * stretching
        force[j + 1, 0] -= axial * ux
        force[j + 1, 1] -= axial * uy
        force[j, 0] += axial * ux
        force[j, 1] += axial * uy
    _clamp_moment(hand, p, factor[0], fixed[2], seg, joint, force)
    for i in range(1, n):
        _bend_moment(i, p, m[i - 1], factor[i], fixed, reading, seg, joint, force)
    return longest


@njit(**KERNEL)
def _clamp_moment(
    hand: Array, p: Array, factor: float, offset: float, seg: Array, joint: Array, force: Array
) -> None:
    """Torsion spring and damper between the hand and the first segment."""
    cross = hand[4] * seg[0, UY] - hand[5] * seg[0, UX]
    dot = hand[4] * seg[0, UX] + hand[5] * seg[0, UY]
    angle = math.atan2(cross, dot) - offset
    joint[0, 0] = factor * p[8]
    joint[0, 1] = factor * p[9]
    moment = joint[0, 0] * angle + joint[0, 1] * (seg[0, RATE] - hand[6])
    push = moment / seg[0, LENGTH]
    force[1, 0] += push * seg[0, UY]
    force[1, 1] -= push * seg[0, UX]


@njit(**KERNEL)
def _bend_moment(
    i: int,
    p: Array,
    mass: float,
    factor: float,
    fixed: Array,
    reading: int,
    seg: Array,
    joint: Array,
    force: Array,
) -> None:
    """Torsion spring and damper at inner point i, between segments i - 1 and i."""
    ax, ay, bx, by = seg[i - 1, UX], seg[i - 1, UY], seg[i, UX], seg[i, UY]
    bend = math.atan2(ax * by - ay * bx, ax * bx + ay * by) - fixed[1]
    pull = 0.5 * (seg[i - 1, PULL] + seg[i, PULL])
    choice = switch_value(reading, bend, seg[i, RATE_NOW] - seg[i - 1, RATE_NOW], pull, mass * fixed[3])
    share = blend(choice / fixed[4])
    stiffness = factor * (p[4] + (p[2] - p[4]) * share)
    damping = factor * (p[5] + (p[3] - p[5]) * share)
    joint[i, 0] = stiffness
    joint[i, 1] = damping
    moment = stiffness * bend + damping * (seg[i, RATE] - seg[i - 1, RATE])
    before = moment / seg[i - 1, LENGTH]
    after = moment / seg[i, LENGTH]
    # f = -M * gradient of the bend, which is n / l of the nearer segment on i - 1 and i + 1, minus both on i.
    force[i - 1, 0] += before * ay
    force[i - 1, 1] -= before * ax
    force[i + 1, 0] += after * by
    force[i + 1, 1] -= after * bx
    force[i, 0] -= before * ay + after * by
    force[i, 1] += before * ax + after * bx
