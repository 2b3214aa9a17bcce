"""Time integration of candidates: the loop over steps, and the outputs on the way."""

import math
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from strandcast.dynamics.elements import COEFFICIENTS
from strandcast.dynamics.hand import COS, DRATE, DRIVING, DVX, DVY, RATE, SIN, VX, VY, X, drive
from strandcast.dynamics.observe import FAR_M, LONGEST, RESULTS, SHORTEST, VALUE, Outputs, observe
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import CACHED, INLINED, flush_denormals, load, maximum, minimum, splat, store
from strandcast.dynamics.spatial.step import SPATIAL_COEFFICIENTS, SPATIAL_ROWS
from strandcast.dynamics.step import advance
from strandcast.dynamics.string_state import (
    ROWS,
    ReadyStrings,
    StepSettings,
    StringArrays,
    StringMotion,
    at_step,
)
from strandcast.dynamics.vectors import VectorSpec

ANY_LENGTH_M = 1e9  # greater than any length
_LINE = 64  # bytes of a cache line


@njit(**INLINED)
def path_row(spec: Any, path: Any, common: Any, own: bool, row: int) -> Any:
    """Return one row of each candidate's own path, or of the common one."""
    if own:
        return load(spec, path, row)
    return splat(spec, common[row, 0])


@njit(**INLINED)
def _hand(
    spec: Any, path: Any, common: Any, own: bool, r: int
) -> tuple[Any, Any, Any, Any, Any, Any, Any, Any]:
    """Return the hand with the rows from r on."""
    return (
        path_row(spec, path, common, own, r + VX),
        path_row(spec, path, common, own, r + VY),
        path_row(spec, path, common, own, r + COS),
        path_row(spec, path, common, own, r + SIN),
        path_row(spec, path, common, own, r + RATE),
        path_row(spec, path, common, own, r + DVX),
        path_row(spec, path, common, own, r + DVY),
        path_row(spec, path, common, own, r + DRATE),
    )


@njit(**INLINED)
def put_hand_place(path: Any, common: Any, own: bool, row: int, place: Array) -> None:
    """Write the hand's place from the rows from `row` on (2 or 3, width or 1)."""
    for lane in range(place.shape[1]):
        for axis in range(place.shape[0]):
            place[axis, lane] = path[row + axis, lane] if own else common[row + axis, 0]


class Workspace(NamedTuple):
    """Work arrays of one thread, each of W columns, that begin on cache lines.

    Attributes
    ----------
    string, motion
        The strings of one vector, and their state.
    step
        What a step may use.
    place, results, shift
        Points at an output, running results, and what is added to the points before they are compared.
    path
        The hand's motion of each lane, where each candidate has its own.
    hand_place
        (2 or 3, W or 1) the hand's place at an output.
    """

    string: StringArrays
    motion: StringMotion
    step: Any
    place: Any
    results: Any
    shift: Any
    path: Any
    hand_place: Array


def workspace(spec: VectorSpec, n: int, axes: int, path_rows: int, *, sticks: bool) -> Workspace:
    """Return work arrays for strings of n points, in the plane (2 axes) or in space.

    `path_rows` of each lane's own path, or 0; `sticks`: with the state of friction that sticks.
    """
    if axes == 2:
        coefficients, rows, stick_rows = COEFFICIENTS, ROWS, 2 * n
    else:
        coefficients, rows, stick_rows = SPATIAL_COEFFICIENTS, SPATIAL_ROWS, 4 * (n + 1)
    sizes = (
        *(coefficients, n, n, axes * n, axes * (n + 1), axes * (n + 1)),
        *(rows * (n + 1), axes * n, RESULTS, axes, max(path_rows, 1), stick_rows * sticks),
    )
    flat = np.zeros(sum(sizes) * spec.width + _LINE, spec.dtype)
    first = (-flat.ctypes.data % _LINE) // flat.itemsize
    lines = flat[first : first + sum(sizes) * spec.width].reshape(-1, spec.width)
    parts = [lines[start:end] for start, end in pairwise(accumulate(sizes, initial=0))]
    c, mass, factor, d, v, dv, step, place, results, shift, path, stick = parts
    string, motion = StringArrays(n, c, mass, factor), StringMotion(d, v, dv, stick if sticks else None)
    hand_place = np.empty((axes, spec.width if path_rows else 1))
    return Workspace(string, motion, step, place, results, shift, path, hand_place)


@njit(**INLINED)
def _copy_lanes(first: int, given: Any, rows: Any) -> None:
    """Fill all lanes from candidate `first` on; those after the last candidate repeat it."""
    for lane in range(rows.shape[1]):
        b = min(first + lane, given.shape[1] - 1)
        for row in range(rows.shape[0]):
            rows[row, lane] = given[row, b]


@njit(**INLINED)
def load_strings(
    spec: Any,
    first: int,
    strings: ReadyStrings,
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


@njit(**INLINED)
def keep_results(first: int, d: Any, results: Any, kept: Array) -> None:
    """Copy the results of each candidate into `kept`; after a blow-up its longest segment is infinite."""
    for lane in range(min(d.shape[1], len(kept) - first)):
        for k in range(RESULTS):
            kept[first + lane, k] = results[k, lane]
        for r in range(d.shape[0]):
            length = math.fabs(d[r, lane])
            if not length < FAR_M:
                kept[first + lane, LONGEST] = np.inf


@njit(nogil=True, **CACHED)
def integrate(
    first: int,
    last: int,
    spec: Any,
    work: Workspace,
    strings: ReadyStrings,
    hand: Any,
    common: Any,
    steps: int,
    settings: StepSettings,
    outputs: Outputs,
    kept: Array,
) -> None:
    """Simulate vectors of W candidates each, the `first` to before the `last` of all.

    Parameters
    ----------
    spec, work
        `strandcast.dynamics.vectors.VectorSpec` of width W, and the `workspace` of this thread.
    strings, outputs
        See there.
    hand
        (T,) times [s] and (1 or B, T, 3) poses: the hand's path, common or each candidate's own.
    common
        (steps * DRIVING, 1) a common path as `strandcast.dynamics.hand.drive` gives it, else any array.
    steps, settings
        Number of steps and what they have in common.
    kept
        (B, RESULTS) filled here: longest segment [m], infinite after a blow-up, shortest segment [m], E [m].
    """
    time_s, poses = hand
    string, motion, step_work, place, results, shift, path, hand_place = work
    width, own, at = results.shape[1], len(poses) > 1, outputs.at
    control = flush_denormals(-1)
    for g in range(first, last):
        b = g * width
        load_strings(spec, b, strings, string, motion, shift, results)
        if own:
            for lane in range(width):
                drive(time_s, poses[min(b + lane, len(poses) - 1)], settings.step, steps, lane, path)
        f: Any = np.int64(0)  # a literal would have `observe` compiled twice
        for k in range(steps):
            hand_now = _hand(spec, path, common, own, k * DRIVING)
            longest, shortest = advance(spec, string, motion, hand_now, step_work, at_step(settings, k))
            store(spec, results, LONGEST, maximum(longest, load(spec, results, LONGEST)))
            store(spec, results, SHORTEST, minimum(shortest, load(spec, results, SHORTEST)))
            while f < len(at) and at[f] <= k + 1:
                put_hand_place(path, common, own, k * DRIVING + X, hand_place)
                observe(spec, k, f, settings.step, motion, place, hand_place, outputs, shift, b, results)
                f += 1
        keep_results(b, motion.d, results, kept)
    flush_denormals(control)
