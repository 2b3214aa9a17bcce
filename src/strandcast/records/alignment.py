"""alignment.json and hand.parquet: offset and drift between the clocks, and the paths of the hand."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from strandcast.core.pose import Pose
from strandcast.errors import StrandcastError
from strandcast.records.record import Part, Record, RigFault, refusal
from strandcast.records.tables import Column, TableSpec, read_table

HAND = TableSpec(
    "strandcast/hand",
    {
        "source": Column("str", "1"),  # "commanded", "measured" or "seen"
        "robot_time_s": Column("f8", "s"),
        "x_m": Column("f8", "m"),
        "y_m": Column("f8", "m"),
    },
    # In the plane the hand has an angle. In space the first driven end has what is known of its pose, and
    # a second one too.
    optional={
        "angle_rad": Column("f8", "rad"),
        "z_m": Column("f8", "m"),
        **{f"far_{axis}_m": Column("f8", "m") for axis in "xyz"},
        **{
            f"{end}{name}_{axis}": Column("f8", "1")
            for end in ("", "far_")
            for name in ("direction", "normal")
            for axis in "xyz"
        },
    },
)


class EndPath(NamedTuple):
    """The path of a driven end, each (T, 3), in the plane (T, 2).

    Where the string leaves it [m], and the direction in which it holds the string, away from it, of any
    length; without, it is only a point. A normal, not along the direction, turns with it; None: not measured.
    """

    place_m: np.ndarray
    direction: np.ndarray | None = None
    normal: np.ndarray | None = None


class HandMarkerFit(Part):
    """One marker of the hand: its offset from the arm's file, and how many of its detections were wrong."""

    marker: int
    shift_m: list[float]
    turn_rad: float
    sightings: int
    wrong: int


class SyncCheck(Part):
    """An event on both clocks, compared with the hand's motion: difference = motion − event."""

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
    known_drift: float = 0.0  # mean of that prior
    residual_rms_m: float | None
    frames: int
    motion_start_s: float  # robot time
    motion_end_s: float
    # Offset of the markers on the hand from the arm's file: their mean, and each.
    marker_shift_m: list[float] | None = None
    marker_turn_rad: float | None = None
    markers: list[HandMarkerFit] = []
    # Other constant errors of the rig, fitted within priors: the arm's base, joint zeros, link lengths, the
    # camera's scale along x and y and its shear.
    base_shift_m: list[float] | None = None
    joint_zero_rad: list[float] | None = None
    link_length_m: list[float] | None = None
    stretch: list[float] | None = None
    # The smallest standard error of the offset, in the middle of the detections, and its camera time.
    middle_se_s: float | None = None
    middle_camera_time_s: float | None = None
    unaided_se_s: float | None = None  # the same with priors of the rig's constants ten times wider
    slow_error_m: float | None = None  # marker errors that neighbouring frames share
    wrong_rows: int | None = None  # rows of the joint log left out: late, repeated or wrong
    sync_events: list[SyncCheck] = []
    camera: str = "main"  # the camera of this clock
    warnings: list[str] = []
    faults: list[RigFault] = []  # those of the warnings that are about the arm and its files

    def robot_time_s(self, camera_time_s: np.ndarray) -> np.ndarray:
        """Return robot time for camera time."""
        return camera_time_s * (1.0 + self.drift) + self.offset_s


def read_hand(path: str | Path, source: str) -> tuple[np.ndarray, Pose]:
    """Return one path of the hand in the plane: robot times (T,) [s] and poses (T,)."""
    rows = read_table(path, HAND)
    if "angle_rad" not in rows:
        what = "the column is missing: the hand is not one in the plane"
        raise refusal("SC-R001", path, "angle_rad", what, "supply track and hand of the same kind")
    mine = rows["source"] == source
    if not mine.any():
        there = ", ".join(sorted(set(rows["source"])))
        raise StrandcastError(
            "SC-R021",
            f"holds no {source} path of the hand (there is: {there or 'none'})",
            file=path,
            field="source",
            fix=f"supply its path with source: {source}",
        )
    position_m = np.column_stack([rows["x_m"][mine], rows["y_m"][mine]])
    return rows["robot_time_s"][mine], Pose(position_m, rows["angle_rad"][mine])


def read_hand_in_space(path: str | Path, *, thrown: bool) -> tuple[np.ndarray, list[EndPath]]:
    """Return robot times (T,) [s] and the paths of the driven ends of a string in space.

    Of a throw it is one, the arm's hand, with its direction and normal; there are none in the plane.
    """
    rows = read_table(path, HAND)
    ends = ends_of(rows)
    if thrown and (len(ends) != 1 or any(part is None for part in ends[0])):
        what = "the columns are not those of one end with its direction and normal"
        raise refusal("SC-R001", path, "normal_x", what, "import the track of the throw again")
    return rows["robot_time_s"], ends


def end_columns(ends: Sequence[EndPath]) -> dict[str, np.ndarray]:
    """Return the columns of hand.parquet for the driven ends of a string in space, one or two."""
    columns: dict[str, np.ndarray] = {}
    for prefix, end in zip(("", "far_"), ends, strict=False):
        columns |= {f"{prefix}{axis}_m": end.place_m[:, k] for k, axis in enumerate("xyz")}
        for name, path in (("direction", end.direction), ("normal", end.normal)):
            if path is not None:
                columns |= {f"{prefix}{name}_{axis}": path[:, k] for k, axis in enumerate("xyz")}
    return columns


def ends_of(rows: Mapping[str, np.ndarray]) -> list[EndPath]:
    """Return the driven ends in rows of hand.parquet; none for a hand in the plane."""

    def path(stem: str, unit: str = "") -> np.ndarray | None:
        names = [f"{stem}{axis}{unit}" for axis in "xyz"]
        return np.column_stack([rows[name] for name in names]) if names[-1] in rows else None

    places = [(prefix, path(prefix, "_m")) for prefix in ("", "far_")]
    return [
        EndPath(place_m, path(f"{prefix}direction_"), path(f"{prefix}normal_"))
        for prefix, place_m in places
        if place_m is not None
    ]
