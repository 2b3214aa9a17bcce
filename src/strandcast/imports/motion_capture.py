"""Import motion capture, the hand's pose and markers on the string, as track, hand and alignment."""

from pathlib import Path

import numpy as np

from strandcast.arm.load import Arm
from strandcast.core.pose import Pose
from strandcast.errors import StrandcastError
from strandcast.imports.capture_table import read_capture, times_of, with_units
from strandcast.imports.mapping import ANGLE_UNITS, CaptureMapping
from strandcast.imports.table import NumberTable
from strandcast.imports.track_checks import check_track
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.files import sha256_file
from strandcast.records.record import refusal
from strandcast.records.tables import write_table
from strandcast.records.track import SUPPLIED, TRACK, Track, TrackSummary

BEYOND_REACH, FAR_OFF = 1.1, 10.0  # of the arm's reach: an origin elsewhere, and a wrong unit
BEYOND = (
    "give places in metres along the string, from where it leaves the clamp or the body; or correct "
    "string.length_m in experiment.yaml"
)
UNSEEN = "leave it out, or name the columns that it has in this file"
OFF_POINT_M = 0.002  # chosen: more shows in the fit


def import_capture(
    path: str | Path,
    folder: str | Path,
    mapping: CaptureMapping,
    *,
    experiment: str,
    trial: int,
    length_m: float,
    points: int,
    arm: Arm | None = None,
    aimed: bool = True,
) -> TrackSummary:
    """Write track.parquet, track.json, hand.parquet and alignment.json into a trial's folder.

    Parameters
    ----------
    path
        CSV, Parquet or C3D: one row per instant; an empty cell is a marker that was not detected.
    folder
        ``data/<experiment>/trial-NN``.
    mapping
        The columns, units and places; see `strandcast.imports.mapping`.
    experiment, trial
        Experiment and trial of the records.
    length_m, points
        The string's free length and its number n of mass points. A marker becomes the point nearest to its
        place; points without a marker are absent.
    arm
        The arm that moves the hand, for its reach.
    aimed
        Whether throws of this arm are planned, so that a hand beyond its reach is worth a warning.

    Returns
    -------
    TrackSummary
        With warnings about markers between mass points, the number of points that fits them best, and those
        of `imports.track_checks`. A refused import writes nothing.
    """
    table = read_capture(path)
    mapping, _ = with_units(table, mapping)
    time_s = times_of(table, mapping)
    hand = _hand(table, mapping, time_s)
    index, warnings = points_of_markers(mapping, length_m, points, table.path)
    track = _track(table, mapping, time_s, hand, index, points)
    _refuse_unseen(track, index, mapping, table.path)
    if mapping.hand_angle is None and mapping.angle_offset_rad == 0.0:
        warnings.append(
            "no column gives the hand's angle, so the string always leaves the hand along x: "
            "if that is wrong, give the direction (--angle-offset)"
        )
    detected = np.isfinite(track.points_m).all(axis=2)
    places = {f"point_{k}_place_m": m.place_m for m, k in zip(mapping.markers, index, strict=True)}
    summary = TrackSummary(
        experiment=experiment,
        trial=trial,
        source="supplied",
        points=points,
        length_m=length_m,
        decoded_frames=len(time_s),
        expected_frames=len(time_s),
        tracked_fraction=float(detected[:, index].mean()),
        tip_fraction=float(detected[:, -1].mean()),
        marker_fraction=float(detected[:, 0].mean()),
        median_sigma_m=mapping.sigma_m,
        choices={"file": Path(path).name, "sha256": sha256_file(path)} | places,
        warnings=table.notes + warnings,
    )
    alignment = one_clock(experiment, trial, time_s, mapping.motion_start_s, mapping.motion_end_s)
    known = np.isfinite(hand.array()).all(axis=1)
    paths = {"measured": (time_s[known], hand[known])}
    summary.warnings += check_track(track, paths, alignment, summary, table.path)
    if arm is not None:
        beyond = _check_reach(hand[known].position_m, arm, table.path)
        summary.warnings += beyond if aimed else []
    write_capture(Path(folder), track, _hand_columns(time_s[known], hand[known]), alignment, summary)
    return summary


def write_capture(
    folder: Path, track: Track, hand: dict[str, np.ndarray], alignment: Alignment, summary: TrackSummary
) -> None:
    """Write the four files of an imported trial: all checks have passed."""
    # track.json marks an import as complete: it must not lie beside half of another one.
    (folder / "track.json").unlink(missing_ok=True)
    source = {"source": summary.choices["file"]}
    write_table(folder / "track.parquet", TRACK, track.columns(), source)
    write_table(folder / "hand.parquet", HAND, hand, source)
    alignment.write(folder / "alignment.json")
    summary.write(folder / "track.json")


def points_of_markers(
    mapping: CaptureMapping, length_m: float, points: int, file: Path
) -> tuple[list[int], list[str]]:
    """Return the mass point of each marker, and warnings where one lies between points.

    Raises
    ------
    StrandcastError
        A marker beyond the string, a point that does not exist, two markers on one point.
    """
    spacing_m = length_m / points
    index, off_m = [], []
    for marker in mapping.markers:
        if marker.place_m > length_m * 1.001:
            raise StrandcastError(
                "SC-I013",
                f"a marker at {marker.place_m} m lies beyond the string's {length_m:g} m",
                file=file,
                field="markers",
                fix=BEYOND,
            )
        nearest = max(1, round(marker.place_m / spacing_m))
        index.append(nearest if marker.point is None else marker.point)
        off_m.append(abs(index[-1] * spacing_m - marker.place_m))
    if max(index) > points or len(set(index)) < len(index):
        raise StrandcastError(
            "SC-I014",
            f"the markers fall on points {index} of {points}",
            file=file,
            field="markers",
            fix="each marker needs a point of its own: use more points, or name them",
        )
    if max(off_m) <= OFF_POINT_M:
        return index, []
    return index, [
        f"a marker lies {max(off_m) * 1e3:.1f} mm along the string from its mass point; "
        f"string.points: {_best_points(mapping, length_m, points)} would fit better"
    ]


def _best_points(mapping: CaptureMapping, length_m: float, points: int) -> int:
    """Return the n near the given one whose points lie nearest to the markers."""
    places = np.array([marker.place_m for marker in mapping.markers])

    def worst(n: int) -> float:
        return float(np.abs(np.round(places * n / length_m) * length_m / n - places).max())

    tried = range(max(2, points // 2), 2 * points + 1)
    return min(tried, key=lambda n: (round(worst(n), 4), abs(n - points)))


def _hand(table: NumberTable, mapping: CaptureMapping, time_s: np.ndarray) -> Pose:
    """Return the hand's poses (rows,), the angle unwrapped; NaN where it was not detected."""
    position_m = table.columns([mapping.hand_x, mapping.hand_y]) * mapping.unit_m()
    angle = np.zeros(len(time_s))
    if mapping.hand_angle is not None:
        angle = mapping.angle_sign * table.column(mapping.hand_angle) * ANGLE_UNITS[mapping.angle_unit]
    known = np.isfinite(angle)
    angle[known] = np.unwrap(angle[known])
    hand = Pose(position_m, angle + mapping.angle_offset_rad)
    if np.isfinite(hand.array()).all(axis=1).sum() < 3:
        what = "the hand was detected in fewer than three rows"
        raise refusal("SC-I001", table.path, mapping.hand_x, what, "export it again")
    return hand


def _track(
    table: NumberTable,
    mapping: CaptureMapping,
    time_s: np.ndarray,
    hand: Pose,
    index: list[int],
    points: int,
) -> Track:
    rows = len(time_s)
    points_m = np.full((rows, points + 1, 2), np.nan)
    points_m[:, 0] = hand.position_m
    for marker, point in zip(mapping.markers, index, strict=True):
        points_m[:, point] = table.columns([marker.x, marker.y]) * mapping.unit_m()
    return Track(
        np.arange(rows),
        time_s,
        points_m,
        np.full((rows, points + 1), mapping.sigma_m),
        np.full((rows, points + 1), SUPPLIED, np.int32),
    )


def one_clock(
    experiment: str, trial: int, time_s: np.ndarray, start_s: float | None = None, end_s: float | None = None
) -> Alignment:
    """Return the alignment of one clock with itself; by default, the motion is the whole capture."""
    return Alignment(
        experiment=experiment,
        trial=trial,
        source="supplied",
        offset_s=0.0,
        offset_se_s=None,
        drift=0.0,
        drift_se=None,
        drift_prior=None,
        residual_rms_m=None,
        frames=len(time_s),
        motion_start_s=float(time_s[0]) if start_s is None else start_s,
        motion_end_s=float(time_s[-1]) if end_s is None else end_s,
    )


def _hand_columns(time_s: np.ndarray, hand: Pose) -> dict[str, np.ndarray]:
    return {
        "source": np.full(len(time_s), "measured", dtype=object),
        "robot_time_s": time_s,
        "x_m": hand.position_m[:, 0],
        "y_m": hand.position_m[:, 1],
        "angle_rad": hand.angle_rad,
    }


def _refuse_unseen(track: Track, index: list[int], mapping: CaptureMapping, file: Path) -> None:
    for point, marker in zip(index, mapping.markers, strict=True):
        if np.isnan(track.points_m[:, point]).any(axis=1).all():
            raise StrandcastError(
                "SC-I021",
                f"the marker at {marker.place_m:g} m is never detected: {marker.x} and {marker.y} are empty",
                file=file,
                field="markers",
                fix=UNSEEN,
            )


def _check_reach(hand_m: np.ndarray, arm: Arm, file: Path) -> list[str]:
    """Compare the hand's farthest place with the arm's reach; return a warning or raise SC-I027."""
    reach_m = float(arm.chain.lengths_m.sum() + np.hypot(*arm.clamp.offset_m))
    far_m = float(np.hypot(*(hand_m - arm.chain.origin_m).T).max())
    words = f"the hand is up to {far_m:.3g} m from the arm's first joint, and the arm reaches {reach_m:.3g} m"
    if far_m > FAR_OFF * reach_m:
        raise refusal("SC-I027", file, "hand", words, "give the unit of lengths: length_unit in a mapping")
    return [f"{words}: check units and origin"] if far_m > BEYOND_REACH * reach_m else []
