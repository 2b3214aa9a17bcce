"""Time integration of candidates: the loop over steps, and the outputs on the way."""

import math
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from strandcast.dynamics.candidates import Candidates, ReadyStrings
from strandcast.dynamics.elements import COEFFICIENTS
from strandcast.dynamics.hand import COS, DRATE, DRIVING, DVX, DVY, RATE, SIN, VX, VY, X, drive
from strandcast.dynamics.observe import FAR_M, LONGEST, RESULTS, SHORTEST, VALUE, Outputs, observe
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import CACHED, INLINED, flush_denormals, load, maximum, minimum, splat, store
from strandcast.dynamics.step import advance
from strandcast.dynamics.string_state import (
    ROWS,
    StepSettings,
    StringArrays,
    StringMotion,
    at_step,
)
from strandcast.dynamics.vectors import VectorSpec

ANY_LENGTH_M = 1e9  # greater than any length
_LINE = 64  # bytes of a cache line


@njit(**INLINED)
def _hand_value(spec: Any, path: Any, own: bool, row: int) -> Any:
    """Return one row of `path`: each candidate's own, or the same for all."""
    if own:
        return load(spec, path, row)
    return splat(spec, path[row, 0])


@njit(**INLINED)
def _hand(spec: Any, path: Any, own: bool, k: int) -> tuple[Any, Any, Any, Any, Any, Any, Any, Any]:
    """Return the hand at step k."""
    r = k * DRIVING
    return (
        _hand_value(spec, path, own, r + VX),
        _hand_value(spec, path, own, r + VY),
        _hand_value(spec, path, own, r + COS),
        _hand_value(spec, path, own, r + SIN),
        _hand_value(spec, path, own, r + RATE),
        _hand_value(spec, path, own, r + DVX),
        _hand_value(spec, path, own, r + DVY),
        _hand_value(spec, path, own, r + DRATE),
    )


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
        (2, W or 1) the hand's place at an output.
    """

    string: StringArrays
    motion: StringMotion
    step: Any
    place: Any
    results: Any
    shift: Any
    path: Any
    hand_place: Array


def workspace(spec: VectorSpec, points: int, own_steps: int, *, sticks: bool = False) -> Workspace:
    """Return work arrays for strings of so many points.

    `own_steps` with a path for each lane, or 0; `sticks`: with the state of friction that sticks.
    """
    n, width = points, spec.width
    sizes = (
        *(COEFFICIENTS, n, n, 2 * n, 2 * n + 2, 2 * n + 2),
        *(ROWS * (n + 1), 2 * n, RESULTS, 2, max(own_steps * DRIVING, 1), 2 * n * sticks),
    )
    flat = np.empty(sum(sizes) * width + _LINE, spec.dtype)
    first = (-flat.ctypes.data % _LINE) // flat.itemsize
    rows = flat[first : first + sum(sizes) * width].reshape(-1, width)
    ends = list(accumulate(sizes, initial=0))
    parts = [rows[start:end] for start, end in pairwise(ends)]
    c, mass, factor, d, v, dv, step, place, results, shift, path, stick = parts
    string, motion = StringArrays(n, c, mass, factor), StringMotion(d, v, dv, stick if sticks else None)
    hand_place = np.empty((2, width if own_steps else 1))
    return Workspace(string, motion, step, place, results, shift, path, hand_place)


@njit(**INLINED)
def _load_strings(
    first: int,
    candidates: Candidates,
    strings: ReadyStrings,
    string: StringArrays,
    motion: StringMotion,
    shift: Any,
) -> None:
    """Fill all lanes from candidate `first` on; those after the last candidate repeat it."""
    count, n = candidates.masses.shape
    for lane in range(shift.shape[1]):
        b = min(first + lane, count - 1)
        for row in range(COEFFICIENTS):
            string.c[row, lane] = strings.c[row, b]
        for i in range(n):
            string.mass[i, lane], string.factor[i, lane] = candidates.masses[b, i], candidates.factor[b, i]
        for row in range(2 * n):
            motion.d[row, lane] = strings.d[row, b]
        for row in range(2 * n + 2):
            motion.v[row, lane], motion.dv[row, lane] = strings.v[row, b], 0.0
        shift[0, lane], shift[1, lane] = candidates.shift_m[b, 0], candidates.shift_m[b, 1]


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
    candidates: Candidates,
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
    candidates, strings, outputs
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
        _load_strings(b, candidates, strings, string, motion, shift)
        if own:
            for lane in range(width):
                drive(time_s, poses[min(b + lane, len(poses) - 1)], settings.step, steps, lane, path)
        for lane in range(width):
            results[LONGEST, lane], results[SHORTEST, lane], results[VALUE, lane] = 0.0, ANY_LENGTH_M, 0.0
        f: Any = np.int64(0)  # a literal would have `observe` compiled twice
        for k in range(steps):
            hand_now = _hand(spec, path, own, k) if own else _hand(spec, common, own, k)
            longest, shortest = advance(spec, string, motion, hand_now, step_work, at_step(settings, k))
            store(spec, results, LONGEST, maximum(longest, load(spec, results, LONGEST)))
            store(spec, results, SHORTEST, minimum(shortest, load(spec, results, SHORTEST)))
            if f < len(at) and at[f] <= k + 1:
                for lane in range(hand_place.shape[1]):
                    for axis in range(2):
                        r = k * DRIVING + X + axis
                        hand_place[axis, lane] = path[r, lane] if own else common[r, 0]
                while f < len(at) and at[f] <= k + 1:
                    observe(spec, k, f, settings.step, motion, place, hand_place, outputs, shift, b, results)
                    f += 1
        keep_results(b, motion.d, results, kept)
    flush_denormals(control)
