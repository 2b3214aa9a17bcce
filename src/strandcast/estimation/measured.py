"""One measured throw as arrays: when and how the string starts, and what a fit takes of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.interpolation import resampled
from strandcast.dynamics.batch import HANGING_AT_REST, HandPath, StringStart
from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.estimation.cable_series import CableSeries
from strandcast.estimation.evaluation import Array
from strandcast.estimation.throws import PreparedThrow, TrialParts

# All chosen.
HAND_MOVED_M, HAND_TURNED_RAD, POINT_MOVED_M = 0.002, 0.01, 0.008
LEAD_S = 0.03
REST_FRAMES = 4


@dataclass(frozen=True, eq=False)
class Throw:
    """The measurements of one trial, on the robot's clock.

    Attributes
    ----------
    time_s
        (F,) time of each frame [s].
    points_m
        (F, n+1, 2) measured points [m], the hand first, NaN where not measured.
    hand_time_s, hand_pose
        (T,) and (T, 3): the hand's path, x, y [m] and the direction of the clamp [rad], unwrapped.
    used
        (F,) frames that enter E: up to the closest approach or the first contact.
    confidence
        (F, n+1) weights of the measured points, or None for equal ones.
    """

    time_s: Array
    points_m: Array
    hand_time_s: Array
    hand_pose: Array
    used: np.ndarray
    confidence: Array | None = None

    def hand_at(self, time_s: Array) -> Array:
        """Return the hand's path at times (...), linear between its samples: (..., 3)."""
        return resampled(time_s, self.hand_time_s, self.hand_pose)


def moved_to_hand(throw: Throw) -> Throw:
    """Return the throw with all points shifted by the offset of the measured hand from its path."""
    inside = (throw.time_s >= throw.hand_time_s[0]) & (throw.time_s <= throw.hand_time_s[-1])
    off = (throw.points_m[:, 0] - throw.hand_at(throw.time_s)[:, :2])[inside]
    off = off[~np.isnan(off).any(axis=1)]
    return replace(throw, points_m=throw.points_m - np.median(off, axis=0)) if len(off) else throw


def motion_start_s(throw: Throw) -> float:
    """Return when to start the simulation: shortly before hand or string leave their first places [s]."""
    pose = throw.hand_pose
    moved = np.hypot(*(pose[:, :2] - pose[0, :2]).T) > HAND_MOVED_M
    moved |= np.abs(pose[:, 2] - pose[0, 2]) > HAND_TURNED_RAD
    starts = [throw.hand_time_s[moved][0]] if moved.any() else []
    measured = ~np.isnan(throw.points_m[..., 0])
    for i in range(1, throw.points_m.shape[1]):
        at = np.flatnonzero(measured[:, i])
        if len(at) > REST_FRAMES:
            home = np.median(throw.points_m[at[:REST_FRAMES], i], axis=0)
            away = np.hypot(*(throw.points_m[at, i] - home).T) > POINT_MOVED_M
            # A single outlier is no motion.
            left = away[:-1] & away[1:]
            starts += [throw.time_s[at[:-1][left][0]]] if left.any() else []
    first_frame = int(measured.any(axis=1).argmax())
    earliest = max(throw.hand_time_s[0], throw.time_s[first_frame])
    return float(max(earliest, (min(starts) if starts else earliest) - LEAD_S))


def parts_of_throws(throws: Sequence[Throw], places_m: Array, settings: EstimateSettings) -> TrialParts:
    """Return throws in the plane, the newest last, as the fit takes them; see `prepare`."""
    shifted = settings.camera_offset_sd_m is not None
    kept = throws[-1:] if settings.trials == "latest" else throws
    prepared = [prepare(throw, places_m, settings.start_shape, from_measured_hand=shifted) for throw in kept]
    if "marker_shift" in settings.forces:
        places = places_m[1:] / places_m[-1]
        prepared = [replace(throw, places=places) for throw in prepared]
    trial = np.arange(len(throws) - len(kept), len(throws))
    return TrialParts(tuple(throw.fitted() for throw in prepared), trial, len(throws), tuple(prepared))


def prepare(
    throw: Throw,
    places_m: Array,
    start_shape: str = "observed",
    *,
    from_measured_hand: bool = False,
) -> PreparedThrow:
    """Cut a throw to its motion and find how the string started.

    Parameters
    ----------
    throw
        The measured throw.
    places_m
        (n+1,) places of the points along the string [m].
    start_shape
        ``observed``, from the frames around the start; ``hanging``: at rest under gravity.
    from_measured_hand
        The observed shape begins at the hand as the camera measures it, not as the robot reports it: for an
        unknown offset between them.

    Raises
    ------
    StrandcastError
        SC-E002 no used frame lies within the hand's path.
    """
    first = max(int(np.searchsorted(throw.hand_time_s, motion_start_s(throw) + 1e-9, side="right")) - 1, 0)
    start_s = throw.hand_time_s[first]
    inside = (throw.time_s >= start_s - 1e-9) & (throw.time_s <= throw.hand_time_s[-1] + 1e-9)
    frames = np.flatnonzero(inside)
    weight = _weights(throw)[frames]
    if not weight.any():
        raise StrandcastError(
            "SC-E002",
            "no frame with a point of the string lies within the logged path of the hand",
            exit_code=FAILED_TRIALS,
        )
    start = HANGING_AT_REST
    if start_shape == "observed":
        placed = moved_to_hand(throw) if from_measured_hand else throw
        start = observed_start(placed, places_m, float(start_s))
    hand = HandPath(throw.hand_time_s[first:], throw.hand_pose[first:])
    return PreparedThrow(frames, throw.time_s[frames], throw.points_m[frames], weight, hand, start)


def _weights(throw: Throw) -> Array:
    """(F, n) weights of the free points: confidence where used and measured, else 0."""
    confidence = np.ones(throw.points_m.shape[:2]) if throw.confidence is None else throw.confidence
    measured = ~np.isnan(throw.points_m).any(axis=2)
    return np.asarray(np.where(measured & throw.used[:, None], np.nan_to_num(confidence), 0.0)[:, 1:])


def observed_start(throw: Throw, places_m: Array, start_s: float) -> StringStart:
    """Return shape and velocity of the string at `start_s`, as `CableSeries.start` finds them."""
    seen = np.flatnonzero(np.isfinite(throw.points_m[:, 1:, 0]).any(axis=0)) + 1
    if not len(seen):
        return HANGING_AT_REST
    hand = throw.hand_at(throw.time_s)
    directions = np.column_stack([np.cos(hand[:, 2]), np.sin(hand[:, 2])])
    across = np.broadcast_to([0.0, 1.0, 0.0], (len(hand), 3))
    pose = np.hstack([_upright(hand[:, :2]), _upright(directions), across])
    places = places_m[seen] / places_m[-1]
    series = CableSeries(throw.time_s, pose, _upright(throw.points_m[:, seen]), places)
    frame = int(np.argmin(np.abs(throw.time_s - start_s)))
    if frame >= REST_FRAMES:  # nothing moves until then
        series = series.part(0, int(np.searchsorted(throw.time_s, start_s + 0.5 * LEAD_S)))
    start = series.start(frame, len(places_m) - 1)
    if start.settle or start.points_m is None or start.velocity_m_s is None:
        return HANGING_AT_REST
    shape_m, velocity_m_s = start.points_m[:, ::2], start.velocity_m_s[:, ::2]
    return StringStart(shape_m + (start_s - throw.time_s[frame]) * velocity_m_s, velocity_m_s)


def _upright(points: Array) -> Array:
    """Return points (..., 2) of the plane of motion in space (..., 3)."""
    return np.insert(points, 1, 0.0, axis=-1)
