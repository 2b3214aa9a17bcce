"""Points that jump: a string has mass, so a place that its neighbours in time do not lead to is doubted."""

from __future__ import annotations

import numpy as np

from strandcast.records.track import UNSURE
from strandcast.tracking.judge import UNSURE_M

JUMP_M_S2 = 4000.0  # of acceleration, that no string is thought to have
LEAST_JUMP_M = 0.003  # off the middle of the frames before and after: less may be the tracker's noise


def doubt_jumps(points_m: np.ndarray, sigma_m: np.ndarray, flags: np.ndarray, interval_s: float) -> None:
    """Flag places that are far off the middle of their neighbours' in time, in place.

    Parameters
    ----------
    points_m, sigma_m, flags
        The track: (F, n + 1, 2), (F, n + 1), (F, n + 1); the frames evenly spaced.
    interval_s
        From frame to frame.
    """
    off_m = np.full(points_m.shape[:2], np.nan)
    half_m = 0.5 * np.linalg.norm(points_m[:-2] - 2 * points_m[1:-1] + points_m[2:], axis=2)
    off_m[1:-1] = half_m
    # Beside a gap, the two frames on the other side tell.
    off_m[2:] = np.where(np.isnan(off_m[2:]), half_m, off_m[2:])
    off_m[:-2] = np.where(np.isnan(off_m[:-2]), half_m, off_m[:-2])
    jumps = np.nan_to_num(off_m) > max(LEAST_JUMP_M, 0.5 * JUMP_M_S2 * interval_s**2)
    flags[jumps] |= UNSURE
    sigma_m[jumps] = np.maximum(sigma_m[jumps], UNSURE_M)
