"""The results of one trial as the pages need them: what could be read, and why the rest could not."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strandcast.errors import StrandcastError
from strandcast.records.alignment import HAND, Alignment, ends_of
from strandcast.records.camera import Camera
from strandcast.records.clip import Clip
from strandcast.records.estimate import ENSEMBLE, SIMULATED, Estimate
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.lineage import Lineage, check_picture
from strandcast.records.manifest import Manifest
from strandcast.records.motion import Motion
from strandcast.records.predicted import read_predicted
from strandcast.records.record import Record
from strandcast.records.tables import (
    MOST_CELLS,
    fitting,
    read_facts,
    read_parquet,
    read_table,
    scattered,
    table_made_by,
)
from strandcast.records.track import AXES, Track, TrackSummary, read_track
from strandcast.records.verdict import AFTER_MOTION_S, Verdict

Array = NDArray[np.float64]


class SimulatedThrow(NamedTuple):
    """One simulated throw: frame (F,), robot_time_s (F,), points_m (F, n+1, 2 or 3)."""

    frame: NDArray[np.int32]
    robot_time_s: Array
    points_m: Array

    def at(self, frames: int | NDArray[np.int32]) -> Array:
        """Return the points (..., n+1, 2 or 3) in frames, NaN where it was not simulated."""
        row = np.searchsorted(self.frame, frames).clip(0, len(self.frame) - 1)
        found = self.frame[row] == frames
        return np.where(found[..., None, None], self.points_m[row], np.nan)


class HandPoses(NamedTuple):
    """One path of the hand: robot_time_s (T,), pose (T, 3) = x_m, y_m, angle_rad.

    In space (T, 3 or 6): the places of one driven end or two.
    """

    robot_time_s: Array
    pose: Array


class TrueString(NamedTuple):
    """The lab's string: frame (F,), true robot_time_s (F,), place_m (P,), points_m (F, P, 2 or 3)."""

    frame: NDArray[np.int32]
    robot_time_s: Array
    place_m: Array
    points_m: Array
    facts: dict[str, Any]


FILES = {
    "verdict": "verdict.json",
    "manifest": "manifest.json",
    "camera": "../cameras/main.json",
    "track_summary": "track.json",
    "track": "track.parquet",
    "strobe": "strobe.webp",
    "clip": "clip.json",
    "alignment": "alignment.json",
    "hand": "hand.parquet",
    "estimate": "estimate.json",
    "ensemble": "ensemble.parquet",
    "simulated": "simulated.parquet",
    "motion": "motion.json",
    "predicted": "predicted.parquet",
    "lab_truth": "lab_truth.parquet",
}
ABSENT = "is not there"  # in the problem of a file that is missing
OPTIONAL = {"motion", "predicted", "lab_truth"}  # not needed for a complete trial


@dataclass(frozen=True)
class TrialResults:
    """The results in one trial's folder, by the names of `FILES`."""

    folder: Path
    excluded: bool = False  # also of a trial that is held out
    pieces: dict[str, Any] = field(default_factory=dict)  # results that could be read
    problems: dict[str, StrandcastError] = field(default_factory=dict)  # why the others could not
    made_by: dict[str, dict[str, str]] = field(default_factory=dict)  # versions of each record and table

    def need(self, name: str) -> Any:
        """Return a result, or raise the problem that kept it from being read."""
        if name in self.problems:
            raise self.problems[name]
        return self.pieces[name]

    def get(self, name: str) -> Any | None:
        """Return a result, or None if it could not be read."""
        return self.pieces.get(name)

    def path(self, name: str) -> Path:
        """Return the file of a result."""
        return self.folder / self.file(name)

    def file(self, name: str) -> str:
        """Return the file of a result, relative to the trial's folder."""
        summary = self.get("track_summary")
        if name == "camera" and summary is not None and summary.cameras:
            return f"../cameras/{summary.cameras[0]}.json"
        return FILES[name]

    def supplied(self) -> bool:
        """Return whether the track is of no single camera: it was imported, or joined from several."""
        summary = self.get("track_summary")
        return summary is not None and summary.source == "supplied"

    def joined(self) -> list[str]:
        """Return the names of the cameras that a track in space was joined from; none of a single one."""
        return self.need("track_summary").cameras if self.supplied() else []

    def views(self) -> dict[str, tuple[TrackSummary, bytes]]:
        """Return what each of several cameras saw, by its name: the summary of its track, and its picture."""
        found = {}
        for camera in self.joined():
            folder = self.folder.parent / camera / self.folder.name
            seen = TrackSummary.read(folder / FILES["track_summary"])
            found[camera] = seen, _read_picture(folder / FILES["strobe"], seen.lineage)
        return found

    def aimed(self) -> bool:
        """Return whether the trial had a target, as far as its verdict can be read."""
        verdict = self.get("verdict")
        return verdict is None or verdict.target_m is not None

    def in_space(self) -> bool:
        """Return whether the track is in space."""
        track = self.get("track")
        return track is not None and track.points_m.shape[2] == len(AXES)

    def not_made(self) -> set[str]:
        """Return the results that this trial need not have: those of a video, or all if it is excluded."""
        if self.excluded:
            return set(FILES)
        return OPTIONAL | ({"manifest", "camera", "strobe", "clip"} if self.supplied() else set())

    def unread(self) -> dict[str, str]:
        """Return the results that should be there but could not be read, each with the reason."""
        absent = {name for name in self.not_made() & set(self.problems) if ABSENT in self.problems[name].what}
        return {
            FILES[name].removeprefix("../"): problem.what
            for name, problem in self.problems.items()
            if name not in absent
        }

    def robot_time_s(self) -> Array:
        """Return the robot time (F,) of the track's frames."""
        return np.asarray(self.need("alignment").robot_time_s(self.need("track").camera_time_s))

    def window_s(self) -> tuple[float, float]:
        """Return start and end of the time in which a miss counts: the motion and 0.3 s after it."""
        alignment = self.need("alignment")
        return alignment.motion_start_s, alignment.motion_end_s + AFTER_MOTION_S

    def in_window(self) -> NDArray[np.bool_]:
        """Return which frames of the track (F,) lie within `window_s`."""
        start_s, end_s = self.window_s()
        time_s = self.robot_time_s()
        return (time_s >= start_s) & (time_s <= end_s)


def read_results(folder: Path, *, excluded: bool = False) -> TrialResults:
    """Read all results of one trial; a missing or damaged file becomes a problem, never an exception."""
    results = TrialResults(Path(folder), excluded)
    readers: dict[str, Callable[[Path], Any]] = {
        "verdict": Verdict.read,
        "manifest": Manifest.read,
        "track_summary": TrackSummary.read,
        "camera": Camera.read,
        "track": lambda path: _every_frame(read_track(path, results.need("track_summary").points)),
        "strobe": lambda path: _read_picture(path, results.need("track_summary").lineage),
        "clip": Clip.read,
        "alignment": Alignment.read,
        "hand": _read_hand,
        "estimate": Estimate.read,
        "ensemble": lambda path: read_table(path, ENSEMBLE),
        "simulated": _read_simulated,
        "motion": lambda path: _of_what_was_played(results, Motion.read(path)),
        "predicted": lambda path: _of_what_was_played(results, read_predicted(path)),
        "lab_truth": _read_lab_truth,
    }
    for name, read in readers.items():
        try:
            with fitting(results.path(name)):
                results.pieces[name] = read(results.path(name))
            results.made_by.update(_made_by(name, results))
        except StrandcastError as problem:
            problem.file = results.file(name)  # the page must not depend on where the folder is
            results.problems[name] = problem
    return results


def _of_what_was_played(results: TrialResults, planned: Any) -> Any:
    """Return what was planned for a throw, unless it is not known what was played."""
    manifest = results.get("manifest")
    if manifest is not None and manifest.motion_sha256 is None:
        raise StrandcastError("SC-R001", f"the motion that was played {ABSENT}")
    return planned


def _made_by(name: str, results: TrialResults) -> dict[str, dict[str, str]]:
    """Return the versions that made a result that was just read; empty for pictures."""
    piece = results.pieces[name]
    if isinstance(piece, Record):
        return {name: piece.made_by}
    if results.path(name).suffix == ".parquet":
        return {name: table_made_by(read_parquet(results.path(name)))}
    return {}


def _every_frame(track: Track) -> Track:
    """Return a track with every frame; points of frames without detections are NaN."""
    first, last = int(track.frame[0]), int(track.frame[-1])
    if last - first >= MOST_CELLS:
        raise ValueError(f"frames from {first} to {last}")
    frame = np.arange(first, last + 1, dtype=np.int32)
    rows = track.frame - frame[0]
    shape = (len(frame), track.points_m.shape[1])
    return Track(
        frame,
        np.interp(frame, track.frame, track.camera_time_s),
        scattered((*shape, track.points_m.shape[2]), rows, track.points_m),
        scattered(shape, rows, track.sigma_m),
        scattered(shape, rows, track.flags, fill=0),
    )


def _read_picture(path: Path, lineage: Lineage | None) -> bytes:
    if not path.is_file():
        raise StrandcastError("SC-W030", f"the picture {ABSENT}", file=path, fix="track the trial again")
    check_picture(path, lineage)
    return path.read_bytes()


def _read_hand(path: Path) -> dict[str, HandPoses]:
    rows = read_table(path, HAND)
    places = [end.place_m for end in ends_of(rows)]
    pose = np.column_stack(places or [rows[name] for name in ("x_m", "y_m", "angle_rad")])
    return {
        source: HandPoses(rows["robot_time_s"][mine], pose[mine])
        for source in ("commanded", "measured", "seen")
        if (mine := rows["source"] == source).any()
    }


def _read_simulated(path: Path) -> dict[str, SimulatedThrow]:
    rows = read_table(path, SIMULATED)
    throws = {}
    axes = [name for name in AXES if name in rows]
    for source in ("planned", "fitted", "predicted", "string", "predicted_string"):
        mine = rows["source"] == source
        if mine.any():
            frame, first, place = np.unique(rows["frame"][mine], return_index=True, return_inverse=True)
            point, places_m = rows["point"][mine], np.column_stack([rows[name][mine] for name in axes])
            points_m = scattered((len(frame), point.max() + 1, len(axes)), (place, point), places_m)
            throws[source] = SimulatedThrow(frame, rows["robot_time_s"][mine][first], points_m)
    return throws


def _read_lab_truth(path: Path) -> TrueString:
    rows = read_table(path, LAB_TRUTH)
    frame, first, row = np.unique(rows["frame"], return_index=True, return_inverse=True)
    place_m, column = np.unique(rows["place_m"], return_inverse=True)
    nodes_m = np.column_stack([rows[name] for name in AXES if name in rows])
    points_m = scattered((len(frame), len(place_m), nodes_m.shape[1]), (row, column), nodes_m)
    return TrueString(frame, rows["robot_time_s"][first], place_m, points_m, read_facts(path, LAB_TRUTH))
