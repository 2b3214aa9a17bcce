"""Import motion capture, driven ends and markers on the string, as track, hand and alignment."""

from collections.abc import Callable
from functools import partial
from itertools import combinations, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from strandcast.arm.load import PlanarArm
from strandcast.errors import StrandcastError
from strandcast.imports.capture_mapping import CaptureMapping, CaptureMarker, DrivenBody, at_rest, columns_of
from strandcast.imports.capture_table import as_measured, read_capture, times_of, with_units
from strandcast.imports.clock import supplied_clock
from strandcast.imports.mapping import ANGLE_UNITS, LARGEST_ANGLE_RAD
from strandcast.imports.table import NumberTable
from strandcast.imports.throw_in_space import Placement, ThrownBy, place_capture, placement_warnings
from strandcast.imports.track_checks import FEWEST, LONG_GAP_S, check_directions, check_track, paths_of
from strandcast.records.alignment import HAND, Alignment, EndPath, end_columns
from strandcast.records.files import sha256_file
from strandcast.records.record import refusal
from strandcast.records.tables import write_table
from strandcast.records.track import LONGEST_PLACE, SUPPLIED, TRACK, Track, TrackSummary

BEYOND_REACH, FAR_OFF = 1.1, 10.0  # of the arm's reach: an origin elsewhere, and a wrong unit
OFF_POINT_M = 0.002  # chosen: more shows in the fit
OF_LENGTH_ONE = 0.02  # by which a quaternion's length may differ; chosen: files round to three digits
FROM_TIP = 0.02  # of the length: the last marker of a throw in space is this near to the tip; chosen
LARGEST_EULER_RAD = 2.0 * np.pi + 1e-3  # a whole turn, rounded: larger angles of a body are degrees
SAME_M = 1e-6  # two markers nearer than this in all frames are one; chosen


class CapturedTrial(NamedTuple):
    """What is known of a captured trial beside the capture.

    `length_m` is the string's free length, `points` its number n of mass points. `arm` moves the hand in the
    plane, for its reach; `aimed` says that its throws are planned. `thrown` is a throw in space: the arm's
    hand is the driven end. A body that is tracked on it gives the capture's place and clock, else `offset_s`.
    """

    experiment: str
    trial: int
    length_m: float
    points: int
    arm: PlanarArm | None = None
    aimed: bool = True
    thrown: ThrownBy | None = None
    offset_s: float | None = None


def import_capture(
    path: str | Path, folder: str | Path, mapping: CaptureMapping, known: CapturedTrial
) -> TrackSummary:
    """Write track.parquet, track.json, hand.parquet and alignment.json into a trial's folder.

    In the plane each marker is the mass point nearest to its place. In space the markers are the track's
    points 1 to m, in the order of their places; the world is right-handed with z up. Point 0 is the first
    driven end, and `choices` of the summary has the places.

    The capture is CSV, Parquet or C3D: one row per instant; an empty cell is a marker that was not detected.

    Raises
    ------
    StrandcastError
        For columns, units, axes, times, driven ends or markers that do not fit; nothing is written then.
    """
    table = read_capture(path)
    mapping, warnings = with_units(table, mapping)
    time_s, rounded = times_of(table, mapping)
    table, time_s, notes = as_measured(table, mapping, time_s)
    markers = sorted(mapping.markers, key=lambda marker: marker.place_m)
    markers_m = np.stack([_position(table, mapping, marker.position) for marker in markers], axis=1)
    index, doubts = _points_of(markers, mapping.in_space, known, table.path)
    _refuse_unseen_or_same(markers_m, markers, table.path)
    ends: list[EndPath] = []
    trial = known.experiment, known.trial
    sigma_m, warnings = mapping.sigma_m, [*table.notes, *warnings, *rounded, *notes, *doubts]
    warnings += _gaps(markers_m, markers, time_s)
    if known.thrown is not None:
        place = _placed(table, mapping, known, known.thrown, time_s, markers_m[:, -1])
        markers_m, warnings = place.placed(markers_m), warnings + placement_warnings(place)
        sigma_m = float(np.hypot(sigma_m, place.rms_m or 0.0))  # as uncertain as the tracked hand
        of_clock = place.offset_s, place.offset_se_s
        alignment = supplied_clock(*trial, len(time_s), known.thrown.motion_s, *of_clock, place.rms_m)
        start_m = known.thrown.at(alignment.robot_time_s(time_s))[:, :3]
        hand = _rows(known.thrown.time_s, end_columns([known.thrown.end()]), table.path)
    else:
        if known.offset_s is not None:
            what = "the offset of the clocks is given, and the experiment has no target in space"
            fix = "leave --offset out: without a target in space, the capture's clock is the only one"
            raise refusal("SC-E008", table.path, "offset", what, fix)
        start_s, end_s = mapping.motion_start_s, mapping.motion_end_s
        motion_s = time_s[0] if start_s is None else start_s, time_s[-1] if end_s is None else end_s
        alignment = supplied_clock(*trial, len(time_s), (float(motion_s[0]), float(motion_s[1])))
        if mapping.in_space:
            ends = [_end(table, mapping, body, name) for name, body in _bodies(mapping)]
            columns, start_m = end_columns(ends), ends[0].place_m
        else:
            columns, doubts = _hand_in_plane(table, mapping)
            start_m, warnings = np.column_stack([columns["x_m"], columns["y_m"]]), warnings + doubts
        hand = _rows(time_s, columns, table.path)
    points = len(index) if mapping.in_space else known.points
    points_m = np.full((len(time_s), points + 1, markers_m.shape[2]), np.nan)
    points_m[:, 0], points_m[:, index] = start_m, markers_m
    frame, flags = np.arange(len(time_s)), np.full(points_m.shape[:2], SUPPLIED, np.int32)
    track = Track(frame, time_s, points_m, np.full(points_m.shape[:2], sigma_m), flags)
    choices: dict[str, float | str] = {"file": Path(path).name, "sha256": sha256_file(path)}
    if mapping.in_space:
        choices |= {name: getattr(mapping, name) for name in ("up", "handedness", "length_unit")}
    choices |= {f"point_{k}_place_m": marker.place_m for k, marker in zip(index, markers, strict=True)}
    summary = supplied_summary(track, known, index)
    summary = summary.model_copy(update={"choices": choices, "warnings": warnings})
    summary.warnings += check_track(track, paths_of(hand, table.path), alignment, summary, table.path)
    summary.warnings += check_directions(track, ends, summary, table.path)
    if known.arm is not None and not mapping.in_space:
        beyond = _check_reach(np.column_stack([hand["x_m"], hand["y_m"]]), known.arm, table.path)
        summary.warnings += beyond if known.aimed else []
    write_capture(Path(folder), track, hand, alignment, summary)
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


def supplied_summary(track: Track, known: CapturedTrial, index: list[int]) -> TrackSummary:
    """Return the summary of a track that has markers at these points, without choices."""
    detected = np.isfinite(track.points_m).all(axis=2)
    return TrackSummary(
        experiment=known.experiment,
        trial=known.trial,
        source="supplied",
        points=detected.shape[1] - 1,
        length_m=known.length_m,
        decoded_frames=len(detected),
        expected_frames=len(detected),
        tracked_fraction=float(detected[:, index].mean()),
        tip_fraction=float(detected[:, -1].mean()),
        marker_fraction=float(detected[:, 0].mean()),
        median_sigma_m=float(np.nanmedian(track.sigma_m[:, index])),
        choices={},
        cameras=[],
        warnings=[],
    )


def _points_of(
    markers: list[CaptureMarker], in_space: bool, known: CapturedTrial, file: Path
) -> tuple[list[int], list[str]]:
    """Return the track's point of each marker, and a warning where one lies between mass points."""
    places_m, length_m, points = [marker.place_m for marker in markers], known.length_m, known.points
    if places_m[-1] > LONGEST_PLACE * length_m:
        fix = (
            "give places in metres along the string, from where it leaves the clamp or the body; or correct "
            "string.length_m in experiment.yaml"
        )
        raise _misplaced(file, f"a marker at {places_m[-1]} m lies beyond the string's {length_m:g} m", fix)
    for one, other in pairwise(markers):
        if one.place_m == other.place_m:
            what = f"two markers have the place {one.place_m:g} m: {_words(one)} and {_words(other)}"
            raise _misplaced(file, what, "give each marker its own place along the string")
    if in_space:
        return list(range(1, len(markers) + 1)), []
    spacing_m = length_m / points
    index = [marker.point or max(1, round(marker.place_m / spacing_m)) for marker in markers]
    if max(index) > points or len(set(index)) < len(index):
        fix = "each marker needs a point of its own: use more points, or name them"
        raise _misplaced(file, f"the markers fall on points {index} of {points}", fix)
    off_m = max(abs(k * spacing_m - place_m) for k, place_m in zip(index, places_m, strict=True))
    if off_m <= OFF_POINT_M:
        return index, []
    return index, [
        f"a marker lies {off_m * 1e3:.1f} mm along the string from its mass point; "
        f"string.points: {_best_points(np.array(places_m), length_m, points)} would fit better"
    ]


def _best_points(places_m: np.ndarray, length_m: float, points: int) -> int:
    """Return the n near the given one whose points lie nearest to the markers."""

    def worst(n: int) -> float:
        return float(np.abs(np.round(places_m * n / length_m) * length_m / n - places_m).max())

    tried = range(max(2, points // 2), 2 * points + 1)
    return min(tried, key=lambda n: (round(worst(n), 4), abs(n - points)))


def _refuse_unseen_or_same(markers_m: np.ndarray, markers: list[CaptureMarker], file: Path) -> None:
    """Refuse a marker (F, m, 2 or 3) without a place, and two that share all of theirs."""
    never = ~np.isfinite(markers_m).all(axis=2).any(axis=0)
    if never.any():
        marker = markers[int(np.argmax(never))]
        what = f"the marker at {marker.place_m:g} m is never detected: {_words(marker)} are empty"
        fix = "leave it out, or name the columns that it has in this file"
        raise StrandcastError("SC-I021", what, file=file, field="markers", fix=fix)
    for one, other in combinations(range(len(markers)), 2):
        apart_m = np.linalg.norm(markers_m[:, one] - markers_m[:, other], axis=1)
        apart_m = apart_m[np.isfinite(apart_m)]
        if len(apart_m) and apart_m.max() < SAME_M:
            names = f"{_words(markers[one])} and {_words(markers[other])}"
            what = f"{names} are the same marker in all {len(apart_m)} rows"
            raise _misplaced(file, what, "name each marker once, with its own columns")


def _gaps(markers_m: np.ndarray, markers: list[CaptureMarker], time_s: np.ndarray) -> list[str]:
    """Return a warning of the markers (F, m, 2 or 3) that were not measured for long."""
    long = []
    for marker, place_m in zip(markers, np.moveaxis(markers_m, 1, 0), strict=True):
        seen = np.flatnonzero(np.isfinite(place_m).all(axis=1))
        seen_s = time_s[[0, *seen, -1]] - time_s[0]
        k = int(np.argmax(np.diff(seen_s)))
        if seen_s[k + 1] - seen_s[k] > LONG_GAP_S:
            length = f"{seen_s[k + 1] - seen_s[k]:.2f} s after {seen_s[k]:.2f} s"
            lost = len(time_s) - len(seen)
            long.append(f"{', '.join(marker.position)} for {length} ({lost} of {len(time_s)} rows in all)")
    words = "markers were not measured for long, by seconds from the beginning"
    return [f"{words}: {'; '.join(long)}"] if long else []


def _misplaced(file: Path, what: str, fix: str) -> StrandcastError:
    return StrandcastError("SC-I013", what, file=file, field="markers", fix=fix)


def _words(marker: CaptureMarker) -> str:
    return ", ".join(columns_of(marker.position))


def _rows(time_s: np.ndarray, columns: dict[str, np.ndarray], file: Path) -> dict[str, np.ndarray]:
    """Return the rows of hand.parquet in which all driven ends are known."""
    seen = {name: np.isfinite(column) for name, column in columns.items()}
    known = np.all(list(seen.values()), axis=0)
    if known.sum() < FEWEST:
        least = min(seen, key=lambda name: int(seen[name].sum()))
        what = f"this driven end was measured in {seen[least].sum()} of {len(known)} rows"
        if seen[least].sum() >= FEWEST:
            what = f"the driven ends were measured together in {known.sum()} of {len(known)} rows"
        fix = "name the columns of the body that holds the string, or export it again"
        raise refusal("SC-I021", file, "far" if least.startswith("far_") else "hand", what, fix)
    rows = {"source": np.full(int(known.sum()), "measured", dtype=object), "robot_time_s": time_s[known]}
    return rows | {name: column[known] for name, column in columns.items()}


def _bodies(mapping: CaptureMapping) -> list[tuple[str, DrivenBody]]:
    if mapping.hand is None:
        what, fix = "no body that holds the string is named", "name it: --hand, or hand in a mapping"
        raise StrandcastError("SC-I011", what, field="hand", fix=fix)
    return [("hand", mapping.hand)] + ([] if mapping.far is None else [("far", mapping.far)])


def _position(table: NumberTable, mapping: CaptureMapping, names: list[str]) -> np.ndarray:
    """Return positions (rows, 2 or 3) in the world [m], NaN where not measured."""
    columns = columns_of(names)
    still = at_rest(columns)
    given = table.columns(columns) if still is None else np.tile(still, (len(table.values), 1))
    given = given * mapping.unit_m()
    placed = given @ mapping.to_world().T if mapping.in_space else given
    return np.where(np.isfinite(given).all(axis=1, keepdims=True), placed, np.nan)


def _behind(table: NumberTable, mapping: CaptureMapping, body: DrivenBody, name: str) -> np.ndarray | None:
    """Return the vector (rows, 2 or 3) to a body from the point behind it, if there is one."""
    if body.behind is None:
        return None
    direction: np.ndarray = _position(table, mapping, body.position) - _position(table, mapping, body.behind)
    if (np.linalg.norm(direction, axis=1) <= 0.0).any():
        what, fix = "is where position is", "name two different points"
        raise refusal("SC-I013", table.path, f"{name}.behind", what, fix)
    return direction


def _hand_in_plane(table: NumberTable, mapping: CaptureMapping) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the hand's columns (rows,), the angle unwrapped, NaN where not detected; and a warning."""
    ((name, body),) = _bodies(mapping)
    place_m, direction = _position(table, mapping, body.position), _behind(table, mapping, body, name)
    angle, warnings = np.zeros(len(place_m)), []
    if direction is not None:
        angle = np.arctan2(direction[:, 1], direction[:, 0])
    elif mapping.hand_angle is not None:
        angle = mapping.angle_sign * _angles(table, mapping, [mapping.hand_angle], LARGEST_ANGLE_RAD)[:, 0]
    elif mapping.angle_offset_rad == 0.0:
        warnings.append(
            "no column gives the hand's angle, so the string always leaves the hand along x: "
            "if that is wrong, give the direction (--angle-offset)"
        )
    known = np.isfinite(angle)
    angle[known] = np.unwrap(angle[known])
    x_m, y_m = place_m.T
    return {"x_m": x_m, "y_m": y_m, "angle_rad": angle + mapping.angle_offset_rad}, warnings


def _angles(table: NumberTable, mapping: CaptureMapping, names: list[str], most_rad: float) -> np.ndarray:
    """Return columns of angles (rows, k) [rad]; refuse what must be degrees where no unit is given."""
    angles = table.columns(names) * ANGLE_UNITS[mapping.angle_unit]
    beyond = np.abs(angles) > most_rad
    if "angle_unit" not in mapping.model_fields_set and beyond.any():
        row, k = np.argwhere(beyond)[0]
        fix = 'give angle_unit = "deg" (or "rad") in a file for --columns'
        raise table.refusal(row, names[k], f"an angle of {angles[row, k]:.1f} rad", fix, "SC-I008")
    return angles


def _end(table: NumberTable, mapping: CaptureMapping, body: DrivenBody, name: str) -> EndPath:
    """Return the path of a driven end in space, NaN where it was not measured."""
    place_m = _position(table, mapping, body.position)
    direction, normal = _behind(table, mapping, body, name), None
    if body.leaves is not None:
        turned = _rotations(table, mapping, body, name) @ np.column_stack(
            [body.leaves, _aside(np.array(body.leaves)), np.array(body.offset) * mapping.unit_m()]
        )
        direction, normal, offset_m = np.moveaxis(mapping.to_world() @ turned, 2, 0)
        place_m = place_m + offset_m
    return EndPath(place_m, direction, normal)


def _rotations(table: NumberTable, mapping: CaptureMapping, body: DrivenBody, name: str) -> np.ndarray:
    """Return the rotations (rows, 3, 3) from the body's axes to the file's, NaN where not measured."""
    if body.euler is not None and body.euler_order is not None:
        names = body.euler
        if len(names) == 1:
            names = [f"{names[0]}.r{axis}" for axis in body.euler_order.lower()]
        angles = _angles(table, mapping, names, LARGEST_EULER_RAD)
        return _measured(angles, partial(Rotation.from_euler, body.euler_order))
    names = body.quaternion or []
    if len(names) == 1 and f"{names[0]}.rx" in table.names and f"{names[0]}.qx" not in table.names:
        what = f"the file has angles of {names[0]} about three axes, and programs order these differently"
        fix = f"export quaternions, or give euler = [{names[0]!r}] and euler_order"
        raise refusal("SC-I004", table.path, f"{name}.quaternion", what, fix)
    q = table.columns([f"{names[0]}.q{axis}" for axis in "wxyz"] if len(names) == 1 else names)
    length = np.linalg.norm(q, axis=1)
    wrong = np.abs(length - 1.0) > OF_LENGTH_ONE
    if wrong.any():
        row = int(np.argmax(wrong))
        what = f"has length {length[row]:.4g}, not 1 ({wrong.sum()} such rows of {len(q)})"
        fix = "name the four columns w, x, y, z of the quaternion; leave cells empty where it is not known"
        raise table.refusal(row, f"{name}.quaternion", what, fix, "SC-I025")
    return _measured(q, partial(Rotation.from_quat, scalar_first=True))


def _measured(rows: np.ndarray, rotation: Callable[[np.ndarray], Rotation]) -> np.ndarray:
    """Return the matrices (rows, 3, 3) of rotations, NaN where a number is."""
    known = np.isfinite(rows).all(axis=1)
    matrices = np.full((len(rows), 3, 3), np.nan)
    matrices[known] = rotation(rows[known]).as_matrix()
    return matrices


def _aside(direction: np.ndarray) -> np.ndarray:
    """Return a vector (3,) of length one across a direction."""
    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    return np.asarray(across / np.linalg.norm(across))


def _placed(
    table: NumberTable,
    mapping: CaptureMapping,
    known: CapturedTrial,
    thrown: ThrownBy,
    time_s: np.ndarray,
    tip_m: np.ndarray,
) -> Placement:
    """Return clock and place of a throw in space; refuse one without its tip, or of two ends."""
    place_m, length_m, hand = max(each.place_m for each in mapping.markers), known.length_m, mapping.hand
    if place_m < (1.0 - FROM_TIP) * length_m:
        what = f"the last marker is {place_m:g} m from the hand, and the tip {length_m:g} m"
        fix = (
            "put a marker on the tip, whose miss is measured; check string.length_m and what the clamp covers"
        )
        raise _misplaced(table.path, what, fix)
    given = {
        "far": mapping.far,
        "hand.behind": hand and hand.behind,
        "hand.quaternion": hand and hand.quaternion,
        "hand.euler": hand and hand.euler,
    }
    if wrong := [field for field, value in given.items() if value]:
        what = "the arm's hand alone drives the string of a throw, in the direction that the joint log gives"
        fix = f"leave {' and '.join(wrong)} out; --hand takes any one place on the arm's hand"
        raise refusal("SC-E008", table.path, wrong[0], what, fix)
    body_m = None if hand is None else _position(table, mapping, hand.position)
    return place_capture(thrown, time_s, body_m, tip_m, known.offset_s, table.path)


def _check_reach(hand_m: np.ndarray, arm: PlanarArm, file: Path) -> list[str]:
    """Compare the hand's farthest place with the arm's reach; return a warning or raise SC-I027."""
    origin_m, reach_m = arm.reach()
    far_m = float(np.hypot(*(hand_m - origin_m).T).max())
    words = f"the hand is up to {far_m:.3g} m from the arm's first joint, and the arm reaches {reach_m:.3g} m"
    if far_m > FAR_OFF * reach_m:
        raise refusal("SC-I027", file, "hand", words, "give the unit of lengths: length_unit in a mapping")
    return [f"{words}: check units and origin"] if far_m > BEYOND_REACH * reach_m else []
