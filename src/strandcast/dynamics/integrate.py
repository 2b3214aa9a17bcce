"""Time integration of candidates: the loop over steps, and the outputs on the way."""

import math
from typing import Any

import numpy as np
from numba import njit, prange

from strandcast.dynamics.candidates import Candidates, StartArrays, prepare_vector, work_rows
from strandcast.dynamics.elements import COEFFICIENTS, DRY, GRAVITY, HALF_WIDTH, SPACING
from strandcast.dynamics.hand import COS, DRATE, DRIVING, DVX, DVY, RATE, SIN, VX, VY, X, drive
from strandcast.dynamics.observe import FAR_M, LONGEST, RESULTS, SHORTEST, Outputs, observe
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.schemes.scheme import ROWS, StepSettings, StringArrays, StringMotion, advance
from strandcast.dynamics.simd import CACHED, INLINED, flush_denormals, load, maximum, minimum, splat, store

ANY_LENGTH_M = 1e9  # greater than any length


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


@njit(**CACHED)
def _keep(first: int, d: Any, results: Any, kept: Array) -> None:
    """Copy the results of each candidate into `kept`; after a blow-up its longest segment is infinite."""
    for lane in range(min(d.shape[1], len(kept) - first)):
        for k in range(RESULTS):
            kept[first + lane, k] = results[k, lane]
        for r in range(d.shape[0]):
            length = math.fabs(d[r, lane])
            if not length < FAR_M:
                kept[first + lane, LONGEST] = np.inf


@njit(**CACHED)
def _integrate_vector(
    spec: Any,
    like: Any,
    first: int,
    candidates: Candidates,
    hand: Any,
    common: Any,
    start: StartArrays,
    steps: int,
    step: float,
    reading: int,
    scheme: Any,
    outputs: Outputs,
    kept: Array,
) -> None:
    """One vector of candidates from start to end; see `integrate_batch`."""
    time_s, poses = hand
    n, width, own = candidates.masses.shape[1], like.shape[1], len(poses) > 1
    string = StringArrays(n, work_rows(COEFFICIENTS, like), work_rows(n, like), work_rows(n, like))
    motion = StringMotion(work_rows(2 * n, like), work_rows(2 * n + 2, like), work_rows(2 * n + 2, like))
    work, place, results = work_rows(ROWS * (n + 1), like), work_rows(2 * n, like), work_rows(RESULTS, like)
    path, shift = work_rows(steps * DRIVING if own else 1, like), work_rows(2, like)
    hand_place = np.zeros((2, width if own else 1))
    prepare_vector(candidates, first, poses, start, reading, step, string, motion, shift)
    if own:
        for lane in range(width):
            drive(time_s, poses[min(first + lane, len(poses) - 1)], step, steps, lane, path)
    fixed = candidates.fixed
    l0, gravity, per_width = fixed[0, SPACING], fixed[0, GRAVITY], 1.0 / fixed[0, HALF_WIDTH]
    has_friction = fixed[:, DRY].max() > 0.0
    motion.dv[:] = 0.0
    results[:] = 0.0
    results[SHORTEST] = ANY_LENGTH_M
    control = flush_denormals(-1)
    at = outputs.at
    f = 0
    for k in range(steps):
        hand_now = _hand(spec, path, True, k) if own else _hand(spec, common, False, k)
        share = 0.5 if k == 0 else 1.0
        settings = StepSettings(step, share, l0, gravity, reading, per_width, has_friction)
        longest, shortest = advance(scheme, spec, string, motion, hand_now, work, settings)
        store(spec, results, LONGEST, maximum(longest, load(spec, results, LONGEST)))
        store(spec, results, SHORTEST, minimum(shortest, load(spec, results, SHORTEST)))
        if f < len(at) and at[f] <= k + 1:
            r = k * DRIVING + X
            if own:
                hand_place[:] = path[r : r + 2]
            else:
                hand_place[:] = common[r : r + 2]
            while f < len(at) and at[f] <= k + 1:
                observe(spec, k, f, step, motion, place, hand_place, outputs, shift, first, results)
                f += 1
    flush_denormals(control)
    _keep(first, motion.d, results, kept)


@njit(parallel=True, **CACHED)
def integrate_batch(
    spec: Any,
    like: Any,
    candidates: Candidates,
    hand: Any,
    start: StartArrays,
    steps: int,
    step: float,
    reading: int,
    scheme: Any,
    outputs: Outputs,
) -> Array:
    """Simulate B candidates, W in one vector; the loop over vectors runs on all cores.

    Parameters
    ----------
    spec, like
        `strandcast.dynamics.vectors.VectorSpec` of width W, and any array (…, W) of its dtype.
    candidates, start, outputs
        See there; the spacing, gravity and half-width of the switch are the same for all candidates.
    hand
        (T,) times [s] and (1 or B, T, 3) poses: the hand's path, common or each candidate's own.
    steps, step, reading, scheme
        Number and length [s] of steps, the reading, the `strandcast.dynamics.schemes.scheme.Scheme`.

    Returns
    -------
    (B, RESULTS) longest segment [m], infinite after a blow-up, shortest segment [m], and E [m].
    """
    count, width = len(candidates.masses), like.shape[1]
    kept = np.empty((count, RESULTS))
    time_s, poses = hand
    common = np.empty((steps * DRIVING if len(poses) == 1 else 1, 1))
    if len(poses) == 1:
        drive(time_s, poses[0], step, steps, 0, common)
    for g in prange((count + width - 1) // width):
        _integrate_vector(
            spec,
            like,
            np.int64(g) * width,
            candidates,
            hand,
            common,
            start,
            steps,
            step,
            reading,
            scheme,
            outputs,
            kept,
        )
    return kept
