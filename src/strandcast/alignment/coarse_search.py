"""The coarse search: a grid over every offset at which log and video overlap."""

from dataclasses import dataclass

import numpy as np

from strandcast.alignment.joints import joint_path
from strandcast.alignment.log_rows import MOVES, LogRows
from strandcast.alignment.problem import ClockProblem, Priors
from strandcast.rig.model import Detections, Rig, marker_path_m

# Chosen; not sensitive: the fine fit starts from here.
STEP_S = 0.002
LEAST_DETECTIONS = 20  # of the hand's markers
MOST_DETECTIONS = 200
CHUNK = 2000  # offsets at once, to bound the memory
LARGEST_OFF_M = 0.1  # limit on the deviation of a misread marker
APART_S = 0.05  # offsets nearer to each other than this count as one


@dataclass(frozen=True, eq=False)
class AlignmentData:
    """The data of one alignment, and the names that messages give the joints and the files."""

    rig: Rig
    rows: LogRows
    detections: Detections
    largest_offset_s: float | None
    joint_names: tuple[str, ...]
    log_file: str | None
    arm_file: str

    def problem(self, offset_s: float, priors: Priors) -> ClockProblem | None:
        """Return the problem of a fit that starts at an offset; None where the log covers few detections."""
        covered = self.detections.where(self.rows.covers(self.detections.time_s + offset_s))
        if len(covered.time_s) < LEAST_DETECTIONS:
            return None
        robot_s = covered.time_s + offset_s
        path = joint_path(self.rows.time_s, self.rows.q_rad, (float(robot_s[0]), float(robot_s[-1])))
        return ClockProblem.of(self.rig, path, covered, offset_s, priors)

    def offset_window(self) -> tuple[float, float]:
        """Return least and greatest offset at which log and video overlap."""
        log_s, video_s = self.rows.time_s, self.detections.time_s
        least, greatest = log_s[0] - video_s[-1], log_s[-1] - video_s[0]
        if self.largest_offset_s is None:
            return float(least), float(greatest)
        # Camera time 0 is the film's first frame, whenever the hand is first seen.
        low, high = np.clip(log_s[0] + self.largest_offset_s * np.array([-1.0, 1.0]), least, greatest)
        return float(low), float(high)


def candidate_offsets(
    data: AlignmentData, window_s: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the offsets that fit better than their neighbours, the best first, and their rms [m].

    The median difference of each marker is subtracted, so that a displaced marker has no effect. Before and
    after the log the arm is assumed to stand still.
    """
    rig, rows, detections = data.rig, data.rows, data.detections
    window_s = window_s or data.offset_window()
    last = len(detections.time_s) - 1
    few = detections.where(np.unique(np.linspace(0, last, MOST_DETECTIONS).astype(int)))
    offsets = np.arange(window_s[0], window_s[1] + STEP_S, STEP_S)
    square = np.zeros(len(offsets))
    for marker in np.unique(few.marker):
        mine = few.where(few.marker == marker)
        path_m = marker_path_m(rig, rows.q_rad, marker)
        for start in range(0, len(offsets), CHUNK):
            chunk = slice(start, start + CHUNK)
            times = offsets[chunk, None] + mine.time_s
            for axis in range(2):
                off = mine.pose.position_m[:, axis] - np.interp(times, rows.time_s, path_m[:, axis])
                off = np.clip(off - np.median(off, axis=1, keepdims=True), -LARGEST_OFF_M, LARGEST_OFF_M)
                square[chunk] += (off**2).sum(axis=1)
    rms = np.sqrt(square / len(few.time_s))
    chosen = _best_apart(rms)
    return offsets[chosen], rms[chosen]


def shape_change_m(rig: Rig, rows: LogRows, detections: Detections, offset_s: float, shift_s: float) -> float:
    """Return how much a shift of the offset changes the shape of the hand's path, in the median [m].

    If the hand moves evenly along a line, a shift in time displaces the whole path, and a rig is not known to
    the millimetre: only the change besides one common displacement determines the offset.
    """
    speed = detections.speed_m_s()
    moving = detections.where(speed >= MOVES * detections.top_speed_m_s())
    changes = []
    for marker in np.unique(moving.marker):
        robot_s = moving.time_s[moving.marker == marker] + offset_s
        path_m = marker_path_m(rig, rows.q_rad, marker)
        both = []
        for later_s in (-shift_s, shift_s):
            moved = [
                np.interp(robot_s + later_s, rows.time_s, axis) - np.interp(robot_s, rows.time_s, axis)
                for axis in path_m.T
            ]
            change = np.stack(moved, axis=1)
            both.append(float(np.median(np.linalg.norm(change - np.median(change, axis=0), axis=1))))
        changes.append(min(both))
    return max(changes)  # a marker that was seen only briefly does not count against another


def _best_apart(rms: np.ndarray, most: int = 4) -> np.ndarray:
    """Return the indices of the lowest local minima that are apart, lowest first."""
    padded = np.concatenate([[np.inf], rms, [np.inf]])
    minima = np.flatnonzero((padded[1:-1] <= padded[:-2]) & (padded[1:-1] <= padded[2:]))
    chosen: list[int] = []
    for index in minima[np.argsort(rms[minima], kind="stable")]:
        if all(abs(int(index) - other) * STEP_S > APART_S for other in chosen):
            chosen.append(int(index))
        if len(chosen) == most:
            break
    return np.array(chosen, int)
