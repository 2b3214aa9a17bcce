"""Bring in motion capture: the hand's pose and markers along the string to track, hand and alignment."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.imports.mapping import ANGLE_UNITS, LENGTH_UNITS, TIME_UNITS, CaptureMapping
from strandcast.imports.table import NumberTable, read_numbers, refusal
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.files import sha256_file
from strandcast.records.tables import write_table
from strandcast.records.track import SUPPLIED, TRACK, Track, TrackSummary

OFF_POINT_M = 0.002


def import_capture(
    path: str | Path,
    folder: str | Path,
    mapping: CaptureMapping,
    *,
    experiment: str,
    trial: int,
    length_m: float,
    points: int,
) -> TrackSummary:
    """Write track.parquet, track.json, hand.parquet and alignment.json into a trial's folder.

    Parameters
    ----------
    path
        CSV: one row per instant; an empty cell is a marker not seen.
    folder
        ``data/<experiment>/trial-NN``.
    mapping
        The columns, units and places; see `strandcast.imports.mapping`.
    experiment, trial
        Whose records they are.
    length_m, points
        The string's free length and its number n of mass points. A marker becomes the point nearest to its
        place; points without a marker are absent.

    Returns
    -------
    TrackSummary
        Its warnings tell where markers lie between mass points, and the n that would suit them.
    """
    table = read_numbers(path)
    time_s = _times(table, mapping)
    hand = _hand(table, mapping, time_s)
    index, warnings = points_of_markers(mapping, length_m, points)
    track = _track(table, mapping, time_s, hand, index, points)
    folder = Path(folder)
    seen = np.isfinite(hand).all(axis=1)
    start_s = float(time_s[0]) if mapping.motion_start_s is None else mapping.motion_start_s
    end_s = float(time_s[-1]) if mapping.motion_end_s is None else mapping.motion_end_s
    # It says that an import is complete: it must not stand beside half of another.
    (folder / "track.json").unlink(missing_ok=True)
    write_table(folder / "track.parquet", TRACK, track.columns(), {"source": Path(path).name})
    write_table(
        folder / "hand.parquet", HAND, _hand_columns(time_s[seen], hand[seen]), {"source": Path(path).name}
    )
    Alignment(
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
        motion_start_s=start_s,
        motion_end_s=end_s,
    ).write(folder / "alignment.json")
    summary = _summary(Path(path), mapping, track, index, experiment, trial, length_m, warnings)
    summary.write(folder / "track.json")
    return summary


def points_of_markers(mapping: CaptureMapping, length_m: float, points: int) -> tuple[list[int], list[str]]:
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
                f"a marker at {marker.place_m} m lies beyond the string's {length_m} m",
                field="place_m",
                fix="give places from the clamp along the string, in metres",
            )
        nearest = max(1, round(marker.place_m / spacing_m))
        index.append(nearest if marker.point is None else marker.point)
        off_m.append(abs(index[-1] * spacing_m - marker.place_m))
    if max(index) > points or len(set(index)) < len(index):
        raise StrandcastError(
            "SC-I014",
            f"the markers fall on points {index} of {points}",
            field="markers",
            fix="each marker needs a point of its own: use more points, or name them",
        )
    if max(off_m) <= OFF_POINT_M:
        return index, []
    return index, [
        f"a marker lies {max(off_m) * 1e3:.1f} mm along the string from its mass point; "
        f"with string.points: {_suiting(mapping, length_m, points)} they would agree better"
    ]


def _suiting(mapping: CaptureMapping, length_m: float, points: int) -> int:
    """Return the n near the given one whose points lie nearest to the markers."""
    places = np.array([marker.place_m for marker in mapping.markers])

    def worst(n: int) -> float:
        return float(np.abs(np.round(places * n / length_m) * length_m / n - places).max())

    tried = range(max(2, points // 2), 2 * points + 1)
    return min(tried, key=lambda n: (round(worst(n), 4), abs(n - points)))


def _times(table: NumberTable, mapping: CaptureMapping) -> np.ndarray:
    time_s = table.column(mapping.time) * TIME_UNITS[mapping.time_unit]
    table.require_finite(time_s[:, None], [mapping.time])
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if len(back):
        row = int(back[0]) + 1
        raise refusal(
            table.path,
            int(table.lines[row]),
            mapping.time,
            "time does not rise here",
            "sort the rows by time and take out doubled ones",
            code="SC-I007",
        )
    if len(time_s) < 3:
        raise refusal(table.path, None, None, f"{len(time_s)} rows are no motion", "export it again")
    return time_s


def _hand(table: NumberTable, mapping: CaptureMapping, time_s: np.ndarray) -> np.ndarray:
    """Return the hand's pose (rows, 3) [m, m, rad], the angle unwrapped; NaN where it was not seen."""
    place_m = table.columns([mapping.hand_x, mapping.hand_y]) * LENGTH_UNITS[mapping.length_unit]
    angle = np.zeros(len(time_s))
    if mapping.hand_angle is not None:
        angle = mapping.angle_sign * table.column(mapping.hand_angle) * ANGLE_UNITS[mapping.angle_unit]
    seen = np.isfinite(angle)
    angle[seen] = np.unwrap(angle[seen])
    hand = np.column_stack([place_m, angle + mapping.angle_offset_rad])
    if np.isfinite(hand).all(axis=1).sum() < 3:
        raise refusal(
            table.path, None, mapping.hand_x, "the hand was seen in fewer than three rows", "export it again"
        )
    return hand


def _track(
    table: NumberTable,
    mapping: CaptureMapping,
    time_s: np.ndarray,
    hand: np.ndarray,
    index: list[int],
    points: int,
) -> Track:
    rows = len(time_s)
    points_m = np.full((rows, points + 1, 2), np.nan)
    points_m[:, 0] = hand[:, :2]
    for marker, point in zip(mapping.markers, index, strict=True):
        points_m[:, point] = table.columns([marker.x, marker.y]) * LENGTH_UNITS[mapping.length_unit]
    return Track(
        np.arange(rows),
        time_s,
        points_m,
        np.full((rows, points + 1), mapping.sigma_m),
        np.full((rows, points + 1), SUPPLIED, np.int32),
    )


def _hand_columns(time_s: np.ndarray, hand: np.ndarray) -> dict[str, np.ndarray]:
    return {
        "source": np.full(len(time_s), "measured", dtype=object),
        "robot_time_s": time_s,
        "x_m": hand[:, 0],
        "y_m": hand[:, 1],
        "angle_rad": hand[:, 2],
    }


def _summary(
    path: Path,
    mapping: CaptureMapping,
    track: Track,
    index: list[int],
    experiment: str,
    trial: int,
    length_m: float,
    warnings: list[str],
) -> TrackSummary:
    seen = np.isfinite(track.points_m).all(axis=2)
    rows, count = seen.shape
    too_far = _farther_than_the_string(track, index, mapping)
    return TrackSummary(
        experiment=experiment,
        trial=trial,
        source="supplied",
        points=count - 1,
        length_m=length_m,
        decoded_frames=rows,
        expected_frames=rows,
        tracked_fraction=float(seen[:, index].mean()),
        tip_fraction=float(seen[:, -1].mean()),
        marker_fraction=float(seen[:, 0].mean()),
        median_sigma_m=mapping.sigma_m,
        choices={"file": path.name, "sha256": sha256_file(path)}
        | {
            f"point_{point}_place_m": marker.place_m
            for marker, point in zip(mapping.markers, index, strict=True)
        },
        warnings=warnings + too_far,
    )


def _farther_than_the_string(track: Track, index: list[int], mapping: CaptureMapping) -> list[str]:
    """Warn of markers farther from the hand than the string between them is long: units, places or axes."""
    warnings = []
    for point, marker in zip(index, mapping.markers, strict=True):
        if np.isnan(track.points_m[:, point]).all():
            raise StrandcastError(
                "SC-I021",
                f"the marker at {marker.place_m:g} m is never seen: {marker.x} and {marker.y} are empty",
                field="markers",
                fix="leave it out, or name its columns",
            )
        reach_m = float(np.nanmedian(np.linalg.norm(track.points_m[:, point] - track.points_m[:, 0], axis=1)))
        if reach_m > 1.05 * marker.place_m:
            warnings.append(
                f"the marker at {marker.place_m:g} m along the string is {reach_m:.3f} m from the hand: "
                "check units, places and columns"
            )
    return warnings
