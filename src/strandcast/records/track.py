"""track.parquet, markers.parquet and track.json: the tracked string, the hand's markers, a summary."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.record import Part, Record, RigFault, refusal
from strandcast.records.tables import Column, TableSpec, fitting, read_table, scattered

# By column, the axes that a covariance is of.
COVARIANCE = {"var_xx_m2": (0, 0), "cov_xy_m2": (0, 1), "var_yy_m2": (1, 1)}
COVARIANCE_IN_SPACE = COVARIANCE | {"cov_xz_m2": (0, 2), "cov_yz_m2": (1, 2), "var_zz_m2": (2, 2)}
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
    # A track in space has a third coordinate; a supplied one may come without covariance.
    optional={"z_m": Column("f8", "m"), **{name: Column("f8", "m2") for name in COVARIANCE_IN_SPACE}},
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

AXES = ("x_m", "y_m", "z_m")
LONGEST_PLACE = 1.001  # of a marker, over the string's length: places are rounded; chosen


def is_in_space(columns: Iterable[str]) -> bool:
    """Return whether a table of points with these columns is in space."""
    return AXES[2] in columns


# Bits of `flags`.
UNSURE = 1  # detected, but the place along or across the string is doubtful
OCCLUDED = 2  # hidden by the arm or by the string itself; the place is inferred
PREDICTED = 4  # not detected; the place is a prediction
SUPPLIED = 8  # measured elsewhere and imported


class DetectedWeight(Part):
    """A weight detected on the string: the distance of its middle from the clamp, and half its width."""

    place_m: float
    sigma_m: float
    half_width_m: float


class DetectedSection(Part):
    """A long stretch of the string with another width, such as a pipe."""

    from_m: float
    from_sigma_m: float
    to_m: float
    to_sigma_m: float
    width_m: float
    stiff: bool | None = None  # stays straight while the rest of the string bends; None: unknown


class DetectedTarget(Part):
    """The detected target, and its offset from `target_m`."""

    place_m: list[float]
    sigma_m: float
    offset_m: list[float]  # detected minus given
    radius_m: float
    kind: str  # "round" or "marker"


class Contact(Part):
    """The tip touches the target: when their outlines meet, and the evidence."""

    frame: int
    camera_time_s: float
    distance_m: float  # least, of the tip's path in this passage
    evidence: list[str]  # of "outlines", "tip", "target"; outlines alone may be a passage before the target


class DetectedSwitch(Part):
    """One switching of the LED by the robot."""

    kind: str  # "led_on" or "led_off"
    camera_time_s: float
    sigma_s: float


class DetectedLed(Part):
    """The brightness in the window of the LED that the robot switches (`align.led`)."""

    window_px: list[int]  # left, top, right, bottom; the last two are exclusive
    brightness_grey: list[float]  # mean over the window, by frame
    # None if the brightness stays at one level.
    dark_grey: float | None = None
    lit_grey: float | None = None
    noise_grey: float | None = None
    burnt: bool = False  # the LED saturates the camera
    events: list[DetectedSwitch] = []
    rejected: list[str] = []  # other changes, and why they are not the LED's


class TrackSummary(Record):
    """Summary of the tracking: frame counts against the manifest, quality, automatic choices."""

    SCHEMA: ClassVar[str] = "strandcast/track-summary"

    experiment: str
    trial: int
    source: str  # "video" or "supplied"
    points: int
    length_m: float
    decoded_frames: int
    expected_frames: int
    tracked_fraction: float  # of frames × points, detected without any flag
    tip_fraction: float  # of frames with the tip detected
    marker_fraction: float  # of frames with the hand's marker detected
    median_sigma_m: float
    choices: dict[str, float | int | str | bool | None]  # every automatic choice, by name
    cameras: list[str] = ["main"]  # that filmed it; none where it was supplied
    warnings: list[str]
    faults: list[RigFault] = []  # those of the warnings that the film proves
    tip_sigma_m: float = 0.0  # standard error of the tip, per axis, that all frames have in common
    weights: list[DetectedWeight] = []
    sections: list[DetectedSection] = []
    target: DetectedTarget | None = None
    contact: Contact | None = None
    led: DetectedLed | None = None

    def places_m(self, length_m: float | None = None) -> np.ndarray:
        """Return the distance of each point from the clamp (n+1,), a marker's own where it was imported.

        Other points are even along the string, of `length_m` where that was corrected since.
        """
        even_m = np.linspace(0.0, length_m or self.length_m, self.points + 1)
        own = [self.choices.get(f"point_{k}_place_m") for k in range(self.points + 1)]
        return np.array([float(m if own_m is None else own_m) for own_m, m in zip(own, even_m, strict=True)])


@dataclass(eq=False)
class Track:
    """A track as arrays, F frames of n + 1 mass points, 0 the hand."""

    frame: np.ndarray  # (F,)
    camera_time_s: np.ndarray  # (F,)
    points_m: np.ndarray  # (F, n+1, 2) in the plane of motion, (F, n+1, 3) in space; NaN where not detected
    sigma_m: np.ndarray  # standard error per axis, (F, n+1)
    flags: np.ndarray  # bits, (F, n+1)
    covariance_m2: np.ndarray | None = None  # (F, n+1, 2, 2) or (F, n+1, 3, 3)

    def detected(self) -> np.ndarray:
        """Return which points were detected, (F, n+1), not inferred or predicted."""
        return np.asarray(
            np.isfinite(self.points_m).all(axis=2) & ((self.flags & (OCCLUDED | PREDICTED)) == 0)
        )

    def detected_m(self) -> np.ndarray:
        """Return the points (F, n+1, 2 or 3), NaN where they were not detected."""
        return np.where(self.detected()[..., None], self.points_m, np.nan)

    def rows(self, used: np.ndarray) -> "Track":
        """Return the frames of a mask (F,)."""
        return Track(
            self.frame[used],
            self.camera_time_s[used],
            self.points_m[used],
            self.sigma_m[used],
            self.flags[used],
            None if self.covariance_m2 is None else self.covariance_m2[used],
        )

    def columns(self) -> dict[str, np.ndarray]:
        """Return the rows of track.parquet: one per frame and point that has a place."""
        frame, point = np.nonzero(np.isfinite(self.points_m).all(axis=2))
        columns = {
            "frame": self.frame[frame],
            "camera_time_s": self.camera_time_s[frame],
            "point": point,
            "sigma_m": self.sigma_m[frame, point],
            "flags": self.flags[frame, point],
        }
        columns |= dict(zip(AXES, np.moveaxis(self.points_m[frame, point], -1, 0), strict=False))
        if self.covariance_m2 is not None:
            covariance_m2 = self.covariance_m2[frame, point]
            of_axes = covariance_columns(covariance_m2.shape[-1])
            columns |= {name: covariance_m2[:, a, b] for name, (a, b) in of_axes.items()}
        return columns


def covariance_columns(axes: int) -> dict[str, tuple[int, int]]:
    """Return the columns of covariances of points with two or three axes, and the axes that each is of."""
    return COVARIANCE_IN_SPACE if axes == len(AXES) else COVARIANCE


def read_track(path: str | Path, points: int) -> Track:
    """Read track.parquet as arrays over its frames, for n = `points` free mass points; NaN without a row."""
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
    of_axes = covariance_columns(2 + is_in_space(rows))
    missing = [name for name in of_axes if name not in rows]
    if 0 < len(missing) < len(of_axes):
        what = "the column is missing, but others of the covariance are there"
        raise refusal(
            "SC-R001", path, ", ".join(missing), what, "supply all columns of the covariance, or none"
        )
    with fitting(path):
        return _track_of(rows, points)


def _track_of(rows: dict[str, np.ndarray], points: int) -> Track:
    frame, first, place = np.unique(rows["frame"], return_index=True, return_inverse=True)
    shape, at = (len(frame), points + 1), (place, rows["point"])
    axes = [name for name in AXES if name in rows]
    points_m = scattered((*shape, len(axes)), at, np.stack([rows[name] for name in axes], axis=-1))
    sigma_m, flags = scattered(shape, at, rows["sigma_m"]), scattered(shape, at, rows["flags"], fill=0)
    covariance_m2 = None
    if "var_xx_m2" in rows:
        symmetric = np.empty((len(rows["point"]), len(axes), len(axes)))
        for name, (a, b) in covariance_columns(len(axes)).items():
            symmetric[:, a, b] = symmetric[:, b, a] = rows[name]
        covariance_m2 = scattered((*shape, len(axes), len(axes)), at, symmetric)
    return Track(frame, rows["camera_time_s"][first], points_m, sigma_m, flags, covariance_m2)
