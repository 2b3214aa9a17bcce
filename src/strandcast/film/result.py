"""A tracked string of a film: its points in pixels and metres, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from strandcast.records.manifest import VideoFacts
from strandcast.records.track import OCCLUDED, PREDICTED, SUPPLIED

if TYPE_CHECKING:
    import pandas as pd

MOSTLY = 0.5  # chosen: share of doubtful frames above which the user is warned


@dataclass(frozen=True, eq=False)
class FilmTrack:
    """A string through a film: F frames, n + 1 points from the held end (0) to the other.

    Attributes
    ----------
    time_s
        (F,) on the camera's clock, from the first frame.
    points_px
        (F, n + 1, 2) pixels, u to the right, v down, whole at a pixel's middle; NaN where not found.
    points_m
        (F, n + 1, 2) metres, y up; None without a scale. The origin is the held end in the first frame that
        shows it, or that of the camera's record.
    sigma_px, flags
        (F, n + 1) standard deviation per axis; bits as in track.parquet, 8 for a place by hand.
    length
        (F,) from the held end to the visible end, in metres, or in pixels without a scale; if both ends are
        held, the length that all frames show.
    m_per_px
        Metres per pixel, at the middle of the picture; None without a scale.
    assumed
        What was found or assumed, in words.
    warnings
        For the user.
    """

    video: Path
    facts: VideoFacts
    time_s: np.ndarray
    points_px: np.ndarray
    points_m: np.ndarray | None
    sigma_px: np.ndarray
    flags: np.ndarray
    length: np.ndarray
    m_per_px: float | None
    assumed: dict[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def unit(self) -> str:
        """Return the unit of lengths: m, or px without a scale."""
        return "px" if self.points_m is None else "m"

    @property
    def points(self) -> np.ndarray:
        """Return the points in that unit, y up."""
        return self.points_px * (1.0, -1.0) if self.points_m is None else self.points_m

    def doubtful(self) -> np.ndarray:
        """Return which frames (F,) have a point that is flagged or was not found."""
        return np.asarray((self.confidence()[:, 1:] < 1.0).any(axis=1))

    def advice(self) -> tuple[str, ...]:
        """Return the warnings, with one more where most frames are doubtful."""
        share = float(self.doubtful().mean())
        if share <= MOSTLY:
            return self.warnings
        return (
            *self.warnings,
            f"{100 * share:.0f} % of the frames are doubtful: look whether the string was followed at all; "
            "--held, and --length with --scale, help to find it",
        )

    def end_speed(self) -> np.ndarray:
        """Return the speed of the end (F,), in units per second, by central differences."""
        return np.asarray(np.linalg.norm(np.gradient(self.points[:, -1], self.time_s, axis=0), axis=1))

    def curvature(self) -> np.ndarray:
        """Return the curvature (F, n + 1) at each point, per unit, positive to the left; NaN at both ends."""
        along = np.diff(self.points, axis=1)
        before, after = along[:, :-1], along[:, 1:]
        turn = np.arctan2(
            before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0], (before * after).sum(axis=2)
        )
        step = np.linalg.norm(along, axis=2)
        curved = np.full(self.flags.shape, np.nan)
        curved[:, 1:-1] = turn / (0.5 * (step[:, :-1] + step[:, 1:]))
        return curved

    def confidence(self) -> np.ndarray:
        """Return a rank (F, n + 1): 1 measured or by hand, 0.5 unsure, 0.2 inferred, 0 not found."""
        doubt = self.flags & ~SUPPLIED
        rank = np.where(doubt == 0, 1.0, np.where(doubt & (OCCLUDED | PREDICTED), 0.2, 0.5))
        return np.where(np.isfinite(self.points_px).all(axis=2), rank, 0.0)

    def table(self) -> pd.DataFrame:
        """Return a row for each frame and point; units are in the columns' names."""
        import pandas as pd

        frame, point = (index.ravel() for index in np.indices(self.flags.shape))
        columns = {"frame": frame, "time_s": self.time_s[frame], "point": point}
        columns |= dict(zip(("u_px", "v_px"), self.points_px.reshape(-1, 2).T, strict=True))
        if self.points_m is not None:
            columns |= dict(zip(("x_m", "y_m"), self.points_m.reshape(-1, 2).T, strict=True))
        columns |= {
            "sigma_px": self.sigma_px.ravel(),
            f"curvature_1_{self.unit}": self.curvature().ravel(),
            "confidence": self.confidence().ravel(),
            "flags": self.flags.ravel(),
        }
        return pd.DataFrame(columns)
