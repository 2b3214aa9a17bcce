"""The meaning of a track measured elsewhere: units, clocks, direction; each problem with its number."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from strandcast.core.pose import Pose
from strandcast.errors import StrandcastError
from strandcast.imports.clock import clock_problem
from strandcast.records.alignment import Alignment, read_plane_hand
from strandcast.records.record import refusal
from strandcast.records.tables import read_table
from strandcast.records.track import AXES, TRACK, Track, TrackSummary, read_track

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

Paths = Mapping[str, tuple[np.ndarray, Pose]]


def check_supplied(
    track_file: Path, hand_file: Path, alignment: Alignment, summary: TrackSummary
) -> list[str]:
    """Check the rows of both tables, then their meaning; return warnings.

    Raises
    ------
    StrandcastError
        SC-I024 no rows; SC-I025 a value is not finite; SC-I026 doubled rows; SC-I007 time does not rise;
        and those of `check_track`.
    """
    rows = read_table(track_file, TRACK)
    check_rows(track_file, rows)
    paths = dict(_paths(hand_file))
    return check_track(read_track(track_file, summary.points), paths, alignment, summary, track_file)


def check_track(
    track: Track, paths: Paths, alignment: Alignment, summary: TrackSummary, file: Path
) -> list[str]:
    """Check a track with the paths of the hand by source (times, poses); return warnings.

    Raises
    ------
    StrandcastError
        SC-I027 sizes that string and arm cannot have; SC-I028 times that no film of a throw has; SC-I029 the
        track does not follow the hand; SC-I033 track, hand and motion do not overlap in time.
    """
    warnings = check_clock(track, file)
    robot_s = alignment.robot_time_s(track.camera_time_s)
    times_s = {f"{name} path of the hand": time_s for name, (time_s, _) in paths.items()}
    check_overlap(robot_s, times_s, alignment, file)
    warnings += _check_hand(track, robot_s, paths, file)
    time_s, pose = next(iter(paths.values()))
    hand = pose.interpolated(time_s, robot_s)
    held_m = np.where(
        np.isfinite(track.points_m[:, :1, :2]), track.points_m[:, :1, :2], hand.position_m[:, None]
    )
    string_m = track.points_m[..., :2] - held_m
    warnings += check_lengths(string_m, track.frame, summary.places_m(), file)
    return warnings + _mirrored(string_m, hand.angle_rad)


def check_rows(file: Path, rows: dict[str, np.ndarray]) -> None:
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
        raise refusal("SC-I026", file, "frame, point", what)


def _paths(file: Path) -> Iterator[tuple[str, tuple[np.ndarray, Pose]]]:
    rows = read_plane_hand(file)
    if not len(rows["source"]):
        raise refusal("SC-I024", file, "source", "it has 0 rows", "supply the hand's path")
    for name in ("robot_time_s", "x_m", "y_m", "angle_rad"):
        bad = ~np.isfinite(rows[name])
        if bad.any():
            row = int(np.argmax(bad))
            what = f"is {rows[name][row]} in row {row + 1} ({bad.sum()} such rows of {len(bad)})"
            raise refusal("SC-I025", file, name, what, "correct or leave out these rows")
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
            raise refusal(
                "SC-I007", file, "robot_time_s", what, "sort the rows by time, without doubled ones"
            )
        if len(time_s) < 2:
            raise refusal(
                "SC-I024", file, "source", f"the {source} path has {len(time_s)} row", "supply all of it"
            )
        if problem := clock_problem(time_s, slowest_s=np.inf):  # the hand may rest
            raise refusal("SC-I028", file, "robot_time_s", problem, "give the times of the throw in seconds")
        poses = np.column_stack([rows["x_m"], rows["y_m"], rows["angle_rad"]])[mine]
        yield source, (time_s, Pose.from_array(poses))


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
        fix = "give seconds; for a capture, set time_unit in the file of --columns"
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
    seen_m = track.points_m[:, 0, :2]
    known = np.isfinite(seen_m).all(axis=1)
    variants = {
        "": (seen_m, known),
        "left and right exchanged": (seen_m * [-1, 1], known),
        "up and down exchanged": (seen_m * [1, -1], known),
        "time reversed": (seen_m[::-1], known[::-1]),
    }
    off_m = {
        words: min(_rms_m(place_m, there, robot_s, *path) for path in paths.values())
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


def _rms_m(
    place_m: np.ndarray, there: np.ndarray, robot_s: np.ndarray, time_s: np.ndarray, pose: Pose
) -> float:
    """Return the distance from a path, infinite if it covers too few frames."""
    kept = there & (robot_s >= time_s[0]) & (robot_s <= time_s[-1])
    if kept.sum() < FEWEST:
        return np.inf
    off_m = place_m[kept] - pose.interpolated(time_s, robot_s[kept]).position_m
    return float(np.sqrt(np.mean(np.minimum(np.hypot(*off_m.T), FARTHEST_M) ** 2)))


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
    far_m = np.hypot(string_m[..., 0], string_m[..., 1])
    for axis in range(2, string_m.shape[-1]):
        far_m = np.hypot(far_m, string_m[..., axis])
    points = [k for k in range(1, far_m.shape[1]) if np.isfinite(far_m[:, k]).any()]
    if not points:
        raise refusal(
            "SC-I024",
            file,
            "point",
            f"0 of {far_m.shape[1] - 1} points of the string have a place",
            "supply its points",
        )
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
        "for a capture, check the markers' places, and length_unit in the file of --columns"
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
