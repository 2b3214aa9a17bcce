"""What tracking takes as known of the string, and what it gives back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from strandcast.records.track import Contact, SeenLed, SeenTarget
from strandcast.tracking.attachments import NOTHING, Attachments


@dataclass(frozen=True)
class StringHint:
    """What is known of the string: free length, number of mass points n, and its thickness if measured."""

    length_m: float
    points: int
    thickness_m: float | None = None


@dataclass
class Tracked:
    """What the pass found: arrays over F frames and n + 1 points (0 the hand); NaN where not seen.

    ``markers`` are the columns of markers.parquet. ``strobe`` is a colour picture (height, width, 3).
    """

    camera_time_s: np.ndarray
    points_m: np.ndarray
    sigma_m: np.ndarray
    flags: np.ndarray
    markers: dict[str, np.ndarray]
    strobe: np.ndarray
    decoded_frames: int
    choices: dict[str, float | int | str | bool | None]
    warnings: list[str] = field(default_factory=list)
    attachments: Attachments = NOTHING
    target: SeenTarget | None = None
    contact: Contact | None = None
    led: SeenLed | None = None


def as_columns(rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of markers.parquet from rows (K, 7)."""
    names = ("frame", "camera_time_s", "marker", "x_m", "y_m", "angle_rad", "sigma_m")
    columns = {name: rows[:, i] for i, name in enumerate(names)}
    for name in ("frame", "marker"):
        columns[name] = columns[name].astype(np.int32)
    return columns
