"""Time integration of candidates in space: the loop over steps, and the outputs on the way."""

import math
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from strandcast.dynamics.integrate import ANY_LENGTH_M, keep_results
from strandcast.dynamics.observe import FAR_M, LONGEST, RESULTS, SHORTEST, VALUE, Outputs
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import (
    CACHED,
    INLINED,
    flush_denormals,
    inverse_root,
    load,
    maximum,
    minimum,
    splat,
    store,
)
from strandcast.dynamics.spatial.clamps import (
    ALONG_CLAMP,
    CHANGE,
    CLAMP,
    LEFT,
    PLACE,
    POSE,
    SPEED,
    TURN_CHANGE,
    TURN_RATE,
    UP,
    drive_clamps,
)
from strandcast.dynamics.spatial.step import (
    SPATIAL_COEFFICIENTS,
    SPATIAL_ROWS,
    ClampMotion,
    SpatialSettings,
    step_in_space,
)
from strandcast.dynamics.spatial.triples import dot, load3, minus, plus, plus_scaled, store3, zero3
from strandcast.dynamics.string_state import StringArrays, StringMotion
from strandcast.dynamics.vectors import VectorSpec

_LINE = 64  # bytes of a cache line


class SpatialStrings(NamedTuple):
    """B candidates in the columns of the vectors.

    Attributes
    ----------
    c
        (SPATIAL_COEFFICIENTS, B) rows as listed in `strandcast.dynamics.spatial.step`.
    mass, factor
        (n, B) masses of points 1…n and multipliers of bending at joints 0…n-1.
    d, v
        (3n, B) segments [m] and (3n + 3, B) velocities [m/s] at the start.
    shift
        (3, B) added to the points before they are compared [m].
    """

    c: Array
    mass: Array
    factor: Array
    d: Array
    v: Array
    shift: Array


class SpatialWorkspace(NamedTuple):
    """Work arrays of one thread, each of W columns, that begin on cache lines."""

    string: StringArrays
    motion: StringMotion
    step: Any
    place: Any
    results: Any
    shift: Any
    path: Any
    hand_place: Array


def spatial_workspace(spec: VectorSpec, n: int, own_rows: int, *, sticks: bool = False) -> SpatialWorkspace:
    """Return work arrays for strings of n points.

    `own_rows` of the clamps' path of each lane, or 0; `sticks`: with the state of friction that sticks.
    """
    sizes = (
        *(SPATIAL_COEFFICIENTS, n, n, 3 * n, 3 * n + 3, 3 * n + 3),
        *(SPATIAL_ROWS * (n + 1), 3 * n, RESULTS, 3, max(own_rows, 1), 4 * (n + 1) * sticks),
    )
    flat = np.zeros(sum(sizes) * spec.width + _LINE, spec.dtype)
    first = (-flat.ctypes.data % _LINE) // flat.itemsize
    rows = flat[first : first + sum(sizes) * spec.width].reshape(-1, spec.width)
    parts = [rows[start:end] for start, end in pairwise(accumulate(sizes, initial=0))]
    c, mass, factor, d, v, dv, step, place, results, shift, path, stick = parts
    hand_place = np.empty((3, spec.width if own_rows else 1))
    string, motion = StringArrays(n, c, mass, factor), StringMotion(d, v, dv, stick if sticks else None)
    return SpatialWorkspace(string, motion, step, place, results, shift, path, hand_place)


@njit(**INLINED)
def _copy_lanes(first: int, given: Any, rows: Any) -> None:
    """Fill all lanes from candidate `first` on; those after the last candidate repeat it."""
    for lane in range(rows.shape[1]):
        b = min(first + lane, given.shape[1] - 1)
        for row in range(rows.shape[0]):
            rows[row, lane] = given[row, b]


@njit(**INLINED)
def _row3(spec: Any, path: Any, common: Any, own: bool, row: int) -> Any:
    """Return three rows of each candidate's own path, or of the common one."""
    if own:
        return load3(spec, path, row)
    return splat(spec, common[row, 0]), splat(spec, common[row + 1, 0]), splat(spec, common[row + 2, 0])


@njit(**INLINED)
def _clamp(spec: Any, path: Any, common: Any, own: bool, r: int) -> ClampMotion:
    """Return the clamp with the rows from r on."""
    frame = (
        _row3(spec, path, common, own, r + ALONG_CLAMP),
        _row3(spec, path, common, own, r + LEFT),
        _row3(spec, path, common, own, r + UP),
    )
    return ClampMotion(
        _row3(spec, path, common, own, r + SPEED),
        _row3(spec, path, common, own, r + CHANGE),
        frame,
        _row3(spec, path, common, own, r + TURN_RATE),
        _row3(spec, path, common, own, r + TURN_CHANGE),
    )


@njit(**INLINED)
def _observe(
    spec: Any,
    k: int,
    f: int,
    settings: SpatialSettings,
    motion: StringMotion,
    place: Any,
    hand: Array,
    outputs: Outputs,
    shift: Any,
    first: int,
    results: Any,
) -> None:
    """Output f, which falls into step k; `hand` (3, width or 1) is the first clamp at the step's end."""
    d, v, dv, _ = motion
    n = d.shape[0] // 3
    back = (outputs.at[f] - k - 1.0) * settings.step
    bent = 0.5 * (outputs.at[f] - k) * settings.step / settings.kick
    x = zero3(spec)
    for i in range(n):
        x = plus(x, load3(spec, d, 3 * i))
        speed = plus_scaled(load3(spec, v, 3 * i + 3), bent, load3(spec, dv, 3 * i + 3))
        store3(spec, place, 3 * i, plus_scaled(x, back, speed))
    if len(outputs.measured):
        total = load(spec, results, VALUE)
        moved = load3(spec, shift, 0)
        for i in range(n):
            weight = outputs.per_metre[f, i]
            if weight > 0.0:
                seen = outputs.measured[f, i]
                at = (
                    splat(spec, seen[0] - hand[0, 0]),
                    splat(spec, seen[1] - hand[1, 0]),
                    splat(spec, seen[2] - hand[2, 0]),
                )
                off = minus(plus(load3(spec, place, 3 * i), moved), at)
                squared = maximum(dot(off, off), 1e-20)
                total += weight * (squared * inverse_root(spec, squared))
        store(spec, results, VALUE, total)
    if len(outputs.out):
        for lane in range(min(place.shape[1], len(outputs.out) - first)):
            for i in range(n):
                near = True
                for c in range(3):
                    near = near and math.fabs(place[3 * i + c, lane]) < FAR_M
                for c in range(3):
                    at_m = hand[c, lane if hand.shape[1] > 1 else 0] + place[3 * i + c, lane]
                    outputs.out[first + lane, f, i + 1, c] = at_m if near else np.nan


@njit(**INLINED)
def _of_step(settings: SpatialSettings, k: int) -> SpatialSettings:
    """Return the settings of step k: the first kick is half as long."""
    kick = 0.5 * settings.step if k == 0 else settings.step
    return SpatialSettings(
        settings.step,
        kick,
        kick * kick / 12.0,
        kick * kick / 4.0,
        0.5 * kick,
        settings.gravity,
        settings.reading,
        settings.per_width,
        settings.has_friction,
        settings.slender,
        settings.two_ends,
        settings.helical,
    )


@njit(**INLINED)
def _load_strings(
    spec: Any,
    first: int,
    strings: SpatialStrings,
    string: StringArrays,
    motion: StringMotion,
    shift: Any,
    results: Any,
) -> None:
    """Fill all lanes from candidate `first` on, without results."""
    _copy_lanes(first, strings.c, string.c)
    _copy_lanes(first, strings.mass, string.mass)
    _copy_lanes(first, strings.factor, string.factor)
    _copy_lanes(first, strings.d, motion.d)
    _copy_lanes(first, strings.shift, shift)
    _copy_lanes(first, strings.v, motion.v)
    for row in range(motion.dv.shape[0]):
        store(spec, motion.dv, row, splat(spec, 0.0))
    store(spec, results, LONGEST, splat(spec, 0.0))
    store(spec, results, SHORTEST, splat(spec, ANY_LENGTH_M))
    store(spec, results, VALUE, splat(spec, 0.0))


@njit(nogil=True, **CACHED)
def integrate_in_space(
    first: int,
    last: int,
    spec: Any,
    work: SpatialWorkspace,
    strings: SpatialStrings,
    hand: Any,
    common: Any,
    steps: int,
    settings: SpatialSettings,
    outputs: Outputs,
    kept: Array,
) -> None:
    """Simulate vectors of W candidates each, the `first` to before the `last` of all.

    Parameters
    ----------
    spec, work
        `strandcast.dynamics.vectors.VectorSpec` of width W, and the `spatial_workspace` of this thread.
    hand
        (T,) times [s] and (1 or B, T, 9 or 18) poses: the clamps' path, common or each candidate's own.
    common
        A common path as `strandcast.dynamics.spatial.clamps.drive_clamps` gives it, else any array.
    steps, settings
        Number of steps, and those of a whole step.
    strings, outputs, kept
        See there, and `strandcast.dynamics.integrate.integrate`.
    """
    time_s, poses = hand
    string, motion, step_work, place, results, shift, path, hand_place = work
    width, own, at = results.shape[1], len(poses) > 1, outputs.at
    ends = poses.shape[2] // POSE
    control = flush_denormals(-1)
    for g in range(first, last):
        b = g * width
        _load_strings(spec, b, strings, string, motion, shift, results)
        if own:
            for lane in range(width):
                drive_clamps(time_s, poses[min(b + lane, len(poses) - 1)], settings.step, steps, lane, path)
        f: Any = np.int64(0)  # a literal would have `_observe` compiled twice
        for k in range(steps):
            row = k * ends * CLAMP
            clamp = _clamp(spec, path, common, own, row)
            far = _clamp(spec, path, common, own, row + (ends - 1) * CLAMP)
            now = _of_step(settings, k)
            longest, shortest = step_in_space(spec, string, motion, clamp, far, step_work, now)
            store(spec, results, LONGEST, maximum(longest, load(spec, results, LONGEST)))
            store(spec, results, SHORTEST, minimum(shortest, load(spec, results, SHORTEST)))
            while f < len(at) and at[f] <= k + 1:
                for lane in range(hand_place.shape[1]):
                    for axis in range(3):
                        r = row + PLACE + axis
                        hand_place[axis, lane] = path[r, lane] if own else common[r, 0]
                _observe(spec, k, f, now, motion, place, hand_place, outputs, shift, b, results)
                f += 1
        keep_results(b, motion.d, results, kept)
    flush_denormals(control)
