"""The meaning of a track in space: units, axes, directions and gaps; each problem with its number."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from strandcast.core.jumps import GLITCH_M_S, jumps
from strandcast.imports.clock import clock_problem
from strandcast.imports.track_checks import (
    LONG_MEDIAN,
    SLACK_M,
    check_clock,
    check_lengths,
    check_overlap,
    check_rows,
)
from strandcast.records.alignment import HAND, Alignment, EndPath, ends_of
from strandcast.records.record import refusal
from strandcast.records.tables import read_table
from strandcast.records.track import TRACK, Track, TrackSummary, read_track

# All chosen.
LONG_GAP_S = 0.1  # of a driven end; its path is interpolated
SAME_M = 1e-6  # two markers nearer than this in all frames are one
BACKWARDS_DEG, ALONG_DEG = 120.0, 60.0
NEAR_END = 0.1  # of the length: there, a string still has the end's direction
RISES, ASIDE = 0.2, 4.0  # of the farthest marker, above the ends; times as far aside as down


def check_supplied_in_space(
    track_file: Path, hand_file: Path, alignment: Alignment, summary: TrackSummary
) -> list[str]:
    """Check the rows of both tables, then their meaning, as `track_checks.check_supplied`."""
    check_rows(track_file, read_table(track_file, TRACK))
    hand = read_table(hand_file, HAND)
    if not ends_of(hand):
        raise refusal("SC-I024", hand_file, "z_m", "the column is missing", "supply the driven ends in space")
    for name, column in hand.items():
        if name != "source" and not np.isfinite(column).all():
            row = int(np.argmin(np.isfinite(column)))
            what = f"is {column[row]} in row {row + 1}"
            raise refusal("SC-I025", hand_file, name, what, "correct or leave out these rows")
    track = read_track(track_file, summary.points)
    return check_track_in_space(track, hand, alignment, summary, track_file)


def check_track_in_space(
    track: Track, hand: Mapping[str, np.ndarray], alignment: Alignment, summary: TrackSummary, file: Path
) -> list[str]:
    """Check a track in space with the rows of its driven ends; return warnings.

    Raises
    ------
    StrandcastError
        SC-I027 sizes that the string cannot have; SC-I028 times that no capture has; SC-I033 track and
        driven ends do not overlap in time; SC-I036 too few rows of the driven ends.
    """
    warnings = check_clock(track, file)
    time_s, ends = hand["robot_time_s"], ends_of(hand)
    if len(time_s) < 3 or not (np.diff(time_s) > 0).all():
        what = f"{len(time_s)} rows have all driven ends, at times that must rise"
        raise refusal("SC-I036", file, "hand", what, "supply the whole path of the driven ends")
    if problem := clock_problem(time_s, slowest_s=np.inf):
        raise refusal("SC-I028", file, "robot_time_s", problem, "give seconds")
    robot_s = alignment.robot_time_s(track.camera_time_s)
    check_overlap(robot_s, {"measured path of the driven ends": time_s}, alignment, file)
    gaps_s = np.diff(time_s)
    if gaps_s.max() > LONG_GAP_S:
        at_s = float(time_s[int(np.argmax(gaps_s))])
        warnings.append(
            f"the driven ends were not measured for {gaps_s.max():.2f} s after {at_s:.2f} s: their path is "
            "interpolated, and predictions are worse from there on"
        )
    placed = [_at(robot_s, time_s, end.place_m) for end in ends]
    span_m = float(np.median(np.linalg.norm(placed[-1] - placed[0], axis=1)))
    if span_m > LONG_MEDIAN * summary.length_m + SLACK_M:
        what = f"the driven ends are {span_m:.3g} m apart, the string is {summary.length_m:.3g} m long"
        raise refusal("SC-I027", file, "far", what, "check length_unit, the columns and string.length_m")
    places_m = summary.places_m()
    warnings += check_lengths(track.points_m - placed[0][:, None], track.frame, places_m, file)
    return warnings + _check_jumps(track) + _check_up(track.points_m, places_m / summary.length_m, placed)


def check_directions(track: Track, ends: list[EndPath], summary: TrackSummary, file: Path) -> list[str]:
    """Compare the directions in which the ends hold the string with where it goes; return warnings.

    Raises
    ------
    StrandcastError
        SC-I038 the string leaves an end backwards, by a marker that is near it.
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
            raise refusal("SC-I038", file, name, words, fix)
        if (angle_deg > ALONG_DEG and along_m <= 2.0 * NEAR_END * length_m) or angle_deg > BACKWARDS_DEG:
            warnings.append(f"{name}: {words}: {fix}")
    return warnings


def refuse_same_markers(points_m: np.ndarray, names: list[str], file: Path) -> None:
    """Refuse two markers (F, m, 3) that are in the same place in all frames in which both are seen."""
    for k in range(len(names)):
        for other in range(k):
            apart_m = np.linalg.norm(points_m[:, k] - points_m[:, other], axis=1)
            apart_m = apart_m[np.isfinite(apart_m)]
            if len(apart_m) and apart_m.max() < SAME_M:
                what = f"{names[other]} and {names[k]} are the same marker in all {len(apart_m)} rows"
                raise refusal("SC-I039", file, "markers", what, "name each marker once, with its own columns")


def _at(time_s: np.ndarray, known_s: np.ndarray, path: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(time_s, known_s, column) for column in path.T])


def _check_jumps(track: Track) -> list[str]:
    found = jumps(track.camera_time_s, track.points_m[:, 1:])
    if not found.any():
        return []
    row, point = np.argwhere(found)[0]
    return [
        f"markers jump by more than {GLITCH_M_S:g} m/s {found.sum()} times, first point {point + 1} in frame "
        f"{track.frame[row + 1]}: these frames of a marker do not enter E"
    ]


def _check_up(points_m: np.ndarray, share: np.ndarray, ends: list[np.ndarray]) -> list[str]:
    """Compare where the markers (F, m + 1, 3) lie on average with the line through the ends: down.

    `share` (m + 1,) is their place along the string, 0 to 1.
    """
    line = ends[0][:, None] + share[:, None] * (ends[-1] - ends[0])[:, None]
    off_m = (points_m - line)[:, 1:].reshape(-1, 3)
    length_m = float(np.nanmax(np.linalg.norm(off_m, axis=1)))
    x, y, z = off_m[np.isfinite(off_m).all(axis=1)].mean(axis=0)
    words = f"on average the markers lie {x:+.2g} m in x, {y:+.2g} m in y and {z:+.2g} m in z from the ends"
    aside = max(abs(x), abs(y))
    if z > RISES * length_m or (aside > ASIDE * abs(z) and aside > RISES * length_m):
        return [f"{words}, and a string hangs down: check `up`"]
    return []
