"""Candidates through time: the loop over steps, and what is observed on the way."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

from strandcast.string.elements import (
    C_MORE,
    C_PH,
    C_S,
    C_SH,
    CLAMP_OFFSET,
    COEFFICIENTS,
    DRAG_1,
    DRAG_2,
    FLOOR,
    FRICTION,
    K_MORE,
    K_PH,
    K_S,
    K_SH,
    REST_BEND,
)
from strandcast.string.explicit import explicit_step
from strandcast.string.hand import COS, DRATE, DRIVING, DVX, DVY, RATE, SIN, VX, VY, X, drive
from strandcast.string.implicit import ROWS, STABLE, kick_and_drift, stretch_damping
from strandcast.string.lanes import (
    CACHED,
    INLINED,
    all_of,
    flush_denormals,
    inverse_root,
    load,
    maximum,
    minimum,
    root,
    select,
    splat,
    store,
)
from strandcast.string.parameters import Array
from strandcast.string.rest import hanging, respaced

LFCN, SEMI_IMPLICIT, EULER = range(3)
HANGING, RESPACED, AS_GIVEN = range(3)
FAR_M = 100.0
UNSEEN = 1e9  # greater than any length

# What is noted of each candidate beside its positions, and of that, what is kept.
LONGEST, SHORTEST, VALUE, MISS, MISS_AT, LAST_X, LAST_Y = range(7)
NOTED, KEPT = 7, 5

_LINE = 64  # bytes of a cache line


@njit(**INLINED)
def _rows(count: int, like: Any) -> Any:
    """Work array (count, width) that begins on a cache line, so that vectors do not straddle two."""
    width = like.shape[1]
    flat = np.empty(count * width + _LINE, like.dtype)
    first = (-flat.ctypes.data % _LINE) // like.itemsize
    return flat[first : first + count * width].reshape((count, width))


@njit(**INLINED)
def _hand(kind: Any, path: Any, own: bool, k: int) -> tuple[Any, Any, Any, Any, Any, Any, Any, Any]:
    """Return the hand at step k, each candidate's own or the same for all."""
    r = k * DRIVING
    if own:
        return (
            load(kind, path, r + VX),
            load(kind, path, r + VY),
            load(kind, path, r + COS),
            load(kind, path, r + SIN),
            load(kind, path, r + RATE),
            load(kind, path, r + DVX),
            load(kind, path, r + DVY),
            load(kind, path, r + DRATE),
        )
    return (
        splat(kind, path[r + VX, 0]),
        splat(kind, path[r + VY, 0]),
        splat(kind, path[r + COS, 0]),
        splat(kind, path[r + SIN, 0]),
        splat(kind, path[r + RATE, 0]),
        splat(kind, path[r + DVX, 0]),
        splat(kind, path[r + DVY, 0]),
        splat(kind, path[r + DRATE, 0]),
    )


@njit(**CACHED)
def _prepare(
    pose: Array,
    kind_of_start: int,
    start: Array,
    start_velocity: Array,
    p: Array,
    m: Array,
    factor: Array,
    fixed: Array,
    reading: int,
    step: float,
    lane: int,
    c: Any,
    mass: Any,
    factors: Any,
    d: Any,
    v: Any,
) -> None:
    """Coefficients and start of one candidate, into column `lane`."""
    n = len(m)
    lightest = np.min(m)
    c[K_S, lane], c[C_S, lane] = p[0], p[1] + stretch_damping(p[0], step, lightest)
    c[K_SH, lane], c[K_MORE, lane] = p[4], p[2] - p[4]
    c[C_SH, lane], c[C_MORE, lane] = p[5], p[3] - p[5]
    c[DRAG_1, lane], c[DRAG_2, lane], c[K_PH, lane], c[C_PH, lane] = p[6], p[7], p[8], p[9]
    c[REST_BEND, lane], c[CLAMP_OFFSET, lane], c[FLOOR, lane] = fixed[1], fixed[2], STABLE * lightest
    c[FRICTION, lane] = fixed[5]
    x = np.empty((n + 1, 2))
    if kind_of_start == HANGING:
        hanging(pose, p, m, factor, fixed, reading, x)
    elif kind_of_start == RESPACED:
        respaced(pose, start, p, m, fixed[0], fixed[3], x)
    else:
        x[0, 0], x[0, 1] = pose[0], pose[1]
        x[1:] = start
    cos, sin, rate = math.cos(fixed[6]), math.sin(fixed[6]), fixed[7]
    v[0, lane], v[1, lane] = 0.0, 0.0
    away_x, away_y = 0.0, 0.0
    for i in range(n):
        mass[i, lane], factors[i, lane] = m[i], factor[i]
        along, across = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
        dx, dy = cos * along - sin * across, sin * along + cos * across
        away_x, away_y = away_x + dx, away_y + dy
        d[2 * i, lane], d[2 * i + 1, lane] = dx, dy
        v[2 * i + 2, lane] = start_velocity[i, 0] - rate * away_y
        v[2 * i + 3, lane] = start_velocity[i, 1] + rate * away_x


@njit(**INLINED)
def _place(
    kind: Any, n: int, s: float, step: float, share: float, d: Any, v: Any, dv: Any, place: Any
) -> None:
    """Points 1…n relative to the hand at the step's end, at part `s` of the step: a parabola in time."""
    back, bent = (s - 1.0) * step, 0.5 * s / share
    x, y = splat(kind, 0.0), splat(kind, 0.0)
    for i in range(n):
        x += load(kind, d, 2 * i)
        y += load(kind, d, 2 * i + 1)
        vx, vy = load(kind, v, 2 * i + 2), load(kind, v, 2 * i + 3)
        store(kind, place, 2 * i, x + back * (vx + bent * load(kind, dv, 2 * i + 2)))
        store(kind, place, 2 * i + 1, y + back * (vy + bent * load(kind, dv, 2 * i + 3)))


@njit(**INLINED)
def _value(
    kind: Any, n: int, place: Any, seen: Any, per_metre: Any, x: float, y: float, shift: Any, kept: Any
) -> None:
    """Add one frame's share of E: weighted distances between the points seen and the simulated."""
    total = load(kind, kept, VALUE)
    sx, sy = load(kind, shift, 0), load(kind, shift, 1)
    for i in range(n):
        if per_metre[i] > 0.0:
            dx = load(kind, place, 2 * i) + (sx - (seen[i, 0] - x))
            dy = load(kind, place, 2 * i + 1) + (sy - (seen[i, 1] - y))
            squared = maximum(dx * dx + dy * dy, 1e-20)
            total += per_metre[i] * (squared * inverse_root(kind, squared))
    store(kind, kept, VALUE, total)


@njit(**INLINED)
def _miss(kind: Any, tx: Any, ty: Any, f: int, kept: Any) -> None:
    """Least distance between the target, here the origin, and the tip's path; straight between outputs."""
    if f == 0:
        store(kind, kept, LAST_X, tx)
        store(kind, kept, LAST_Y, ty)
    bx, by = load(kind, kept, LAST_X), load(kind, kept, LAST_Y)
    dx, dy = tx - bx, ty - by
    along = minimum(maximum(-(bx * dx + by * dy) / maximum(dx * dx + dy * dy, 1e-20), 0.0), 1.0)
    nx, ny = bx + along * dx, by + along * dy
    away = root(nx * nx + ny * ny)
    least = load(kind, kept, MISS)
    nearer = away < least
    store(kind, kept, MISS, select(nearer, away, least))
    store(kind, kept, MISS_AT, select(nearer, along + (f - 1.0), load(kind, kept, MISS_AT)))
    store(kind, kept, LAST_X, tx)
    store(kind, kept, LAST_Y, ty)


@njit(**INLINED)
def _scatter(place: Any, n: int, first: int, f: int, hand: Any, out: Any) -> None:
    """Write positions of all lanes to `out`; NaN where they are out of reach."""
    for lane in range(min(place.shape[1], len(out) - first)):
        x, y = hand[0, lane if hand.shape[1] > 1 else 0], hand[1, lane if hand.shape[1] > 1 else 0]
        for i in range(n):
            px, py = place[2 * i, lane], place[2 * i + 1, lane]
            near = math.fabs(px) < FAR_M and math.fabs(py) < FAR_M
            out[first + lane, f, i + 1, 0] = x + px if near else np.nan
            out[first + lane, f, i + 1, 1] = y + py if near else np.nan


@njit(**INLINED)
def _observe(
    kind: Any,
    k: int,
    f: int,
    step: float,
    d: Any,
    v: Any,
    dv: Any,
    place: Any,
    hand: Any,
    at: Array,
    seen: Array,
    per_metre: Array,
    shift: Any,
    target: Array,
    first: int,
    out: Array,
    noted: Any,
) -> None:
    """Output f, which falls into step k; `hand` (2, width or 1) is the hand's place at the step's end."""
    n, width = place.shape[0] // 2, place.shape[1]
    _place(kind, n, at[f] - k, step, 0.5 if k == 0 else 1.0, d, v, dv, place)
    if len(seen):
        _value(kind, n, place, seen[f], per_metre[f], hand[0, 0], hand[1, 0], shift, noted)
    own = hand.shape[1] > 1
    if len(target):
        tip = _rows(2, place)
        for lane in range(width):
            tip[0, lane] = place[2 * n - 2, lane] + (hand[0, lane if own else 0] - target[0])
            tip[1, lane] = place[2 * n - 1, lane] + (hand[1, lane if own else 0] - target[1])
        _miss(kind, load(kind, tip, 0), load(kind, tip, 1), f, noted)
    if len(out):
        _scatter(place, n, first, f, hand, out)


@njit(**CACHED)
def _prepare_all(
    first: int,
    p: Array,
    m: Array,
    factor: Array,
    fixed: Array,
    time_s: Array,
    pose: Array,
    kind_of_start: int,
    start: Array,
    start_velocity: Array,
    steps: int,
    step: float,
    reading: int,
    c: Any,
    mass: Any,
    factors: Any,
    d: Any,
    v: Any,
    path: Any,
) -> None:
    """Fill all lanes; those behind the last candidate repeat it."""
    own = len(pose) > 1
    for lane in range(mass.shape[1]):
        b = min(first + lane, len(p) - 1)
        here = pose[b if own else 0]
        _prepare(
            here[0], kind_of_start, start, start_velocity, p[b], m[b], factor[b], fixed[b], reading, step,
            lane, c, mass, factors, d, v,
        )  # fmt: skip
        if own:
            drive(time_s, here, step, steps, lane, path)


@njit(**CACHED)
def _keep(first: int, d: Any, noted: Any, kept: Array) -> None:
    """Write what was noted of each candidate; a state that is lost makes its longest segment infinite."""
    for lane in range(min(d.shape[1], len(kept) - first)):
        for k in range(KEPT):
            kept[first + lane, k] = noted[k, lane]
        for r in range(d.shape[0]):
            length = math.fabs(d[r, lane])
            if not length < FAR_M:
                kept[first + lane, LONGEST] = np.inf


@njit(**CACHED)
def _march(
    kind: Any,
    like: Any,
    first: int,
    p: Array,
    m: Array,
    factor: Array,
    fixed: Array,
    time_s: Array,
    pose: Array,
    common: Any,
    kind_of_start: int,
    start: Array,
    start_velocity: Array,
    steps: int,
    step: float,
    reading: int,
    scheme: int,
    at: Array,
    seen: Array,
    per_metre: Array,
    shift: Array,
    bound: float,
    target: Array,
    out: Array,
    kept: Array,
) -> None:
    """One vector of candidates from start to end; see `march`."""
    n, width, own = m.shape[1], like.shape[1], len(pose) > 1
    c, mass, factors = _rows(len(COEFFICIENTS), like), _rows(n, like), _rows(n, like)
    d, v, dv = _rows(2 * n, like), _rows(2 * n + 2, like), _rows(2 * n + 2, like)
    work, place, noted = _rows(ROWS * (n + 1), like), _rows(2 * n, like), _rows(NOTED, like)
    path, moved = _rows(steps * DRIVING if own else 1, like), _rows(2, like)
    hand_place = np.zeros((2, width if own else 1))
    _prepare_all(
        first, p, m, factor, fixed, time_s, pose, kind_of_start, start, start_velocity, steps, step, reading,
        c, mass, factors, d, v, path,
    )  # fmt: skip
    for lane in range(width):
        moved[:, lane] = shift[min(first + lane, len(p) - 1)]
    l0, gravity, per_width = fixed[0, 0], fixed[0, 3], 1.0 / fixed[0, 4]
    rubs = fixed[:, 5].max() > 0.0
    dv[:] = 0.0
    noted[:] = 0.0
    noted[SHORTEST : MISS + 1] = UNSEEN
    noted[VALUE] = 0.0
    control = flush_denormals(-1)
    f = 0
    for k in range(steps):
        hand = _hand(kind, path, True, k) if own else _hand(kind, common, False, k)
        if scheme == LFCN:
            longest, shortest = kick_and_drift(
                kind, n, c, mass, factors, hand, d, v, dv, work, step, 0.5 if k == 0 else 1.0, l0, gravity,
                reading, per_width, rubs,
            )  # fmt: skip
        else:
            longest, shortest = explicit_step(
                kind, n, c, mass, factors, hand, d, v, work, step, l0, gravity, reading, per_width, rubs,
                scheme == EULER,
            )  # fmt: skip
        store(kind, noted, LONGEST, maximum(longest, load(kind, noted, LONGEST)))
        store(kind, noted, SHORTEST, minimum(shortest, load(kind, noted, SHORTEST)))
        if f < len(at) and at[f] <= k + 1:
            r = k * DRIVING + X
            if own:
                hand_place[:] = path[r : r + 2]
            else:
                hand_place[:] = common[r : r + 2]
            while f < len(at) and at[f] <= k + 1:
                _observe(
                    kind, k, f, step, d, v, dv, place, hand_place, at, seen, per_metre, moved, target, first,
                    out, noted,
                )  # fmt: skip
                f += 1
            if bound < np.inf and all_of(load(kind, noted, VALUE) > bound):
                break
    flush_denormals(control)
    _keep(first, d, noted, kept)


@njit(parallel=True, **CACHED)
def march(
    kind: Any,
    like: Any,
    p: Array,
    m: Array,
    factor: Array,
    fixed: Array,
    time_s: Array,
    pose: Array,
    kind_of_start: int,
    start: Array,
    start_velocity: Array,
    steps: int,
    step: float,
    reading: int,
    scheme: int,
    at: Array,
    seen: Array,
    per_metre: Array,
    shift: Array,
    bound: float,
    target: Array,
    out: Array,
) -> Array:
    """Move B candidates, W side by side; the loop over such vectors runs on all cores.

    Parameters
    ----------
    kind, like
        `strandcast.string.lanes.Kind` of width W, and any array (…, W) of its dtype.
    p, m, factor
        (B, 10) parameters, (B, n) masses of points 1…n, (B, n) multipliers of bending at joints 0…n-1.
    fixed
        (B, 8) rest spacing [m], rest bend per joint [rad], clamp offset [rad], gravity [m/s^2], half-width of
        the switch, dry friction of a joint [N m/kg], turn of the start about the hand [rad], rate of that
        [rad/s]. First, fourth and fifth are the same for all.
    time_s, pose
        (T,) and (1 or B, T, 3): the hand's path, common or each candidate's own.
    kind_of_start, start, start_velocity
        HANGING, RESPACED or AS_GIVEN; (n, 2) positions [m] and velocities [m/s] of points 1…n.
    steps, step, reading, scheme
        Number and length [s] of steps, the reading, LFCN, SEMI_IMPLICIT or EULER.
    at
        (F,) increasing times of the outputs, in steps.
    seen, per_metre
        (F, n, 2) measured points and (F, n) their weights in E, or none; with a common hand only.
    shift
        (B, 2) what is added to the simulated points before they are compared [m].
    bound
        A vector of candidates stops when all its E are above.
    target
        (2,) for the miss of the tip [m], or none.
    out
        (B, F, n+1, 2) positions, of which those of points 1…n are written here, or none.

    Returns
    -------
    (B, KEPT) longest and shortest segment [m], infinite after a blow-up; E [m]; miss [m] and the output, with
    its fraction, at which it occurs.
    """
    kept = np.empty((len(p), KEPT))
    width = like.shape[1]
    common = np.empty((steps * DRIVING if len(pose) == 1 else 1, 1))
    if len(pose) == 1:
        drive(time_s, pose[0], step, steps, 0, common)
    for g in prange((len(p) + width - 1) // width):
        _march(
            kind, like, np.int64(g) * width, p, m, factor, fixed, time_s, pose, common, kind_of_start,
            start, start_velocity, steps, step, reading, scheme, at, seen, per_metre, shift, bound, target,
            out, kept,
        )  # fmt: skip
    return kept
