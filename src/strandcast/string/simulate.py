"""Simulate strings on a given path of the hand: one, or a batch of candidates on all cores."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strandcast.string.hand import places
from strandcast.string.lanes import Kind, register_bits
from strandcast.string.march import (
    AS_GIVEN,
    FAR_M,
    HANGING,
    LONGEST,
    MISS,
    MISS_AT,
    RESPACED,
    SHORTEST,
    VALUE,
)
from strandcast.string.march import march as _march
from strandcast.string.model import INTEGRATORS, READINGS, StringModel
from strandcast.string.parameters import Array

OK, BLEW_UP, OVERSTRETCHED, COLLAPSED = range(4)
STATUS = {
    OK: "ok",
    BLEW_UP: "blew up",
    OVERSTRETCHED: "a segment longer than three rest lengths",
    COLLAPSED: "a segment shorter than 0.3 rest lengths",
}
LONGEST_SEGMENT, SHORTEST_SEGMENT = 3.0, 0.3  # rest lengths: beyond, the model is not a string

FINEST = 8  # smallest step, as a fraction of the model's, with which a torn candidate is repeated
_STIFF = 1.4  # k_s h^2 / m beyond which a string is too stiff to be stretched by its loads


def kind(precision: str) -> Kind:
    """How the kernels hold candidates: as many as a vector register of this processor takes.

    The environment variable STRANDCAST_REGISTER_BITS overrides the size of the register: 512, 256, 128, or 0
    for plain numbers.
    """
    bits = {"f64": 64, "f32": 32}[precision]
    register = int(os.environ.get("STRANDCAST_REGISTER_BITS") or register_bits())
    if register not in (0, 128, 256, 512):
        raise ValueError(f"STRANDCAST_REGISTER_BITS is 512, 256, 128 or 0, not {register}")
    return Kind(bits, max(register // bits, 1))


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
    bend_friction: Array | float = 0.0,
    sway: Array | None = None,
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
    bend_friction
        Dry friction of a joint [N m/kg], per candidate (B,) or common: bending that does not die away by
        itself. A deviation from the paper; real cables have it.
    sway
        (B, 2) turn of the whole string about the hand at the start [rad], and its rate [rad/s].

    Returns
    -------
    positions
        (B, F, n+1, 2) [m].
    status
        (B,) keys of `STATUS`.
    """
    given = _given(
        model, parameters, masses, hand_time_s, hand_pose, out_time_s, start, start_velocity, respace,
        rest_curl_rad_m, clamp_offset_rad, bend_factor, bend_friction,
    )  # fmt: skip
    if sway is not None:
        given.fixed[:, 6:] = _rows(sway, len(given.p), 2)
    out = np.empty((len(given.p), len(given.at), model.points + 1, 2))
    for b in range(len(given.pose)):
        hand = out[b : b + 1 if len(given.pose) > 1 else None, :, 0]
        place = np.empty(hand.shape[1:])
        places(given.time_s, given.pose[b], given.wanted_s, place)
        hand[:] = place
    status = _run(given, {"out": out})[1]
    for b in map(int, np.flatnonzero(status == BLEW_UP)):
        out[b, np.isnan(out[b, :, -1, 0])] = np.nan
    return out, status


def evaluate_batch(
    model: StringModel,
    parameters: Array,
    masses: Array,
    hand_time_s: Array,
    hand_pose: Array,
    frame_time_s: Array,
    seen_m: Array,
    per_metre: Array,
    start: Array | None = None,
    start_velocity: Array | None = None,
    *,
    respace: bool = True,
    rest_curl_rad_m: Array | float | None = None,
    clamp_offset_rad: Array | float = 0.0,
    bend_factor: Array | None = None,
    bend_friction: Array | float = 0.0,
    shift_m: Array | None = None,
    bound_m: float = np.inf,
) -> tuple[Array, NDArray[np.int64]]:
    """Weighted distance between a measured throw and B candidates, without keeping a position.

    Parameters
    ----------
    model, parameters, masses, hand_time_s, start, start_velocity, respace
        As for `simulate_batch`.
    rest_curl_rad_m, clamp_offset_rad, bend_factor, bend_friction
        As for `simulate_batch`.
    hand_pose
        (T, 3).
    frame_time_s, seen_m, per_metre
        (F,) times [s], (F, n, 2) measured points 1…n [m], anything where their weight (F, n) is 0.
    shift_m
        (B, 2) added to each candidate's points [m].
    bound_m
        Candidates worse than this are not followed to their end.

    Returns
    -------
    values
        (B,) sum of weight times distance; infinite above `bound_m`, and after a blow-up.
    status
        (B,) keys of `STATUS`; of a candidate that was given up, as far as it went.
    """
    given = _given(
        model, parameters, masses, hand_time_s, hand_pose, frame_time_s, start, start_velocity, respace,
        rest_curl_rad_m, clamp_offset_rad, bend_factor, bend_friction,
    )  # fmt: skip
    used = _rows(per_metre, len(given.at), model.points)
    if len(given.pose) > 1 or np.shape(seen_m) != (*used.shape, 2):
        raise ValueError(f"one path of the hand and points of shape {(*used.shape, 2)} are compared")
    seen = np.where(used[..., None] > 0, seen_m, 0.0)
    if np.isnan(seen).any():
        raise ValueError("a point that was not seen has a weight")
    if shift_m is not None:
        given = given._replace(shift=_rows(shift_m, len(given.p), 2))
    kept, status = _run(given, {"seen": seen, "per_metre": used, "bound": float(bound_m)})
    values = kept[:, VALUE]
    return np.where((status == BLEW_UP) | ~(values <= bound_m), np.inf, values), status


def miss_batch(
    model: StringModel,
    parameters: Array,
    masses: Array,
    hand_time_s: Array,
    hand_pose: Array,
    out_time_s: Array,
    target_m: Array,
    start: Array | None = None,
    start_velocity: Array | None = None,
    *,
    respace: bool = True,
    rest_curl_rad_m: Array | float | None = None,
    clamp_offset_rad: Array | float = 0.0,
    bend_factor: Array | None = None,
    bend_friction: Array | float = 0.0,
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Least distance between a target and the tip's path, without keeping a position.

    Arguments as for `simulate_batch`; `target_m` is (2,). The path is straight between outputs.

    Returns
    -------
    miss
        (B,) [m], infinite after a blow-up.
    time
        (B,) when [s], on the clock of `out_time_s`.
    status
        (B,) keys of `STATUS`.
    """
    given = _given(
        model, parameters, masses, hand_time_s, hand_pose, out_time_s, start, start_velocity, respace,
        rest_curl_rad_m, clamp_offset_rad, bend_factor, bend_friction,
    )  # fmt: skip
    kept, status = _run(given, {"target": np.asarray(target_m, dtype=float)})
    if not len(given.wanted_s):
        raise ValueError("a miss needs outputs")
    time_s = np.interp(kept[:, MISS_AT], np.arange(len(given.wanted_s)), given.wanted_s)
    return np.where(status == BLEW_UP, np.inf, kept[:, MISS]), time_s, status


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


def _rows(values: Array, rows: int | None, columns: int) -> Array:
    """Return `values` as a contiguous array of that shape; the kernels check no bounds."""
    array = np.ascontiguousarray(values, dtype=float)
    if array.ndim != 2 or array.shape[1] != columns or rows not in (None, len(array)):
        wanted = "…" if rows is None else rows
        raise ValueError(f"expected an array of shape ({wanted}, {columns}), got {array.shape}")
    return array


def _check(model: StringModel, masses: Array, batch: int, time_s: Array, pose: Array, at: Array) -> None:
    if len(masses) != batch or pose.shape[0] not in (1, batch) or pose.shape[1:] != (len(time_s), 3):
        raise ValueError(f"{batch} candidates do not fit masses {masses.shape} and hand poses {pose.shape}")
    if len(time_s) < 2 or not np.all(np.diff(time_s) > 0):
        raise ValueError("the hand's times must increase")
    if len(at) and (at[0] < -1e-6 or not np.all(np.diff(at) >= 0)):
        raise ValueError("output times must increase and not precede the hand's first sample")
    if len(model.factors()) != model.points:
        raise ValueError(f"{model.points} points need {model.points} bend factors")


class _Given(NamedTuple):
    """Candidates and their throw, as the kernels take them: see `strandcast.string.march.march`."""

    model: StringModel
    p: Array
    m: Array
    factor: Array
    fixed: Array
    time_s: Array
    pose: Array
    start_kind: int
    start: Array
    start_velocity: Array
    wanted_s: Array
    at: Array
    steps: int
    shift: Array


def _given(
    model: StringModel,
    parameters: Array,
    masses: Array,
    hand_time_s: Array,
    hand_pose: Array,
    out_time_s: Array,
    start: Array | None,
    start_velocity: Array | None,
    respace: bool,
    rest_curl_rad_m: Array | float | None,
    clamp_offset_rad: Array | float,
    bend_factor: Array | None,
    bend_friction: Array | float,
) -> _Given:
    n = model.points
    p = _rows(parameters, None, 10)
    m = _rows(masses, len(p), n)
    time_s = np.ascontiguousarray(hand_time_s, dtype=float)
    pose = np.ascontiguousarray(hand_pose, dtype=float)
    if pose.ndim == 2:
        pose = pose[None]
    wanted_s = np.ascontiguousarray(out_time_s, dtype=float)
    at = (wanted_s - time_s[0]) / model.dt_s
    _check(model, m, len(p), time_s, pose, at)
    steps = max(int(np.ceil(at[-1] - 1e-9)), 1) if len(at) else 1
    curl = model.rest_curl_rad_m if rest_curl_rad_m is None else rest_curl_rad_m
    fixed = np.zeros((len(p), 8))
    fixed[:, 0] = model.spacing_m
    fixed[:, 1] = np.asarray(curl, dtype=float) * model.spacing_m
    fixed[:, 2] = clamp_offset_rad
    fixed[:, 3] = model.gravity_m_s2
    fixed[:, 4] = model.switch()
    fixed[:, 5] = bend_friction
    return _Given(
        model,
        p,
        m,
        np.tile(model.factors(), (len(p), 1)) if bend_factor is None else _rows(bend_factor, len(p), n),
        fixed,
        time_s,
        pose,
        HANGING if start is None else (RESPACED if respace else AS_GIVEN),
        np.zeros((n, 2)) if start is None else _rows(start, n, 2),
        np.zeros((n, 2)) if start_velocity is None else _rows(start_velocity, n, 2),
        wanted_s,
        np.clip(at, 0.0, float(steps)),
        steps,
        np.zeros((len(p), 2)),
    )


def _run(given: _Given, observed: dict[str, Any]) -> tuple[Array, NDArray[np.int64]]:
    """Run candidates, and those that the step tore again with smaller steps: what is kept, and status.

    In a snap a segment may turn by half a radian within a step. A string too stiff to be stretched by its
    loads that is overstretched all the same failed by the scheme, not by its physics.
    """
    model = given.model
    kept = _pass(given, 1, observed)
    status = _status(model, kept)
    stiff = (given.p[:, 0] * model.dt_s**2 > _STIFF * given.m.min(axis=1)) & (model.integrator == "lfcn")
    finer = 2
    while finer <= FINEST and (torn := np.flatnonzero(stiff & (status != OK))).size:
        again = dict(observed)
        if "out" in observed:
            again["out"] = observed["out"][torn]
        some = given._replace(
            p=given.p[torn],
            m=given.m[torn],
            factor=given.factor[torn],
            fixed=given.fixed[torn],
            pose=given.pose if len(given.pose) == 1 else given.pose[torn],
            shift=given.shift[torn],
        )
        kept[torn] = _pass(some, finer, again)
        status[torn] = _status(model, kept[torn])
        if "out" in observed:
            observed["out"][torn] = again["out"]
        finer *= 2
    return kept, status


def _pass(given: _Given, finer: int, observed: dict[str, Any]) -> Array:
    """Run candidates once, with steps `finer` times smaller than the model's."""
    model, n = given.model, given.model.points
    held = kind(model.precision)
    nothing = {
        "seen": np.empty((0, n, 2)),
        "per_metre": np.empty((0, n)),
        "bound": np.inf,
        "target": np.empty(0),
        "out": np.empty((0, 0, 0, 0)),
    }
    observers = nothing | observed
    return np.asarray(
        _march(
            held,
            np.empty((1, held.width), held.dtype),
            given.p,
            given.m,
            given.factor,
            given.fixed,
            given.time_s,
            given.pose,
            given.start_kind,
            given.start,
            given.start_velocity,
            given.steps * finer,
            model.dt_s / finer,
            READINGS.index(model.reading),
            INTEGRATORS.index(model.integrator),
            given.at * finer,
            observers["seen"],
            observers["per_metre"],
            given.shift,
            observers["bound"],
            observers["target"],
            observers["out"],
        )
    )


def _status(model: StringModel, kept: Array) -> NDArray[np.int64]:
    longest, shortest = kept[:, LONGEST] / model.spacing_m, kept[:, SHORTEST] / model.spacing_m
    status = np.full(len(kept), OK)
    status[shortest < SHORTEST_SEGMENT] = COLLAPSED
    status[longest > LONGEST_SEGMENT] = OVERSTRETCHED
    status[~(kept[:, LONGEST] < FAR_M)] = BLEW_UP
    return status
