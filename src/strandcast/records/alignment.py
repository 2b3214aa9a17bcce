"""alignment.json and hand.parquet: the camera's clock on the robot's, and the hand's path."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.record import Part, Record
from strandcast.records.tables import Column, TableSpec, read_table

HAND = TableSpec(
    "strandcast/hand",
    {
        "source": Column("str", "1"),  # "commanded", "measured" or "seen"
        "robot_time_s": Column("f8", "s"),
        "x_m": Column("f8", "m"),
        "y_m": Column("f8", "m"),
        "angle_rad": Column("f8", "rad"),
    },
)


class MarkerFit(Part):
    """One marker of the hand: where it sits against the arm's file, and how many sightings were wrong."""

    marker: int
    shift_m: list[float]
    turn_rad: float
    sightings: int
    wrong: int


class SyncCheck(Part):
    """An event that both clocks saw, held against the hand's motion: difference = motion − event."""

    camera_time_s: float
    robot_time_s: float
    sigma_s: float
    difference_s: float
    motion_se_s: float
    kind: str = "any"
    used: bool = True  # in the fit


class Alignment(Record):
    """robot_time_s = camera_time_s · (1 + drift) + offset_s."""

    SCHEMA: ClassVar[str] = "strandcast/alignment"

    experiment: str
    trial: int
    source: str  # "fit", "event" (the hand does not move) or "supplied"
    offset_s: float
    offset_se_s: float | None
    drift: float
    drift_se: float | None
    drift_prior: float | None  # standard deviation of the prior, if one was used
    known_drift: float = 0.0  # what that prior is about
    residual_rms_m: float | None
    frames: int
    motion_start_s: float  # robot time
    motion_end_s: float
    # Where the markers sit on the hand, against the arm's file: in the mean, and each.
    marker_shift_m: list[float] | None = None
    marker_turn_rad: float | None = None
    markers: list[MarkerFit] = []
    # Other constant errors of the rig that the fit freed within priors: the arm's base, the joints' zeros,
    # the links' lengths, the camera's scale along x and y and its shear.
    base_shift_m: list[float] | None = None
    joint_zero_rad: list[float] | None = None
    link_length_m: list[float] | None = None
    stretch: list[float] | None = None
    # The standard error where it is least, in the middle of the sightings, and that camera time.
    middle_se_s: float | None = None
    middle_camera_time_s: float | None = None
    unaided_se_s: float | None = None  # the same, were the rig's constants known ten times less
    slow_error_m: float | None = None  # size of errors of the markers' places that neighbouring frames share
    wrong_rows: int | None = None  # of the joint log, late, repeated or wrong: left out
    sync_events: list[SyncCheck] = []
    warnings: list[str] = []

    def robot_time_s(self, camera_time_s: np.ndarray) -> np.ndarray:
        """Return robot time for camera time."""
        return camera_time_s * (1.0 + self.drift) + self.offset_s


def read_hand(path: str | Path, source: str) -> tuple[np.ndarray, np.ndarray]:
    """Return one path of the hand: robot_time_s (T,) and pose (T, 3) = x_m, y_m, angle_rad."""
    rows = read_table(path, HAND)
    mine = rows["source"] == source
    if not mine.any():
        there = ", ".join(sorted(set(rows["source"])))
        raise StrandcastError(
            "SC-R022",
            f"holds no {source} path of the hand (there is: {there or 'none'})",
            file=path,
            field="source",
            fix="choose another with estimate.joints in experiment.yaml",
        )
    pose = np.column_stack([rows["x_m"][mine], rows["y_m"][mine], rows["angle_rad"][mine]])
    return rows["robot_time_s"][mine], pose
