"""Simulate strings on a given path of the hand: one, or a batch of candidates on all cores."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from strandcast.string.forces import KERNEL
from strandcast.string.hand import hand_at_steps
from strandcast.string.implicit import FINE, averaging
from strandcast.string.integrators import BLEW_UP, LFCN, OK, OVERSTRETCHED, integrate
from strandcast.string.model import INTEGRATORS, READINGS, StringModel
from strandcast.string.parameters import Array
from strandcast.string.rest import hanging, respaced

STATUS = {OK: "ok", BLEW_UP: "blew up", OVERSTRETCHED: "a segment longer than three rest lengths"}

FINEST = 4  # smallest step, as a fraction of the model's, with which a torn candidate is repeated

_HANGING, _RESPACED, _AS_GIVEN = range(3)


def simulate(
    model: StringModel,
    parameters: Array,
    masses: Array,
    hand_time_s: Array,
    hand_pose: Array,
    out_time_s: Array,
    start: Array | None = None,
    start_velocity: Array | None = None,
    *,
    respace: bool = True,
    clamp_offset_rad: float = 0.0,
) -> tuple[Array, int]:
    """Simulate one string.

    Parameters
    ----------
    model
        What is fixed.
    parameters, masses
        (10,) in the order of `PARAMETERS` and (n,) relative masses of points 1…n.
    hand_time_s, hand_pose
        (T,) times [s] and (T, 3) x, y [m] and unwrapped angle [rad]. The simulation starts at the first
        sample; the hand rests at the last one after its end.
    out_time_s
        (F,) increasing times of the wanted positions [s], none before the first sample.
    start
        (n, 2) positions of points 1…n at the first sample [m]; None: hanging at rest, clamped in the hand.
    start_velocity
        (n, 2) velocities [m/s]; None: at rest.
    respace
        Keep only the directions of `start` and give the segments the lengths of a string at rest.
    clamp_offset_rad
        Angle between the hand's direction and that of the clamped string [rad].

    Returns
    -------
    positions
        (F, n+1, 2) positions of points 0…n [m]; NaN from a blow-up on.
    status
        Key of `STATUS`.
    """
    positions, status = simulate_batch(
        model,
        np.asarray(parameters)[None],
        np.asarray(masses)[None],
        hand_time_s,
        hand_pose,
        out_time_s,
        start,
        start_velocity,
        respace=respace,
        clamp_offset_rad=np.array([clamp_offset_rad]),
    )
    return positions[0], int(status[0])


def simulate_batch(
    model: StringModel,
    parameters: Array,
    masses: Array,
    hand_time_s: Array,
    hand_pose: Array,
    out_time_s: Array,
    start: Array | None = None,
    start_velocity: Array | None = None,
    *,
    respace: bool = True,
    rest_curl_rad_m: Array | float | None = None,
    clamp_offset_rad: Array | float = 0.0,
    bend_factor: Array | None = None,
) -> tuple[Array, NDArray[np.int64]]:
    """Simulate a batch of B candidates; the bytes do not depend on the number of threads.

    Parameters
    ----------
    model, hand_time_s, out_time_s, start, start_velocity, respace
        As for `simulate`; `start` and `start_velocity` are (n, 2), common to all candidates.
    parameters, masses
        (B, 10) and (B, n).
    hand_pose
        (T, 3) common to all, or (B, T, 3).
    rest_curl_rad_m, clamp_offset_rad
        Per candidate (B,), or common; None: the model's own curl.
    bend_factor
        (B, n) multiplier of bending at each joint per candidate; None: the model's own.

    Returns
    -------
    positions
        (B, F, n+1, 2) [m].
    status
        (B,) keys of `STATUS`.
    """
    p = _rows(parameters, 10)
    batch = len(p)
    m = _rows(masses, model.points)
    time_s = np.ascontiguousarray(hand_time_s, dtype=float)
    pose = np.ascontiguousarray(hand_pose, dtype=float)
    if pose.ndim == 2:
        pose = pose[None]
    at = (np.asarray(out_time_s, dtype=float) - time_s[0]) / model.dt_s
    _check(model, m, batch, time_s, pose, at)
    steps = max(int(np.ceil(at[-1] - 1e-9)), 1) if len(at) else 1
    curl = model.rest_curl_rad_m if rest_curl_rad_m is None else rest_curl_rad_m
    fixed = np.empty((batch, 5))
    fixed[:, 0] = model.spacing_m
    fixed[:, 1] = np.asarray(curl, dtype=float) * model.spacing_m
    fixed[:, 2] = clamp_offset_rad
    fixed[:, 3] = model.gravity_m_s2
    fixed[:, 4] = model.switch()
    kind = _HANGING if start is None else (_RESPACED if respace else _AS_GIVEN)
    n = model.points
    return _simulate(
        p,
        m,
        time_s,
        pose,
        model.dt_s,
        steps,
        np.clip(at, 0.0, float(steps)),
        kind,
        np.zeros((n, 2)) if start is None else _rows(start, 2),
        np.zeros((n, 2)) if start_velocity is None else _rows(start_velocity, 2),
        np.tile(model.factors(), (batch, 1)) if bend_factor is None else _rows(bend_factor, n),
        fixed,
        READINGS.index(model.reading),
        INTEGRATORS.index(model.integrator),
    )


def start_shape(
    model: StringModel,
    parameters: Array,
    masses: Array,
    pose: Array,
    start: Array | None = None,
    clamp_offset_rad: float = 0.0,
) -> Array:
    """Points 0…n with which `simulate` starts from a hand at `pose` (3,): (n+1, 2) [m]."""
    time_s = np.array([0.0, 1.0])
    path = np.array([pose, pose])
    positions, _ = simulate(
        model, parameters, masses, time_s, path, time_s[:1], start, clamp_offset_rad=clamp_offset_rad
    )
    return positions[0]


def _rows(values: Array, columns: int) -> Array:
    rows = np.ascontiguousarray(values, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise ValueError(f"expected an array of shape (…, {columns}), got {rows.shape}")
    return rows


def _check(model: StringModel, masses: Array, batch: int, time_s: Array, pose: Array, at: Array) -> None:
    if len(masses) != batch or pose.shape[0] not in (1, batch) or pose.shape[1:] != (len(time_s), 3):
        raise ValueError(f"{batch} candidates do not fit masses {masses.shape} and hand poses {pose.shape}")
    if len(time_s) < 2 or not np.all(np.diff(time_s) > 0):
        raise ValueError("the hand's times must increase")
    if len(at) and (at[0] < -1e-6 or not np.all(np.diff(at) >= 0)):
        raise ValueError("output times must increase and not precede the hand's first sample")
    if len(model.factors()) != model.points:
        raise ValueError(f"{model.points} points need {model.points} bend factors")


@njit(**KERNEL)
def _candidate(
    hand: Array,
    h: float,
    at: Array,
    kind: int,
    start: Array,
    start_velocity: Array,
    p: Array,
    m: Array,
    factor: Array,
    fixed: Array,
    reading: int,
    scheme: int,
    out: Array,
) -> int:
    """Start one candidate as `kind` says and integrate it, into `out`."""
    n = len(m)
    x = np.empty((n + 1, 2))
    v = np.zeros((n + 1, 2))
    if kind == _HANGING:
        hanging(hand[0], p, m, factor, fixed, reading, x)
    elif kind == _RESPACED:
        respaced(hand[0], start, p, m, fixed[0], fixed[3], x)
    x[0, 0], x[0, 1] = hand[0, 0], hand[0, 1]
    for i in range(n):
        v[i + 1, 0], v[i + 1, 1] = start_velocity[i, 0], start_velocity[i, 1]
        if kind == _AS_GIVEN:
            x[i + 1, 0], x[i + 1, 1] = start[i, 0], start[i, 1]
    return integrate(x, v, hand, h, p, m, factor, fixed, reading, scheme, at, out)


@njit(**KERNEL)
def _until_it_holds(
    hand: Array,
    time_s: Array,
    path: Array,
    h: float,
    steps: int,
    at: Array,
    kind: int,
    start: Array,
    start_velocity: Array,
    p: Array,
    m: Array,
    factor: Array,
    fixed: Array,
    reading: int,
    scheme: int,
    out: Array,
) -> int:
    """Integrate one candidate, again with smaller steps if it was torn by the step.

    In a snap a segment may turn by half a radian within a step. A string too stiff to be stretched by its
    loads that is overstretched all the same failed by the scheme, not by its physics.
    """
    status = _candidate(hand, h, at, kind, start, start_velocity, p, m, factor, fixed, reading, scheme, out)
    stiff = scheme == LFCN and averaging(p[0], h, np.min(m), 4.0) > FINE
    finer = 2
    while stiff and status != OK and finer <= FINEST:
        closer = hand_at_steps(time_s, path, h / finer, steps * finer)
        status = _candidate(
            closer,
            h / finer,
            at * finer,
            kind,
            start,
            start_velocity,
            p,
            m,
            factor,
            fixed,
            reading,
            scheme,
            out,
        )
        finer *= 2
    return status


@njit(parallel=True, **KERNEL)
def _simulate(
    p: Array,
    m: Array,
    time_s: Array,
    pose: Array,
    h: float,
    steps: int,
    at: Array,
    kind: int,
    start: Array,
    start_velocity: Array,
    factor: Array,
    fixed: Array,
    reading: int,
    scheme: int,
) -> tuple[Array, NDArray[np.int64]]:
    """Integrate all candidates; the loop over them runs on all cores."""
    batch, n = m.shape
    out = np.empty((batch, len(at), n + 1, 2))
    status = np.empty(batch, dtype=np.int64)
    shared = len(pose) == 1
    common = hand_at_steps(time_s, pose[0], h, steps)
    for c in prange(batch):
        path = pose[0] if shared else pose[c]
        hand = common if shared else hand_at_steps(time_s, path, h, steps)
        status[c] = _until_it_holds(
            hand,
            time_s,
            path,
            h,
            steps,
            at,
            kind,
            start,
            start_velocity,
            p[c],
            m[c],
            factor[c],
            fixed[c],
            reading,
            scheme,
            out[c],
        )
    return out, status
