"""Import motion capture in space, driven ends and markers on the string, as track, hand and alignment."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.imports.capture_table import read_capture, times_of, with_units
from strandcast.imports.motion_capture import BEYOND, UNSEEN, one_clock, write_capture
from strandcast.imports.space_checks import check_directions, check_track_in_space, refuse_same_markers
from strandcast.imports.space_mapping import DrivenBody, SpaceMapping, columns_of
from strandcast.imports.table import NumberTable
from strandcast.imports.throw_in_space import ThrownBy, place_capture, placement_warnings
from strandcast.records.alignment import EndPath, end_columns
from strandcast.records.files import sha256_file
from strandcast.records.record import refusal
from strandcast.records.track import SUPPLIED, Track, TrackSummary

OF_LENGTH_ONE = 0.02  # by which a quaternion's length may differ; chosen: files round to three digits
FEWEST_ROWS = 3
FROM_TIP = 0.02  # of the length: the last marker of a throw is this near to the tip; chosen


def import_capture_in_space(
    path: str | Path,
    folder: str | Path,
    mapping: SpaceMapping,
    *,
    experiment: str,
    trial: int,
    length_m: float,
    thrown: ThrownBy | None = None,
    offset_s: float | None = None,
) -> TrackSummary:
    """Write track.parquet, track.json, hand.parquet and alignment.json into a trial's folder.

    The markers are the track's points 1 to m, in the order of their places, which `choices` of the summary
    has; point 0 is the first driven end. The world is right-handed with z up.

    Parameters
    ----------
    path
        CSV, Parquet or C3D: one row per instant; an empty cell is a marker that was not detected.
    folder
        ``data/<experiment>/trial-NN``.
    mapping
        Columns, units, axes and places; see `strandcast.imports.space_mapping`.
    experiment, trial
        Experiment and trial of the records.
    length_m
        The string's free length.
    thrown, offset_s
        An arm that throws the string: its hand is the driven end. A body that is tracked on it gives the
        capture's place and clock, otherwise `offset_s` does; see `place_capture`.

    Raises
    ------
    StrandcastError
        For columns, units, axes, times, driven ends or markers that do not fit; nothing is written then.
    """
    table = read_capture(path)
    mapping, notes = with_units(table, mapping)
    time_s = times_of(table, mapping)
    markers = sorted(mapping.markers, key=lambda marker: marker.place_m)
    points_m = np.stack([_position(table, mapping, marker.position) for marker in markers], axis=1)
    names = [", ".join(columns_of(marker.position)) for marker in markers]
    _refuse_misplaced([marker.place_m for marker in markers], names, length_m, table.path)
    refuse_same_markers(points_m, names, table.path)
    warnings, sigma_m = table.notes + notes, mapping.sigma_m
    if thrown is None:
        ends = [_end(table, mapping, body, name) for name, body in _named(mapping)]
        seen, end_s, alignment = ends, time_s, one_clock(experiment, trial, time_s)
    else:
        _refuse_no_tip(markers[-1].place_m, length_m, table.path)
        _refuse_other_ends(mapping, table.path)
        body = None if mapping.hand is None else _position(table, mapping, mapping.hand.position)
        place = place_capture(thrown, time_s, body, points_m[:, -1], offset_s, table.path)
        points_m, warnings = place.placed(points_m), warnings + placement_warnings(place)
        sigma_m = float(np.hypot(sigma_m, place.rms_m or 0.0))  # as uncertain as the tracked hand
        alignment = place.alignment(experiment, trial, len(time_s), thrown.motion_s)
        at_frames = thrown.at(alignment.robot_time_s(time_s))
        ends, end_s, seen = [thrown.end()], thrown.time_s, [EndPath(*np.hsplit(at_frames, 3))]
    track = Track(
        np.arange(len(time_s)),
        time_s,
        np.concatenate([seen[0].place_m[:, None], points_m], axis=1),
        np.full((len(time_s), 1 + len(markers)), sigma_m),
        np.full((len(time_s), 1 + len(markers)), SUPPLIED, np.int32),
    )
    detected = np.isfinite(points_m).all(axis=2)
    _refuse_unseen(detected, names, table.path)
    summary = TrackSummary(
        experiment=experiment,
        trial=trial,
        source="supplied",
        points=len(markers),
        length_m=length_m,
        decoded_frames=len(time_s),
        expected_frames=len(time_s),
        tracked_fraction=float(detected.mean()),
        tip_fraction=float(detected[:, -1].mean()),
        marker_fraction=float(np.isfinite(seen[0].place_m).all(axis=1).mean()),
        median_sigma_m=sigma_m,
        choices={
            "file": Path(path).name,
            "sha256": sha256_file(path),
            "up": mapping.up,
            "handedness": mapping.handedness,
            "length_unit": mapping.length_unit,
        }
        | {f"point_{k}_place_m": marker.place_m for k, marker in enumerate(markers, start=1)},
        warnings=warnings,
    )
    known = np.all(
        [np.isfinite(path).all(axis=1) for end in ends for path in end if path is not None], axis=0
    )
    hand = {"source": np.full(int(known.sum()), "measured", dtype=object), "robot_time_s": end_s[known]}
    hand |= {name: column[known] for name, column in end_columns(ends).items()}
    summary.warnings += check_track_in_space(track, hand, alignment, summary, table.path)
    if thrown is None:  # a throw may bend the string sharply at the clamp
        summary.warnings += check_directions(track, ends, summary, table.path)
    write_capture(Path(folder), track, hand, alignment, summary)
    return summary


def _named(mapping: SpaceMapping) -> list[tuple[str, DrivenBody]]:
    if mapping.hand is None:
        what, fix = "no body that holds the string is named", "name it: --hand, or hand in a mapping"
        raise StrandcastError("SC-I036", what, field="hand", fix=fix)
    return list(zip(("hand", "far"), mapping.bodies(), strict=False))


def _refuse_no_tip(place_m: float, length_m: float, file: Path) -> None:
    if place_m < (1.0 - FROM_TIP) * length_m:
        what = f"the last marker is {place_m:g} m from the hand, and the tip {length_m:g} m"
        fix = (
            "put a marker on the tip, whose miss is measured; check string.length_m and what the clamp covers"
        )
        raise refusal("SC-I055", file, "markers", what, fix)


def _refuse_other_ends(mapping: SpaceMapping, file: Path) -> None:
    """Refuse what a throw would not use: the joint log gives the hand's direction, and the tip is free."""
    hand = mapping.hand
    given = {
        "far": mapping.far,
        "hand.behind": hand and hand.behind,
        "hand.quaternion": hand and hand.quaternion,
    }
    if wrong := [field for field, value in given.items() if value]:
        what = "the arm's hand alone drives the string of a throw, in the direction that the joint log gives"
        fix = f"leave {' and '.join(wrong)} out; --hand takes any one place on the arm's hand"
        raise refusal("SC-I058", file, wrong[0], what, fix)


def _position(table: NumberTable, mapping: SpaceMapping, names: list[str]) -> np.ndarray:
    """Return positions (rows, 3) in the world [m], NaN where not measured."""
    given = table.columns(columns_of(names)) * mapping.unit_m()
    return np.where(np.isfinite(given).all(axis=1, keepdims=True), given @ mapping.to_world().T, np.nan)


def _end(table: NumberTable, mapping: SpaceMapping, body: DrivenBody, name: str) -> EndPath:
    """Return the path of a driven end, NaN where it was not measured."""
    place_m = _position(table, mapping, body.position)
    direction = normal = None
    if body.behind is not None:
        direction = place_m - _position(table, mapping, body.behind)
        if (np.linalg.norm(direction, axis=1) <= 0.0).any():
            fix = "name two different points"
            raise refusal("SC-I036", table.path, f"{name}.behind", "is where position is", fix)
    elif body.quaternion is not None and body.leaves is not None:
        turned = _rotations(table, body.quaternion, name) @ np.column_stack(
            [body.leaves, _aside(np.array(body.leaves)), np.array(body.offset) * mapping.unit_m()]
        )
        direction, normal, offset_m = np.moveaxis(mapping.to_world() @ turned, 2, 0)
        place_m = place_m + offset_m
    parts = [path for path in (place_m, direction, normal) if path is not None]
    seen = np.all([np.isfinite(path).all(axis=1) for path in parts], axis=0)
    if seen.sum() < FEWEST_ROWS:
        what = f"this driven end was measured in {seen.sum()} of {len(seen)} rows"
        fix = "name the columns of the body that holds the string, or export it again"
        raise refusal("SC-I036", table.path, name, what, fix)
    return EndPath(place_m, direction, normal)


def _rotations(table: NumberTable, names: list[str], name: str) -> np.ndarray:
    """Return the rotations (rows, 3, 3) of quaternions w, x, y, z from the body's axes to the file's."""
    q = table.columns([f"{names[0]}.q{axis}" for axis in "wxyz"] if len(names) == 1 else names)
    length = np.linalg.norm(q, axis=1)
    wrong = np.abs(length - 1.0) > OF_LENGTH_ONE
    if wrong.any():
        row = int(np.argmax(wrong))
        what = f"has length {length[row]:.4g}, not 1 ({wrong.sum()} such rows of {len(q)})"
        fix = "name the four columns w, x, y, z of the quaternion; leave cells empty where it is not known"
        raise table.refusal(row, f"{name}.quaternion", what, fix, "SC-I037")
    w, x, y, z = (q / length[:, None]).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _aside(direction: np.ndarray) -> np.ndarray:
    """Return a vector (3,) of length one across a direction."""
    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    return np.asarray(across / np.linalg.norm(across))


def _refuse_misplaced(places_m: list[float], names: list[str], length_m: float, file: Path) -> None:
    if places_m[-1] > length_m * 1.001:
        raise StrandcastError(
            "SC-I013",
            f"a marker at {places_m[-1]} m lies beyond the string's {length_m:g} m",
            file=file,
            field="markers",
            fix=BEYOND,
        )
    twice = [k for k, (place, after) in enumerate(pairwise(places_m)) if place == after]
    if twice:
        k = twice[0]
        raise StrandcastError(
            "SC-I039",
            f"two markers have the place {places_m[k]:g} m: {names[k]} and {names[k + 1]}",
            file=file,
            field="markers",
            fix="give each marker its own place along the string",
        )


def _refuse_unseen(detected: np.ndarray, names: list[str], file: Path) -> None:
    never = ~detected.any(axis=0)
    if never.any():
        raise StrandcastError(
            "SC-I021",
            f"a marker is never detected: {names[int(np.argmax(never))]} are empty",
            file=file,
            field="markers",
            fix=UNSEEN,
        )
