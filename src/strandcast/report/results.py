"""The results of one trial as its pages need them: what could be read, and why the rest could not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strandcast.errors import StrandcastError
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.camera import Camera
from strandcast.records.estimate import ENSEMBLE, SIMULATED, Estimate
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.manifest import Manifest
from strandcast.records.motion import Motion
from strandcast.records.summary import AFTER_MOTION_S, Verdict
from strandcast.records.tables import read_facts, read_table
from strandcast.records.track import Track, TrackSummary, read_track

Array = NDArray[np.float64]


class Simulated(NamedTuple):
    """One simulated throw: frame (F,), robot_time_s (F,), points_m (F, n+1, 2)."""

    frame: NDArray[np.int32]
    robot_time_s: Array
    points_m: Array


class HandPath(NamedTuple):
    """One path of the hand: robot_time_s (T,), pose (T, 3) = x_m, y_m, angle_rad."""

    robot_time_s: Array
    pose: Array


class LabTruth(NamedTuple):
    """The lab's string: frame (F,), true robot_time_s (F,), place_m (P,), points_m (F, P, 2)."""

    frame: NDArray[np.int32]
    robot_time_s: Array
    place_m: Array
    points_m: Array
    facts: dict[str, Any]


FILES = {
    "verdict": "verdict.json",
    "manifest": "manifest.json",
    "camera": "../camera.json",
    "track_summary": "track.json",
    "track": "track.parquet",
    "strobe": "strobe.webp",
    "alignment": "alignment.json",
    "hand": "hand.parquet",
    "estimate": "estimate.json",
    "ensemble": "ensemble.parquet",
    "simulated": "simulated.parquet",
    "motion": "motion.json",
    "lab_truth": "lab_truth.parquet",
}


@dataclass(frozen=True)
class Results:
    """What one trial's folder holds, by the names of `FILES`, and the problem of each piece that it lacks."""

    folder: Path
    pieces: dict[str, Any] = field(default_factory=dict)
    problems: dict[str, StrandcastError] = field(default_factory=dict)

    def need(self, name: str) -> Any:
        """Return a piece.

        Raises
        ------
        StrandcastError
            What kept it from being read.
        """
        if name in self.problems:
            raise self.problems[name]
        return self.pieces[name]

    def get(self, name: str) -> Any | None:
        """Return a piece, or None if it is not to be had."""
        return self.pieces.get(name)

    def path(self, name: str) -> Path:
        """Return where a piece lies."""
        return self.folder / FILES[name]

    def supplied(self) -> bool:
        """Return whether the track was measured elsewhere and handed in."""
        summary = self.get("track_summary")
        return summary is not None and summary.source == "supplied"

    def not_made(self) -> set[str]:
        """Return what a trial without video, or without a motion of ours, does not have."""
        return {"manifest", "camera", "strobe", "motion"} if self.supplied() else set()

    def robot_time_s(self) -> Array:
        """Return the robot time (F,) of the track's frames."""
        return np.asarray(self.need("alignment").robot_time_s(self.need("track").camera_time_s))

    def window_s(self) -> tuple[float, float]:
        """Return the robot times between which the miss is looked for: the motion and 0.3 s after it."""
        alignment = self.need("alignment")
        return alignment.motion_start_s, alignment.motion_end_s + AFTER_MOTION_S

    def in_window(self) -> NDArray[np.bool_]:
        """Return which frames of the track (F,) lie in the miss's window."""
        start_s, end_s = self.window_s()
        time_s = self.robot_time_s()
        return (time_s >= start_s) & (time_s <= end_s)


def read_results(folder: Path) -> Results:
    """Read all results of one trial; what is missing or damaged becomes a problem, never an exception."""
    results = Results(Path(folder))
    readers: dict[str, Callable[[Path], Any]] = {
        "verdict": Verdict.read,
        "manifest": Manifest.read,
        "camera": Camera.read,
        "track_summary": TrackSummary.read,
        "track": lambda path: _every_frame(read_track(path, results.need("track_summary").points)),
        "strobe": _read_picture,
        "alignment": Alignment.read,
        "hand": _read_hand,
        "estimate": Estimate.read,
        "ensemble": lambda path: read_table(path, ENSEMBLE),
        "simulated": _read_simulated,
        "motion": Motion.read,
        "lab_truth": _read_lab_truth,
    }
    for name, read in readers.items():
        try:
            results.pieces[name] = read(results.path(name))
        except StrandcastError as problem:
            problem.file = FILES[name]  # the page tells the same wherever the folder lies
            results.problems[name] = problem
    return results


def _every_frame(track: Track) -> Track:
    """Return a track without holes in its frames: where nothing was seen, points are NaN."""
    frame = np.arange(track.frame[0], track.frame[-1] + 1, dtype=np.int32)
    rows = track.frame - frame[0]
    points_m = np.full((len(frame), *track.points_m.shape[1:]), np.nan)
    sigma_m = np.full(points_m.shape[:2], np.nan)
    flags = np.zeros(points_m.shape[:2], dtype=np.int32)
    points_m[rows], sigma_m[rows], flags[rows] = track.points_m, track.sigma_m, track.flags
    return Track(frame, np.interp(frame, track.frame, track.camera_time_s), points_m, sigma_m, flags)


def _read_picture(path: Path) -> bytes:
    if not path.is_file():
        raise StrandcastError("SC-R021", "the picture is not there", file=path, fix="track the trial again")
    return path.read_bytes()


def _read_hand(path: Path) -> dict[str, HandPath]:
    rows = read_table(path, HAND)
    paths = {}
    for source in ("commanded", "measured", "seen"):
        mine = rows["source"] == source
        if mine.any():
            pose = np.column_stack([rows[name][mine] for name in ("x_m", "y_m", "angle_rad")])
            paths[source] = HandPath(rows["robot_time_s"][mine], pose)
    return paths


def _read_simulated(path: Path) -> dict[str, Simulated]:
    rows = read_table(path, SIMULATED)
    throws = {}
    for source in ("planned", "fitted"):
        mine = rows["source"] == source
        if mine.any():
            frame, first, place = np.unique(rows["frame"][mine], return_index=True, return_inverse=True)
            points_m = _grid(
                rows, mine, place, rows["point"][mine], len(frame), rows["point"][mine].max() + 1
            )
            throws[source] = Simulated(frame, rows["robot_time_s"][mine][first], points_m)
    return throws


def _read_lab_truth(path: Path) -> LabTruth:
    rows = read_table(path, LAB_TRUTH)
    every = np.ones(len(rows["frame"]), dtype=bool)
    frame, first, row = np.unique(rows["frame"], return_index=True, return_inverse=True)
    place_m, column = np.unique(rows["place_m"], return_inverse=True)
    points_m = _grid(rows, every, row, column, len(frame), len(place_m))
    return LabTruth(frame, rows["robot_time_s"][first], place_m, points_m, read_facts(path, LAB_TRUTH))


def _grid(
    rows: dict[str, Any], mine: NDArray[np.bool_], row: Any, column: Any, height: int, width: int
) -> Array:
    """Return long x_m, y_m as an array (height, width, 2), NaN where nothing is said."""
    points_m = np.full((height, width, 2), np.nan)
    points_m[row, column, 0] = rows["x_m"][mine]
    points_m[row, column, 1] = rows["y_m"][mine]
    return points_m
