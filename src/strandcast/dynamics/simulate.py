"""Simulate batches of candidate strings on a given path of the hand, on all cores."""

import os

import numpy as np
from numpy.typing import NDArray

from strandcast.core.strings import StringBatch
from strandcast.dynamics.batch import (
    HANGING_AT_REST,
    Batch,
    HandPath,
    MeasuredPoints,
    StringStart,
    make_batch,
    rows_of,
)
from strandcast.dynamics.candidates import ready
from strandcast.dynamics.elements import DRAG_ALONG, DRY, GRAVITY, HALF_WIDTH, SPACING, STICK
from strandcast.dynamics.hand import DRIVING, drive, places
from strandcast.dynamics.integrate import integrate, workspace
from strandcast.dynamics.model import READINGS, StringModel
from strandcast.dynamics.observe import FAR_M, LONGEST, RESULTS, SHORTEST, VALUE
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.spatial.clamps import CLAMP, POSE, drive_clamps
from strandcast.dynamics.spatial.integrate import integrate_in_space
from strandcast.dynamics.spatial.strings import REST_TURN, in_space, ready_in_space
from strandcast.dynamics.string_state import StepSettings
from strandcast.dynamics.vectors import VectorSpec, register_bits
from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.threads import over_ranges

OK, BLEW_UP, OVERSTRETCHED, COLLAPSED, NO_REST_SHAPE = range(5)
STATUS = {
    OK: "ok",
    BLEW_UP: "blew up",
    OVERSTRETCHED: "a segment longer than three rest lengths",
    COLLAPSED: "a segment shorter than 0.3 rest lengths",
    NO_REST_SHAPE: "found no rest shape to start from",
}
LONGEST_SEGMENT, SHORTEST_SEGMENT = 3.0, 0.3  # rest lengths: beyond, the model is no string (chosen)

NO_LENGTH_M = -1.0  # the shortest segment of a string for which no rest shape was found
SMALLEST_STEP = 8  # the model's step over the smallest one with which a diverged candidate is repeated
_STIFF = 1.4  # k_s h^2 / m beyond which a string is too stiff to be stretched by its loads


def vector_spec(precision: str) -> VectorSpec:
    """Return how the kernels hold candidates: as many as fit a vector register of this processor.

    The environment variable STRANDCAST_REGISTER_BITS overrides the size of the register: 512, 256, 128, or 0
    for plain numbers.
    """
    bits = {"f64": 64, "f32": 32}[precision]
    register = int(os.environ.get("STRANDCAST_REGISTER_BITS") or register_bits())
    if register not in (0, 128, 256, 512):
        raise ValueError(f"STRANDCAST_REGISTER_BITS is 512, 256, 128 or 0, not {register}")
    return VectorSpec(bits, max(register // bits, 1))


def simulate_batch(
    model: StringModel,
    strings: StringBatch,
    hand: HandPath,
    out_time_s: Array,
    start: StringStart = HANGING_AT_REST,
) -> tuple[Array, NDArray[np.int64]]:
    """Simulate B strings; the bytes do not depend on the number of threads.

    Parameters
    ----------
    model
        What does not vary between strings.
    strings
        The strings, with the disturbances of the clamp and of the sway.
    hand
        Its path, common or each string's own.
    out_time_s
        (F,) increasing times of the outputs [s], none before the hand's first sample.
    start
        Shape and velocity of all strings at the hand's first sample.

    Returns
    -------
    positions
        (B, F, n+1, 2) points 0…n [m], (B, F, n+1, 3) in space; NaN from a blow-up on.
    status
        (B,) keys of `STATUS`.

    Raises
    ------
    StrandcastError
        SC-E003 none of the strings has a rest shape to start from.
    """
    batch = make_batch(model, strings, hand, out_time_s, start)
    time_s, poses = batch.hand
    axes = 3 if in_space(poses) else 2
    out = np.empty((len(strings), len(out_time_s), model.points + 1, axes))
    for b, pose in enumerate(poses):
        place = np.empty((len(out_time_s), axes))
        places(time_s, pose, np.ascontiguousarray(out_time_s, dtype=float), place)
        out[b : b + 1 if len(poses) > 1 else None, :, 0] = place
    status = _run(batch.observing(out=out))[1]
    if len(status) and (status == NO_REST_SHAPE).all():
        raise StrandcastError(
            "SC-E003",
            f"no rest shape was found for any of {len(status)} strings: their motion cannot begin there",
            fix="check the string's stiffness and rest curl, and that it reaches from clamp to clamp",
            exit_code=FAILED_TRIALS,
        )
    for b in map(int, np.flatnonzero(status == BLEW_UP)):
        out[b, np.isnan(out[b, :, -1, 0])] = np.nan
    return out, status


def evaluate_batch(
    model: StringModel,
    strings: StringBatch,
    hand: HandPath,
    measured: MeasuredPoints,
    start: StringStart = HANGING_AT_REST,
    *,
    shift_m: Array | None = None,
) -> tuple[Array, NDArray[np.int64]]:
    """Weighted distance between measured points and B strings, without keeping a position.

    Parameters
    ----------
    model, strings, start
        As for `simulate_batch`.
    hand
        One common path.
    measured
        What the strings are compared with.
    shift_m
        (B, 2 or 3) added to each string's points [m].

    Returns
    -------
    values
        (B,) sum of weight times distance; infinite after a blow-up.
    status
        (B,) keys of `STATUS`.
    """
    batch = make_batch(model, strings, hand, measured.time_s, start)
    used = rows_of(measured.per_metre, len(measured.time_s), model.points)
    axes = 3 if in_space(batch.hand.pose) else 2
    if len(batch.hand.pose) > 1 or np.shape(measured.points_m) != (*used.shape, axes):
        raise ValueError(f"one path of the hand and points of shape {(*used.shape, axes)} are compared")
    points_m = np.where(used[..., None] > 0, measured.points_m, 0.0)
    if np.isnan(points_m).any():
        raise ValueError("a point that was not measured has a weight")
    if shift_m is not None:
        shift = rows_of(shift_m, len(strings), axes)
        batch = batch._replace(candidates=batch.candidates._replace(shift_m=shift))
    kept, status = _run(batch.observing(measured=points_m, per_metre=used))
    values = kept[:, VALUE]
    return np.where((status == BLEW_UP) | np.isnan(values), np.inf, values), status


def _run(batch: Batch) -> tuple[Array, NDArray[np.int64]]:
    """Simulate candidates, and diverged ones again with smaller steps; return results and status.

    In a snap a segment may turn by half a radian within a step. If a string that is too stiff to be stretched
    by its loads is overstretched all the same, the scheme failed, not the physics.
    """
    model, candidates = batch.model, batch.candidates
    kept = _pass(batch, 1)
    status = _status(model, kept)
    stiff = candidates.parameters[:, 0] * model.dt_s**2 > _STIFF * candidates.masses.min(axis=1)
    stiff |= in_space(batch.hand.pose) & (status == BLEW_UP)
    finer = 2
    while (
        finer <= SMALLEST_STEP
        and (diverged := np.flatnonzero(stiff & ~np.isin(status, (OK, NO_REST_SHAPE)))).size
    ):
        again = batch.take(diverged)
        kept[diverged] = _pass(again, finer)
        status[diverged] = _status(model, kept[diverged])
        if len(batch.outputs.out):
            batch.outputs.out[diverged] = again.outputs.out
        finer *= 2
    return kept, status


def _pass(batch: Batch, finer: int) -> Array:
    """Run candidates once, with steps `finer` times smaller than the model's; return their results."""
    model, candidates, hand = batch.model, batch.candidates, batch.hand
    spec, ends = vector_spec(model.precision), hand.pose.shape[2] // POSE  # clamps; none in the plane
    kept = np.empty((len(candidates.masses), RESULTS))
    if not len(kept):
        return kept
    sticks = candidates.fixed[:, STICK] > 0.0
    settings = _settings(model, candidates.fixed, model.dt_s / finer, ends)
    steps, own = batch.steps * finer, len(hand.pose) > 1
    if ends:
        axes, path_rows, drive_hand, kernel = 3, steps * ends * CLAMP, drive_clamps, integrate_in_space
        strings, lost = ready_in_space(candidates, hand.pose[:, 0], batch.start, settings)
    else:
        axes, path_rows, drive_hand, kernel = 2, steps * DRIVING, drive, integrate
        strings, lost = ready(candidates, hand.pose, batch.start, settings), np.zeros(len(kept), dtype=bool)
    common = np.empty((1 if own else path_rows, 1))
    if not own:
        drive_hand(hand.time_s, hand.pose[0], settings.step, steps, 0, common)
    outputs = batch.outputs._replace(at=batch.outputs.at * finer)

    def run(first: int, last: int) -> None:
        own_rows = path_rows if own else 0
        work = workspace(spec, model.points, axes, own_rows, sticks=bool(sticks.any()))
        kernel(first, last, spec, work, strings, hand, common, steps, settings, outputs, kept)

    over_ranges(-(-len(kept) // spec.width), run)
    kept[lost, SHORTEST] = NO_LENGTH_M
    return kept


def _settings(model: StringModel, fixed: Array, step_s: float, ends: int) -> StepSettings:
    """Return what steps of candidates with the columns `fixed` have in common; `ends`: of clamps in space."""
    slender = bool(fixed[:, DRAG_ALONG].max() > 0.0)
    return StepSettings(
        step=step_s,
        share=1.0,
        l0=float(fixed[0, SPACING]),
        gravity=float(fixed[0, GRAVITY]),
        reading=READINGS.index(model.reading),
        per_width=float(1.0 / fixed[0, HALF_WIDTH]),
        has_friction=bool(fixed[fixed[:, STICK] <= 0.0, DRY].any()),
        slender=slender if ends else (slender or None),
        two_ends=ends > 1,
        helical=ends > 0 and bool(fixed[:, REST_TURN].any()),
    )


def _status(model: StringModel, kept: Array) -> NDArray[np.int64]:
    longest, shortest = kept[:, LONGEST] / model.spacing_m, kept[:, SHORTEST] / model.spacing_m
    status = np.full(len(kept), OK)
    status[shortest < SHORTEST_SEGMENT] = COLLAPSED
    status[longest > LONGEST_SEGMENT] = OVERSTRETCHED
    status[~(kept[:, LONGEST] < FAR_M)] = BLEW_UP
    status[kept[:, SHORTEST] == NO_LENGTH_M] = NO_REST_SHAPE
    return status
