"""A measured throw, cut to the part that is simulated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from strandcast.config.estimate import EstimateSettings
from strandcast.dynamics.batch import HANGING_AT_REST, HandPath, StringStart
from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.estimation.evaluation import Array
from strandcast.estimation.measured import Throw, motion_start_s, moved_to_hand, observed_start


@dataclass(frozen=True, eq=False)
class PreparedThrow:
    """A throw cut to its simulated part: from shortly before the motion to the last frame.

    Attributes
    ----------
    frames
        (G,) indices of the throw's frames that are simulated.
    time_s, points_m, weight
        (G,), (G, n+1, 2 or 3) and (G, n): their times, measured points, weights in E (0 for frames not used).
    hand
        The hand's path from the start on.
    start
        Observed shape and velocity at the start, or hanging at rest.
    places
        (m,) of the measured points along the string, 0 to 1, where they lie between mass points. None: the
        mass points themselves were measured.
    """

    frames: np.ndarray
    time_s: Array
    points_m: Array
    weight: Array
    hand: HandPath
    start: StringStart = HANGING_AT_REST
    places: Array | None = None

    @property
    def seen_m(self) -> Array:
        """Measured points (G, n+1, 2 or 3) [m], the hand's and those with a weight in E; NaN for others."""
        return np.where(np.insert(self.weight > 0, 0, True, axis=1)[..., None], self.points_m, np.nan)

    def as_measured(self, points: Array, shift: Array | None = None) -> Array:
        """Return the hand and the measured points (..., m+1, c) of simulated points (..., n+1, c).

        With `shift` (B,) of the measured points along the string, the simulated ones are (B, G, n+1, c).
        """
        if self.places is None:
            return points
        shares = CubicSpline(np.linspace(0.0, 1.0, points.shape[-2]), np.eye(points.shape[-2]))
        if shift is None or not shift.any():
            markers = np.moveaxis(np.tensordot(points, shares(self.places), axes=(-2, 1)), -1, -2)
        else:
            markers = shares(self.places + shift[:, None])[:, None] @ points
        return np.concatenate([points[..., :1, :], markers], axis=-2)

    def until(self, share: float) -> PreparedThrow:
        """Return this throw up to the first `share` of its used frames."""
        used = np.flatnonzero(self.weight.any(axis=1))
        return self._take(slice(used[max(round(share * len(used)), 1) - 1] + 1))

    def part(self, part: int, parts: int) -> PreparedThrow:
        """Return this throw with weights in only one of `parts` equal spans of its used frames."""
        used = np.flatnonzero(self.weight.any(axis=1))
        span = np.array_split(used, parts)[part]
        weight = np.zeros_like(self.weight)
        weight[span] = self.weight[span]
        return replace(self, weight=weight)

    def fitted(self) -> PreparedThrow:
        """Return this throw without the frames after the last used one."""
        return self._take(slice(np.flatnonzero(self.weight.any(axis=1))[-1] + 1))

    def thinned(self, most: int) -> PreparedThrow:
        """Return this throw with every k-th of its frames, such that at most `most` remain."""
        return self._take(slice(0, None, max(-(-len(self.time_s) // most), 1)))

    def _take(self, kept: slice) -> PreparedThrow:
        columns = {name: getattr(self, name)[kept] for name in ("frames", "time_s", "points_m", "weight")}
        return replace(self, **columns)


class TrialParts(NamedTuple):
    """What a fit takes of its trials, in the plane or in space.

    Attributes
    ----------
    throws, trial
        The parts that are fitted, and (P,) the number of the trial of each, 0 to `trials` - 1.
    trials
        How many trials there are, also without a fitted part.
    whole
        The whole trials of the fit, with or without a fitted part, the newest last.
    before
        The same without the last part of the newest trial; None: parts of it are left out in other ways.
    """

    throws: tuple[PreparedThrow, ...]
    trial: np.ndarray
    trials: int
    whole: tuple[PreparedThrow, ...]
    before: TrialParts | None = None

    @property
    def newest(self) -> PreparedThrow:
        """The whole newest trial."""
        return self.whole[-1]

    def shares(self, older_trials_weight: float) -> Array:
        """Return the shares (P,) in E, by the weight of a trial relative to the next one."""
        weights = older_trials_weight ** (self.trials - 1 - self.trial)
        return np.asarray(weights / weights.sum())


StartOf = Callable[[Throw, Array, float], StringStart]


def parts_of_throws(
    throws: Sequence[Throw],
    places_m: Array,
    settings: EstimateSettings,
    start_of: StartOf = observed_start,
) -> TrialParts:
    """Return throws in the plane, the newest last, as the fit takes them; see `prepare`."""
    shifted = settings.camera_offset_sd_m is not None
    kept = throws[-1:] if settings.trials == "latest" else throws
    prepared = [
        prepare(throw, places_m, settings.start_shape, start_of, from_measured_hand=shifted) for throw in kept
    ]
    if "marker_shift" in settings.forces:
        places = places_m[1:] / places_m[-1]
        prepared = [replace(throw, places=places) for throw in prepared]
    trial = np.arange(len(throws) - len(kept), len(throws))
    return TrialParts(tuple(throw.fitted() for throw in prepared), trial, len(throws), tuple(prepared))


def prepare(
    throw: Throw,
    places_m: Array,
    start_shape: str = "observed",
    start_of: StartOf = observed_start,
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
        ``observed``: the directions of the string in the frames before the motion, and its sway; ``hanging``:
        at rest under gravity.
    start_of
        Finds the observed shape and velocity; `cable_series.captured_start` of captures.
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
        start = start_of(placed, places_m, float(start_s))
    hand = HandPath(throw.hand_time_s[first:], throw.hand_pose[first:])
    return PreparedThrow(frames, throw.time_s[frames], throw.points_m[frames], weight, hand, start)


def _weights(throw: Throw) -> Array:
    """(F, n) weights of the free points: confidence where used and measured, else 0."""
    confidence = np.ones(throw.points_m.shape[:2]) if throw.confidence is None else throw.confidence
    measured = ~np.isnan(throw.points_m).any(axis=2)
    return np.asarray(np.where(measured & throw.used[:, None], np.nan_to_num(confidence), 0.0)[:, 1:])
