"""One candidate string through time, by each of the named schemes."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from strandcast.string.forces import KERNEL, SEGMENT_COLUMNS, forces
from strandcast.string.implicit import damped_if_stiff, kick, padded
from strandcast.string.parameters import Array

LFCN, SEMI_IMPLICIT, EULER = range(3)
OK, BLEW_UP, OVERSTRETCHED = range(3)
FAR_M = 100.0
LONGEST = 3.0  # rest lengths of one segment


@njit(**KERNEL)
def _explicit_step(x: Array, v: Array, h: float, m: Array, force: Array, euler: bool) -> None:
    """Free points one step on; Euler moves them with the old velocity, the semi-implicit way with the new."""
    for i in range(1, len(x)):
        ax = force[i, 0] / m[i - 1]
        ay = force[i, 1] / m[i - 1]
        late = 0.0 if euler else h
        x[i, 0] += h * (v[i, 0] + late * ax)
        x[i, 1] += h * (v[i, 1] + late * ay)
        v[i, 0] += h * ax
        v[i, 1] += h * ay


@njit(**KERNEL)
def _copy(source: Array, target: Array) -> None:
    for i in range(len(source)):
        target[i, 0], target[i, 1] = source[i, 0], source[i, 1]


@njit(**KERNEL)
def _drift(x: Array, v: Array, h: float) -> None:
    for i in range(1, len(x)):
        x[i, 0] += h * v[i, 0]
        x[i, 1] += h * v[i, 1]


@njit(**KERNEL)
def _predict(v: Array, dv: Array, hand: Array, v_now: Array) -> None:
    """Velocities at the positions' time, half a step after `v`: extrapolated for the free points."""
    for i in range(1, len(v)):
        v_now[i, 0] = v[i, 0] + 0.5 * dv[i, 0]
        v_now[i, 1] = v[i, 1] + 0.5 * dv[i, 1]
    v_now[0, 0], v_now[0, 1] = hand[2], hand[3]


@njit(**KERNEL)
def _hand_change(hand: Array, k: int, change: Array) -> float:
    """Change of the hand's velocity and turn rate over the kick at step k, and the kick's share of a step.

    The first kick is half a step long: it brings the velocities from the start to the middle of the first
    step.
    """
    before = max(k - 1, 0)
    change[0] = 0.5 * (hand[k + 1, 2] - hand[before, 2])
    change[1] = 0.5 * (hand[k + 1, 3] - hand[before, 3])
    change[2] = 0.5 * (hand[k + 1, 6] - hand[before, 6])
    return 0.5 if k == 0 else 1.0


@njit(**KERNEL)
def _record(x: Array, old: Array, k: int, at: Array, done: int, out: Array) -> int:
    """Write the outputs that fall between steps k and k + 1, linear between them; how many are done."""
    while done < len(at) and at[done] <= k + 1:
        s = at[done] - k
        for i in range(len(x)):
            out[done, i, 0] = old[i, 0] + s * (x[i, 0] - old[i, 0])
            out[done, i, 1] = old[i, 1] + s * (x[i, 1] - old[i, 1])
        done += 1
    return done


@njit(**KERNEL)
def integrate(
    x: Array,
    v: Array,
    hand: Array,
    h: float,
    p: Array,
    m: Array,
    factor: Array,
    fixed: Array,
    reading: int,
    scheme: int,
    at: Array,
    out: Array,
) -> int:
    """Move the string along the hand's path and record it.

    Parameters
    ----------
    x, v
        (n+1, 2) start, changed here.
    hand
        (steps + 1, 7) the hand at every step.
    h
        Step [s].
    p, m, factor, fixed, reading
        See `strandcast.string.forces.forces`.
    scheme
        LFCN, SEMI_IMPLICIT or EULER.
    at
        (F,) increasing output times in steps, within [0, steps].
    out
        (F, n+1, 2) filled here; NaN from a blow-up on.

    Returns
    -------
    OK, OVERSTRETCHED (a segment was longer than 3 l0) or BLEW_UP.
    """
    n = len(m)
    lightest = np.min(m)
    if scheme == LFCN:
        p = damped_if_stiff(p, h, lightest)
    a, b = padded(n)
    seg = np.empty((n, SEGMENT_COLUMNS))
    joint, force, dv = np.zeros((n, 2)), np.empty((n + 1, 2)), np.zeros((n + 1, 2))
    old, v_now, change = np.empty((n + 1, 2)), v.copy(), np.empty(3)
    status, done = OK, 0
    for k in range(len(hand) - 1):
        v[0, 0], v[0, 1] = hand[k, 2], hand[k, 3]
        _copy(x, old)
        if scheme == LFCN:
            _predict(v, dv, hand[k], v_now)
        else:
            _copy(v, v_now)
        longest = forces(x, v, v_now, hand[k], p, m, factor, fixed, reading, seg, joint, force)
        if not longest < FAR_M:
            return _lost(out, done)
        if longest > LONGEST * fixed[0]:
            status = OVERSTRETCHED
        if scheme == LFCN:
            share = _hand_change(hand, k, change)
            kick(v, dv, change, share * h, p, m, lightest, fixed[0], seg, joint, force, a, b)
            _drift(x, v, h)
        else:
            _explicit_step(x, v, h, m, force, scheme == EULER)
        x[0, 0], x[0, 1] = hand[k + 1, 0], hand[k + 1, 1]
        done = _record(x, old, k, at, done, out)
    if not _near(x):
        return _lost(out, max(done - 1, 0))
    return status


@njit(**KERNEL)
def _near(x: Array) -> bool:
    """Whether all points are finite and within reach; false for NaN."""
    for i in range(len(x)):
        if not (math.fabs(x[i, 0] - x[0, 0]) < FAR_M and math.fabs(x[i, 1] - x[0, 1]) < FAR_M):
            return False
    return True


@njit(**KERNEL)
def _lost(out: Array, done: int) -> int:
    """Mark everything from output `done` on as unknown."""
    out[done:] = np.nan
    return BLEW_UP
