"""Time integration of candidates in space: the loop over steps, and the outputs on the way."""

from typing import Any

import numpy as np
from numba import njit

from strandcast.dynamics.integrate import Workspace, keep_results, load_strings, path_row, put_hand_place
from strandcast.dynamics.observe import LONGEST, SHORTEST, VALUE, Outputs, scatter
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
from strandcast.dynamics.spatial.step import ClampMotion, step_in_space
from strandcast.dynamics.spatial.triples import dot, load3, minus, plus, plus_scaled, store3, zero3
from strandcast.dynamics.string_state import ReadyStrings, StepSettings, StringMotion, at_step


@njit(**INLINED)
def _row3(spec: Any, path: Any, common: Any, own: bool, row: int) -> Any:
    """Return three rows of each candidate's own path, or of the common one."""
    return (
        path_row(spec, path, common, own, row),
        path_row(spec, path, common, own, row + 1),
        path_row(spec, path, common, own, row + 2),
    )


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
    settings: StepSettings,
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
    bent = 0.5 * (outputs.at[f] - k) * settings.step / (settings.share * settings.step)
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
        scatter(place, first, f, hand, outputs.out)


@njit(nogil=True, **CACHED)
def integrate_in_space(
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
    hand
        (T,) times [s] and (1 or B, T, 9 or 18) poses: the clamps' path, common or each candidate's own.
    common
        A common path as `strandcast.dynamics.spatial.clamps.drive_clamps` gives it, else any array.
    steps, settings
        Number of steps and what they have in common.
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
        load_strings(spec, b, strings, string, motion, shift, results)
        if own:
            for lane in range(width):
                drive_clamps(time_s, poses[min(b + lane, len(poses) - 1)], settings.step, steps, lane, path)
        f: Any = np.int64(0)  # a literal would have `_observe` compiled twice
        for k in range(steps):
            row = k * ends * CLAMP
            clamp = _clamp(spec, path, common, own, row)
            far = _clamp(spec, path, common, own, row + (ends - 1) * CLAMP)
            now = at_step(settings, k)
            longest, shortest = step_in_space(spec, string, motion, clamp, far, step_work, now)
            store(spec, results, LONGEST, maximum(longest, load(spec, results, LONGEST)))
            store(spec, results, SHORTEST, minimum(shortest, load(spec, results, SHORTEST)))
            while f < len(at) and at[f] <= k + 1:
                put_hand_place(path, common, own, row + PLACE, hand_place)
                _observe(spec, k, f, now, motion, place, hand_place, outputs, shift, b, results)
                f += 1
        keep_results(b, motion.d, results, kept)
    flush_denormals(control)
