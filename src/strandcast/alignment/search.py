"""The coarse search: every offset at which the log could belong to the video, on a grid."""

from __future__ import annotations

import numpy as np

from strandcast.alignment.rig import Rig, Seen, marker_poses, no_misfit
from strandcast.alignment.rows import MOVES, Rows

STEP_S = 0.002
MOST_SIGHTINGS = 200
CHUNK = 2000
LARGEST_OFF_M = 0.1  # a misread marker counts no more than this
APART_S = 0.05  # two offsets nearer than this are one


def candidate_offsets(
    rig: Rig, log_time_s: np.ndarray, q_rad: np.ndarray, seen: Seen, window_s: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets that fit best among their neighbours, the best first, and their rms [m].

    Parameters
    ----------
    rig
        Arm and markers.
    log_time_s, q_rad
        (T,) rising, (T, J): the joint log.
    seen
        Marker sightings.
    window_s
        Least and greatest offset.

    Notes
    -----
    The median difference of each marker is taken off, so that a displaced marker does no harm. Before and
    after the log the arm is taken to stand still.
    """
    few = seen.where(np.unique(np.linspace(0, len(seen.time_s) - 1, MOST_SIGHTINGS).astype(int)))
    offsets = np.arange(window_s[0], window_s[1] + STEP_S, STEP_S)
    square = np.zeros(len(offsets))
    for marker in np.unique(few.marker):
        mine = few.where(few.marker == marker)
        path_m = marker_poses(rig, q_rad, np.full(len(q_rad), marker), no_misfit(rig))[:, :2]
        for start in range(0, len(offsets), CHUNK):
            chunk = slice(start, start + CHUNK)
            times = offsets[chunk, None] + mine.time_s
            for axis in range(2):
                off = mine.pose[:, axis] - np.interp(times, log_time_s, path_m[:, axis])
                off = np.clip(off - np.median(off, axis=1, keepdims=True), -LARGEST_OFF_M, LARGEST_OFF_M)
                square[chunk] += (off**2).sum(axis=1)
    rms = np.sqrt(square / len(few.time_s))
    chosen = _best_apart(rms)
    return offsets[chosen], rms[chosen]


def shape_m(rig: Rig, rows: Rows, seen: Seen, offset_s: float, shift_s: float) -> float:
    """Return how much a shift of the offset changes the shape of the hand's path, in the median [m].

    A hand that moves evenly along a line is moved by it as a whole, and a rig is not known to the millimetre:
    only what remains beside one displacement of all its way in motion tells the offset.
    """
    speed = seen.speed_m_s()
    moving = seen.where(speed >= MOVES * np.quantile(speed, 0.98))
    changes = []
    for marker in np.unique(moving.marker):
        robot_s = moving.time_s[moving.marker == marker] + offset_s
        path_m = marker_poses(rig, rows.q_rad, np.full(len(rows.q_rad), marker), no_misfit(rig))[:, :2]
        for later_s in (-shift_s, shift_s):
            moved = [
                np.interp(robot_s + later_s, rows.time_s, axis) - np.interp(robot_s, rows.time_s, axis)
                for axis in path_m.T
            ]
            change = np.stack(moved, axis=1)
            changes.append(float(np.median(np.linalg.norm(change - np.median(change, axis=0), axis=1))))
    return min(changes)


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
