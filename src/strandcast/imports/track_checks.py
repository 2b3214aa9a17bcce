"""The meaning of a track measured elsewhere: units, clocks, axes; each problem with its number."""

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.core.interpolation import resampled
from strandcast.core.jumps import GLITCH_M_S, jumps
from strandcast.errors import StrandcastError
from strandcast.imports.clock import clock_problem
from strandcast.records.alignment import HAND, Alignment, EndPath, ends_of
from strandcast.records.record import refusal
from strandcast.records.tables import read_table
from strandcast.records.track import AXES, TRACK, Track, TrackSummary, is_in_space, read_track

# A string does not stretch: the shares are for errors of places and lengths, the slack for noise at the hand.
LONG_MEDIAN, LONG_ROW, SLACK_M = 1.05, 1.25, 0.02
UNITS_WRONG = 1.5  # median distance over place from which units or order of the points are wrong
IMPOSSIBLE = 10.0  # times the string: no error of measurement
LENGTH_ERROR = 0.01  # of the string's length: a ruler's error of 5 mm on half a metre
SHORT, FOLDED = 0.05, 0.3  # of a place: no throw keeps its string so short, hardly one does
LONG_STEP = 10.0  # usual steps; chosen
# The servo's lag between a commanded path and the track is some centimetres in a fast throw.
OFF_HAND_M, WRONG_HAND_M, EXPLAINS = 0.02, 0.1, 0.25
MIRRORED_RAD = 0.3  # within which a mirrored string leaves the hand along its angle; chosen
FARTHEST_M = 1e6  # so that squares stay numbers
FEWEST = 3  # frames to compare
# All chosen.
LONG_GAP_S = 0.1  # of a marker, or of a driven end: the path between is interpolated
BACKWARDS_DEG, ALONG_DEG = 120.0, 60.0
NEAR_END = 0.1  # of the length: there, a string still has the end's direction
RISES, ASIDE = 0.2, 4.0  # of the farthest marker, above the ends; times as far aside as down
SIDES = {"x": "left and right", "y": "front and back", "z": "up and down"}
SIDES_IN_PLANE = {"x": "left and right", "y": "up and down"}


class DrivenPath(NamedTuple):
    """The driven ends at times (T,) [s], in the plane (T, 2) or in space (T, 3)."""

    time_s: np.ndarray
    ends: list[EndPath]

    def at(self, time_s: np.ndarray) -> "DrivenPath":
        """Return it at other times, linear between its own and constant beyond them."""

        def interpolated(path: np.ndarray | None) -> np.ndarray | None:
            if path is None:
                return None
            return resampled(time_s, self.time_s, path)

        return DrivenPath(time_s, [EndPath(*map(interpolated, end)) for end in self.ends])  # type: ignore[arg-type]


Paths = Mapping[str, DrivenPath]


def check_supplied(
    track_file: Path, hand_file: Path, alignment: Alignment, summary: TrackSummary
) -> list[str]:
    """Check the rows of both tables, then their meaning; return warnings.

    Raises
    ------
    StrandcastError
        SC-I024 no rows; SC-I025 a value is not finite, or a row is doubled; SC-I007 time does not rise;
        SC-I004 the hand has other axes than the track; and those of `check_track`.
    """
    rows, hand = read_table(track_file, TRACK), read_table(hand_file, HAND)
    check_rows(track_file, rows)
    column = "z_m" if is_in_space(rows) else "angle_rad"
    if column not in hand:
        what = "the column is missing: the hand is not where the track is, in the plane or in space"
        raise refusal("SC-I004", hand_file, column, what, "supply track and hand of the same kind")
    track = read_track(track_file, summary.points)
    return check_track(track, paths_of(hand, hand_file), alignment, summary, track_file)


def check_track(
    track: Track, paths: Paths, alignment: Alignment, summary: TrackSummary, file: Path
) -> list[str]:
    """Check a track with the paths of the driven ends by source; return warnings.

    Raises
    ------
    StrandcastError
        SC-I027 sizes that string and arm cannot have; SC-I028 times that no film of a throw has; SC-I029 the
        track does not follow the hand; SC-I033 track, hand and motion do not overlap in time.
    """
    warnings = check_clock(track, file)
    robot_s = alignment.robot_time_s(track.camera_time_s)
    times_s = {f"{name} path of the hand": path.time_s for name, path in paths.items()}
    check_overlap(robot_s, times_s, alignment, file)
    _refuse_exchanged(track, file)
    warnings += _check_hand(track, robot_s, paths, file)
    path = next(iter(paths.values()))
    ends, places_m = path.at(robot_s).ends, summary.places_m()
    warnings += _check_ends(path.time_s, ends, summary.length_m, file)
    start_m = track.points_m[:, :1]
    string_m = track.points_m - np.where(np.isfinite(start_m), start_m, ends[0].place_m[:, None])
    warnings += check_lengths(string_m, track.frame, places_m, file)
    if string_m.shape[2] == len(AXES):
        return warnings + _check_jumps(track) + _check_up(track.points_m, places_m / summary.length_m, ends)
    assert ends[0].direction is not None
    return warnings + _mirrored(string_m, np.arctan2(*ends[0].direction.T[::-1]))


def check_rows(file: Path, rows: Mapping[str, np.ndarray]) -> None:
    """Refuse rows of a track that are not finite, doubled or not in order of time."""
    frame, point = rows["frame"], rows["point"]
    places = np.stack([rows[name] for name in AXES if name in rows])
    if not np.isfinite(places).all(axis=0).any():
        what = f"none of its {len(frame)} rows has a place"
        raise refusal("SC-I024", file, "x_m", what, "supply the measured places")
    there = np.isfinite(places).all(axis=0)
    wrong = {
        "camera_time_s": ~np.isfinite(rows["camera_time_s"]),
        "x_m, y_m": np.isinf(places).any(axis=0),
        "sigma_m": there & ~(np.isfinite(rows["sigma_m"]) & (rows["sigma_m"] > 0)),
        "frame": frame < 0,
    }
    for name, bad in wrong.items():
        if bad.any():
            row = int(np.argmax(bad))
            value = rows[name.split(",")[0]][row]
            what = f"is {value} in row {row + 1} ({bad.sum()} such rows of {len(bad)})"
            raise refusal("SC-I025", file, name, what, "correct or leave out these rows")
    _check_doubled(file, frame, point)
    order = np.lexsort((rows["camera_time_s"], frame))
    frame, time_s = frame[order], rows["camera_time_s"][order]
    same = np.diff(frame) == 0
    wrong_step = np.where(same, np.diff(time_s) != 0, np.diff(time_s) <= 0)
    if wrong_step.any():
        k = int(np.argmax(wrong_step))
        what = (
            f"frame {frame[k]} is at {time_s[k]:.6g} s and frame {frame[k + 1]} at {time_s[k + 1]:.6g} s "
            f"({wrong_step.sum()} such steps)"
        )
        fix = "number the frames by their time, each with one time"
        raise refusal("SC-I007", file, "camera_time_s", what, fix)


def _check_doubled(file: Path, frame: np.ndarray, point: np.ndarray) -> None:
    pairs, first, count = np.unique(np.stack([frame, point]), axis=1, return_index=True, return_counts=True)
    if (count > 1).any():
        k = int(np.argmax(count > 1))
        what = (
            f"frame {pairs[0, k]}, point {pairs[1, k]} has {count[k]} rows, the first is row {first[k] + 1} "
            f"({(count - 1).sum()} rows too many)"
        )
        raise refusal("SC-I025", file, "frame, point", what, "keep one row of each point in each frame")


def paths_of(rows: Mapping[str, np.ndarray], file: Path) -> dict[str, DrivenPath]:
    """Return the paths in rows of hand.parquet by source; see `check_supplied` for the errors."""
    if not len(rows["source"]):
        raise refusal("SC-I024", file, "source", "it has 0 rows", "supply the hand's path")
    for name, column in rows.items():
        bad = np.zeros(len(column), bool) if name == "source" else ~np.isfinite(column)
        if bad.any():
            row = int(np.argmax(bad))
            what = f"is {column[row]} in row {row + 1} ({bad.sum()} such rows of {len(bad)})"
            raise refusal("SC-I025", file, name, what, "correct or leave out these rows")
    paths = {}
    for source in dict.fromkeys(rows["source"]):
        mine = np.flatnonzero(rows["source"] == source)
        time_s = rows["robot_time_s"][mine]
        back = np.flatnonzero(np.diff(time_s) <= 0)
        if len(back):
            k = int(back[0])
            what = (
                f"row {mine[k + 1] + 1} is at {time_s[k + 1]:.6g} s, the one before it at {time_s[k]:.6g} s "
                f"({len(back)} such rows of the {source} path)"
            )
            fix = "sort the rows by time, without doubled ones"
            raise refusal("SC-I007", file, "robot_time_s", what, fix)
        if len(time_s) < 2:
            what = f"the {source} path has {len(time_s)} row"
            raise refusal("SC-I024", file, "source", what, "supply all of it")
        if problem := clock_problem(time_s, slowest_s=np.inf):  # the hand may rest
            raise refusal("SC-I028", file, "robot_time_s", problem, "give the times of the throw in seconds")
        paths[source] = DrivenPath(time_s, _ends({name: column[mine] for name, column in rows.items()}))
    return paths


def _ends(rows: Mapping[str, np.ndarray]) -> list[EndPath]:
    if ends := ends_of(rows):
        return ends
    place_m, angle = np.column_stack([rows["x_m"], rows["y_m"]]), rows["angle_rad"]
    return [EndPath(place_m, np.column_stack([np.cos(angle), np.sin(angle)]), None)]


def check_clock(track: Track, file: Path) -> list[str]:
    """Refuse times that no capture has; return a warning of a gap."""
    time_s = track.camera_time_s
    if len(time_s) < FEWEST:
        raise refusal(
            "SC-I024", file, "frame", f"{len(time_s)} frames are no motion", "supply the whole throw"
        )
    steps = np.diff(time_s) / np.diff(track.frame)
    usual_s = float(np.median(steps))
    problem = clock_problem(time_s)
    if problem is not None:
        fix = "give seconds; for a capture, --time-unit (time_unit in a mapping)"
        raise refusal("SC-I028", file, "camera_time_s", problem, fix)
    longest = int(np.argmax(steps))
    if steps[longest] > LONG_STEP * usual_s:
        place = f"after frame {track.frame[longest]}"
        return [f"{steps[longest] * 1e3:.1f} ms per frame {place}, usually {usual_s * 1e3:.2f} ms"]
    return []


def check_overlap(
    robot_s: np.ndarray, times_s: Mapping[str, np.ndarray], alignment: Alignment, file: Path
) -> None:
    """Refuse a track that has too few frames in common with the motion or with a path, by name."""
    start_s, end_s = alignment.motion_start_s, alignment.motion_end_s
    spans = {name: (time_s[0], time_s[-1]) for name, time_s in times_s.items()}
    for name, (from_s, to_s) in (spans | {"motion": (start_s, end_s)}).items():
        covered = int(((robot_s >= from_s) & (robot_s <= to_s)).sum())
        if covered < FEWEST:
            what = (
                f"the track is from {robot_s[0]:.6g} to {robot_s[-1]:.6g} s of robot time, the {name} from "
                f"{from_s:.6g} to {to_s:.6g} s: {covered} frames in common"
            )
            fix = "check offset_s, drift and the motion's times in alignment.json, and the units of all times"
            raise refusal("SC-I033", file, "camera_time_s", what, fix)


def _check_hand(track: Track, robot_s: np.ndarray, paths: Paths, file: Path) -> list[str]:
    """Compare point 0 with the hand's path that fits it best, as it is, mirrored and reversed."""
    seen_m = track.points_m[:, 0]
    known, axes = np.isfinite(seen_m).all(axis=1), seen_m.shape[1]
    sides = (SIDES if axes == len(SIDES) else SIDES_IN_PLANE).values()
    variants = {"": (seen_m, known), "time reversed": (seen_m[::-1], known[::-1])}
    for k, side in enumerate(sides):
        variants[f"{side} exchanged"] = seen_m * np.where(np.arange(axes) == k, -1.0, 1.0), known
    off_m = {
        words: min(_rms_m(place_m, there, robot_s, path) for path in paths.values())
        for words, (place_m, there) in variants.items()
    }
    present_m = off_m.pop("")
    if not OFF_HAND_M < present_m < np.inf:
        return []
    words = f"point 0 stays {present_m * 1e3:.3g} mm rms from the hand's path"
    best = min(off_m, key=lambda name: off_m[name])
    if off_m[best] < EXPLAINS * present_m:
        words += f"; with {best}, {off_m[best] * 1e3:.3g} mm remain"
    elif present_m < WRONG_HAND_M:
        return [words]
    fix = "supply track and hand of the same throw, in the axes and on the clock of the hand's path"
    raise refusal("SC-I029", file, "x_m, y_m", words, fix)


def _rms_m(place_m: np.ndarray, there: np.ndarray, robot_s: np.ndarray, path: DrivenPath) -> float:
    """Return the distance from a path, infinite if it covers too few frames."""
    kept = there & (robot_s >= path.time_s[0]) & (robot_s <= path.time_s[-1])
    if kept.sum() < FEWEST:
        return np.inf
    off_m = place_m[kept] - path.at(robot_s[kept]).ends[0].place_m
    return float(np.sqrt(np.mean(np.minimum(np.hypot.reduce(off_m, axis=1), FARTHEST_M) ** 2)))


def _check_ends(known_s: np.ndarray, ends: list[EndPath], length_m: float, file: Path) -> list[str]:
    """Refuse ends that are farther apart than the string is long; return a warning of a gap of theirs."""
    span_m = float(np.median(np.hypot.reduce(ends[-1].place_m - ends[0].place_m, axis=1)))
    if span_m > LONG_MEDIAN * length_m + SLACK_M:
        what = f"the driven ends are {span_m:.3g} m apart, the string is {length_m:.3g} m long"
        raise refusal("SC-I027", file, "far", what, "check length_unit, the columns and string.length_m")
    gaps_s = np.diff(known_s)
    if gaps_s.max() <= LONG_GAP_S:
        return []
    at_s = float(known_s[int(np.argmax(gaps_s))])
    return [
        f"the driven ends were not measured for {gaps_s.max():.2f} s after {at_s:.2f} s: their path is "
        "interpolated, and predictions are worse from there on"
    ]


def check_directions(track: Track, ends: list[EndPath], summary: TrackSummary, file: Path) -> list[str]:
    """Compare the directions in which the ends hold the string with where it goes; return warnings.

    Raises
    ------
    StrandcastError
        SC-I029 the string leaves an end backwards, by a marker that is near it.
    """
    places_m, length_m = summary.places_m(), summary.length_m
    warnings = []
    for name, end, k in zip(("hand", "far"), ends, (1, len(places_m) - 1), strict=False):
        along_m = abs(places_m[k] - (length_m if name == "far" else 0.0))
        away = track.points_m[:, k] - end.place_m
        if end.direction is None or along_m <= 0.0:
            continue
        with np.errstate(invalid="ignore", divide="ignore"):
            cosine = (away * end.direction).sum(axis=1) / (
                np.linalg.norm(away, axis=1) * np.linalg.norm(end.direction, axis=1)
            )
        angle_deg = float(np.degrees(np.arccos(np.clip(np.nanmedian(cosine), -1.0, 1.0))))
        words = (
            f"the nearest marker, {along_m:.3g} m along the string, lies {angle_deg:.0f}° from the direction "
            "in which this end holds the string"
        )
        fix = "check behind (a point on the body's side), the order w, x, y, z, leaves, up and handedness"
        if angle_deg > BACKWARDS_DEG and along_m <= NEAR_END * length_m:
            raise refusal("SC-I029", file, name, words, fix)
        if (angle_deg > ALONG_DEG and along_m <= 2.0 * NEAR_END * length_m) or angle_deg > BACKWARDS_DEG:
            warnings.append(f"{name}: {words}: {fix}")
    return warnings


def check_length(supplied_m: float, string_m: float, file: Path) -> list[str]:
    """Compare the free length in track.json with the whole string; return a warning or raise SC-I027."""
    words = f"is {supplied_m:.4g} m, the experiment's string {string_m:.4g} m"
    share = supplied_m / string_m
    if not 0.5 <= share <= 2.0:
        fix = "give metres, and set string.length_m to the string that was thrown"
        raise refusal("SC-I027", file, "length_m", words, fix)
    return [f"length_m in track.json {words}"] if share > 1.0 + LENGTH_ERROR else []


def check_lengths(string_m: np.ndarray, frame: np.ndarray, places_m: np.ndarray, file: Path) -> list[str]:
    """Compare the distances from the hand with the places along the string."""
    far_m = np.hypot.reduce(string_m, axis=-1)
    points = [k for k in range(1, far_m.shape[1]) if np.isfinite(far_m[:, k]).any()]
    if not points:
        what = f"0 of {far_m.shape[1] - 1} points of the string have a place"
        raise refusal("SC-I024", file, "point", what, "supply its points")
    warnings = []
    for k in points:
        median_m = float(np.nanmedian(far_m[:, k]))
        words = f"point {k}, {places_m[k]:.3g} m along the string, is {median_m:.3g} m from the hand"
        if median_m > UNITS_WRONG * places_m[k] + SLACK_M:
            raise _wrong_size(file, words)
        if median_m > LONG_MEDIAN * places_m[k] + SLACK_M:
            warnings.append(f"{words}: check units, places and columns")
    last = points[-1]
    longest_m = float(np.nanmax(far_m[:, last]))
    words = (
        f"point {last}, {places_m[last]:.3g} m along the string, is never more than {longest_m:.3g} m "
        "from the hand"
    )
    if longest_m < SHORT * places_m[last]:
        raise _wrong_size(file, words)
    if longest_m < FOLDED * places_m[last]:
        warnings.append(f"{words}: check units, places and columns")
    return warnings + _check_single(far_m, frame, places_m, file)


def _check_single(far_m: np.ndarray, frame: np.ndarray, places_m: np.ndarray, file: Path) -> list[str]:
    wild = far_m > LONG_ROW * places_m + SLACK_M
    wild[:, 0] = False
    if not wild.any():
        return []
    row, point = np.unravel_index(np.argmax(np.where(wild, far_m, 0.0)), far_m.shape)
    words = (
        f"{wild.sum()} places are farther from the hand than the string allows, the farthest "
        f"{far_m[row, point]:.3g} m in frame {frame[row]}, point {point}"
    )
    if far_m[row, point] > IMPOSSIBLE * places_m[-1]:
        raise _wrong_size(file, words)
    return [words]


def _wrong_size(file: Path, what: str) -> StrandcastError:
    fix = (
        "give metres from the clamp on, the origin at the arm's; "
        "for a capture, check the markers' places, and its unit: --length-unit, or length_unit in a mapping"
    )
    return refusal("SC-I027", file, "x_m, y_m", what, fix)


def _mirrored(string_m: np.ndarray, angle_rad: np.ndarray) -> list[str]:
    """Return a warning if the string leaves the hand along its angle once it is mirrored, and only then.

    A limp cord hangs from the hand, and leaves it along no such angle.
    """
    points = [k for k in range(1, string_m.shape[1]) if np.isfinite(string_m[:, k]).all(axis=-1).any()]
    x, y = string_m[:, points[0]].T
    off_rad, left_right, up_down = (
        float(np.nanmedian(np.abs(np.angle(np.exp(1j * (np.arctan2(v, u) - angle_rad))))))
        for u, v in ((x, y), (-x, y), (x, -y))
    )
    best_rad, words = min((left_right, "left and right"), (up_down, "up and down"))
    if best_rad > MIRRORED_RAD or off_rad < 2.0 * MIRRORED_RAD:
        return []
    return [
        f"the string leaves the hand {off_rad:.2f} rad from the hand's angle, with {words} exchanged "
        f"{best_rad:.2f} rad: is the track, or the angle, mirrored?"
    ]


def _refuse_exchanged(track: Track, file: Path) -> None:
    """Refuse two points that go on from each other's place: their labels were exchanged."""
    seen = np.isfinite(track.points_m).all(axis=2)
    for pair in combinations(np.flatnonzero(seen.any(axis=0)).tolist(), 2):
        rows = np.flatnonzero(seen[:, pair].all(axis=1))
        time_s = track.camera_time_s[rows]
        place_m = np.clip(track.points_m[rows][:, pair], -FARTHEST_M, FARTHEST_M)
        step_s = np.diff(time_s)[:, None, None]
        velocity = np.diff(place_m, axis=0) / step_s
        expected_m = place_m[1:-1] + velocity[:-1] * step_s[1:]
        as_is, exchanged = (
            np.linalg.norm(each - expected_m, axis=2).sum(axis=1) for each in (place_m[2:], place_m[2:, ::-1])
        )
        moved = (as_is > 2.0 * OFF_HAND_M) & (step_s[1:, 0, 0] <= LONG_GAP_S)
        if (found := moved & (exchanged < EXPLAINS * as_is)).any():
            k = int(np.argmax(found)) + 2
            what = (
                f"points {pair[0]} and {pair[1]} (0: the hand) are exchanged from frame "
                f"{track.frame[rows[k]]} on, at {time_s[k]:.3f} s ({found.sum()} such changes)"
            )
            fix = "exchange their labels there and import again, or leave these cells empty"
            raise refusal("SC-I029", file, "point", what, fix)


def _check_jumps(track: Track) -> list[str]:
    found = jumps(track.camera_time_s, track.points_m)
    words = f"by more than {GLITCH_M_S:g} m/s"
    warnings = []
    if (of_hand := found[:, 0]).any():
        warnings.append(
            f"the hand jumps {words} {of_hand.sum()} times, first in frame "
            f"{track.frame[np.argmax(of_hand) + 1]}: was it exchanged with another marker?"
        )
    if found[:, 1:].any():
        row, point = np.argwhere(found[:, 1:])[0]
        warnings.append(
            f"markers jump {words} {found[:, 1:].sum()} times, first point {point + 1} in frame "
            f"{track.frame[row + 1]}: these frames of a marker do not enter E"
        )
    return warnings


def _check_up(points_m: np.ndarray, share: np.ndarray, ends: list[EndPath]) -> list[str]:
    """Compare where the markers (F, m + 1, 3) lie on average with the line through the ends: down.

    `share` (m + 1,) is their place along the string, 0 to 1.
    """
    first_m, last_m = ends[0].place_m[:, None], ends[-1].place_m[:, None]
    off_m = (points_m - first_m - share[:, None] * (last_m - first_m))[:, 1:].reshape(-1, 3)
    length_m = float(np.nanmax(np.linalg.norm(off_m, axis=1)))
    x, y, z = off_m[np.isfinite(off_m).all(axis=1)].mean(axis=0)
    words = f"on average the markers lie {x:+.2g} m in x, {y:+.2g} m in y and {z:+.2g} m in z from the ends"
    aside = max(abs(x), abs(y))
    if z > RISES * length_m or (aside > ASIDE * abs(z) and aside > RISES * length_m):
        return [f"{words}, and a string hangs down: check `up`"]
    return []
