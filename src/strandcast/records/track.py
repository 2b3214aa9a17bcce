"""track.parquet, markers.parquet and track.json: the string as the video shows it."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.record import Part, Record
from strandcast.records.tables import Column, TableSpec, read_table

TRACK = TableSpec(
    "strandcast/track",
    {
        "frame": Column("i4", "1"),
        "camera_time_s": Column("f8", "s"),
        "point": Column("i4", "1"),
        "x_m": Column("f8", "m"),
        "y_m": Column("f8", "m"),
        "sigma_m": Column("f8", "m"),
        "flags": Column("i4", "1"),
    },
)

MARKERS = TableSpec(
    "strandcast/markers",
    {
        "frame": Column("i4", "1"),
        "camera_time_s": Column("f8", "s"),
        "marker": Column("i4", "1"),
        "x_m": Column("f8", "m"),
        "y_m": Column("f8", "m"),
        "angle_rad": Column("f8", "rad"),
        "sigma_m": Column("f8", "m"),
    },
)

# Bits of `flags`.
UNSURE = 1  # seen, but the place along or across the string is doubtful
OCCLUDED = 2  # hidden by the arm or by the string itself; the place is inferred
PREDICTED = 4  # not seen at all; the place is a prediction
SUPPLIED = 8  # measured elsewhere and handed in


class SeenWeight(Part):
    """A weight that was seen on the string: its middle from the clamp on, half its width."""

    place_m: float
    sigma_m: float
    half_width_m: float


class SeenSection(Part):
    """A long stretch of the string that is seen to be of another width, as a pipe is.

    `stiff` tells whether it stays straight while the rest of the string bends; None where that does not show.
    """

    from_m: float
    from_sigma_m: float
    to_m: float
    to_sigma_m: float
    width_m: float
    stiff: bool | None = None


class SeenTarget(Part):
    """What is seen where the target should be, and how far that is from `target_m`."""

    place_m: list[float]
    sigma_m: float
    offset_m: list[float]  # seen minus given
    radius_m: float
    kind: str  # "round" or "marker"


class Contact(Part):
    """The tip meets the target: when their outlines touch, and what else speaks for it."""

    frame: int
    camera_time_s: float
    distance_m: float  # least, of the tip's path in this passage
    evidence: list[str]  # of "outlines", "tip", "target"; outlines alone may be a passage before the target


class SeenSwitch(Part):
    """The LED that the robot switches goes on or off."""

    kind: str  # "led_on" or "led_off"
    camera_time_s: float
    sigma_s: float


class SeenLed(Part):
    """What is seen where the LED should be that the robot switches (`align.led`)."""

    window_px: list[int]  # left, top, right, bottom, the last two beyond it
    brightness_grey: list[float]  # mean over the window, by frame
    # None where it keeps to one level.
    dark_grey: float | None = None
    lit_grey: float | None = None
    noise_grey: float | None = None
    burnt: bool = False  # brighter than the camera can tell
    events: list[SeenSwitch] = []
    rejected: list[str] = []  # other changes, and why they are not the LED's


class TrackSummary(Record):
    """How the tracking went: counts held against the manifest, quality, automatic choices."""

    SCHEMA: ClassVar[str] = "strandcast/track-summary"

    experiment: str
    trial: int
    source: str  # "video" or "supplied"
    points: int
    length_m: float
    decoded_frames: int
    expected_frames: int
    tracked_fraction: float  # of frames × points, seen without any flag
    tip_fraction: float  # of frames with the tip seen
    marker_fraction: float  # of frames with the hand's marker seen
    median_sigma_m: float
    choices: dict[str, float | int | str | bool | None]  # every automatic choice, by name
    warnings: list[str]
    weights: list[SeenWeight] = []
    sections: list[SeenSection] = []
    target: SeenTarget | None = None
    contact: Contact | None = None
    led: SeenLed | None = None


class Track:
    """A track as arrays: frames (F,), camera_time_s (F,), points (F, n+1, 2), sigma_m and flags (F, n+1)."""

    def __init__(
        self,
        frame: np.ndarray,
        camera_time_s: np.ndarray,
        points_m: np.ndarray,
        sigma_m: np.ndarray,
        flags: np.ndarray,
    ) -> None:
        self.frame = frame
        self.camera_time_s = camera_time_s
        self.points_m = points_m
        self.sigma_m = sigma_m
        self.flags = flags

    def seen(self) -> np.ndarray:
        """Return which points were seen, (F, n+1): a place inferred or predicted is no measurement."""
        return np.isfinite(self.points_m).all(axis=2) & ((self.flags & (OCCLUDED | PREDICTED)) == 0)

    def seen_m(self) -> np.ndarray:
        """Return the points (F, n+1, 2), NaN where they were not seen."""
        return np.where(self.seen()[..., None], self.points_m, np.nan)

    def columns(self) -> dict[str, np.ndarray]:
        """Return the rows of track.parquet: one per frame and point that has a place."""
        frame, point = np.nonzero(np.isfinite(self.points_m).all(axis=2))
        return {
            "frame": self.frame[frame],
            "camera_time_s": self.camera_time_s[frame],
            "point": point,
            "x_m": self.points_m[frame, point, 0],
            "y_m": self.points_m[frame, point, 1],
            "sigma_m": self.sigma_m[frame, point],
            "flags": self.flags[frame, point],
        }


def read_track(path: str | Path, points: int) -> Track:
    """Read track.parquet as arrays over the frames that it mentions; what is absent is NaN.

    Parameters
    ----------
    path
        The track.
    points
        The number n of free mass points; the arrays have n + 1 points, 0 the hand.
    """
    rows = read_table(path, TRACK)
    if len(rows["point"]) and not 0 <= rows["point"].min() <= rows["point"].max() <= points:
        raise StrandcastError(
            "SC-R021",
            f"has points from {rows['point'].min()} to {rows['point'].max()}, the string has 0 to {points}",
            file=path,
            field="point",
            fix="set string.points back, or track the video again",
            exit_code=INTEGRITY,
        )
    frame, first, place = np.unique(rows["frame"], return_index=True, return_inverse=True)
    count = len(frame)
    points_m = np.full((count, points + 1, 2), np.nan)
    sigma_m = np.full((count, points + 1), np.nan)
    flags = np.zeros((count, points + 1), dtype=np.int32)
    points_m[place, rows["point"], 0] = rows["x_m"]
    points_m[place, rows["point"], 1] = rows["y_m"]
    sigma_m[place, rows["point"]] = rows["sigma_m"]
    flags[place, rows["point"]] = rows["flags"]
    return Track(frame, rows["camera_time_s"][first], points_m, sigma_m, flags)
