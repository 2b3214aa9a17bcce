"""Measured throws, cut to the part that is simulated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from strandcast.dynamics.batch import HANGING_AT_REST, HandPath, StringStart
from strandcast.estimation.evaluation import Array


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
        shares = scipy.interpolate.CubicSpline(
            np.linspace(0.0, 1.0, points.shape[-2]), np.eye(points.shape[-2])
        )
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
