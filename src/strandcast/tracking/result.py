"""The result of a tracker."""

from dataclasses import dataclass

import numpy as np

from strandcast.records.record import RigFault
from strandcast.records.track import Contact, DetectedLed, DetectedTarget
from strandcast.tracking.attachments.detect import NOTHING, Attachments
from strandcast.tracking.crops import SmallFrames


@dataclass(frozen=True, eq=False)
class Tracked:
    """The track of one video: F frames, n + 1 points (0 is the hand)."""

    camera_time_s: np.ndarray  # (F,) on the camera's clock
    points_m: np.ndarray  # (F, n + 1, 2) in the plane of motion; NaN where not measured
    sigma_m: np.ndarray  # (F, n + 1) standard deviation per axis
    flags: np.ndarray  # (F, n + 1), see `strandcast.records.track`
    markers: dict[str, np.ndarray]  # columns of markers.parquet
    strobe: np.ndarray  # colour picture of the throw, (height, width, 3)
    choices: dict[str, float | int | str | bool | None]  # estimates and decisions, for track.json
    warnings: tuple[str, ...] = ()  # for the user
    faults: tuple[RigFault, ...] = ()  # of the declared string, which the warnings name too
    tip_sigma_m: float = 0.0  # see `strandcast.records.track.TrackSummary`
    attachments: Attachments = NOTHING
    target: DetectedTarget | None = None
    contact: Contact | None = None
    led: DetectedLed | None = None
    small_frames: SmallFrames | None = None  # for the film on the page, which decodes the video if None

    @property
    def decoded_frames(self) -> int:
        """Return the number of frames."""
        return len(self.camera_time_s)


def marker_columns(rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of markers.parquet from rows (K, 7)."""
    names = ("frame", "camera_time_s", "marker", "x_m", "y_m", "angle_rad", "sigma_m")
    columns = {name: rows[:, i] for i, name in enumerate(names)}
    for name in ("frame", "marker"):
        columns[name] = columns[name].astype(np.int32)
    return columns
