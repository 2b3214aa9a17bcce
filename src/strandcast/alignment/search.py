"""The coarse search: every offset at which the log could belong to the video, on a grid."""

from __future__ import annotations

import numpy as np

from strandcast.alignment.rig import Rig, Seen, marker_poses, no_misfit

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
