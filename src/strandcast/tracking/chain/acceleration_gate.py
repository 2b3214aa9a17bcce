"""The acceleration gate: a place to which its neighbours in time do not lead is flagged as unsure."""

import numpy as np

from strandcast.records.track import UNSURE
from strandcast.tracking.chain.point_uncertainty import UNSURE_M

LARGEST_ACCELERATION_M_S2 = 4000.0  # chosen: more than any string reaches
LEAST_DEVIATION_M = 0.003  # chosen: from the mean of both neighbours; less may be the tracker's noise


def gate_accelerations(
    points_m: np.ndarray, sigma_m: np.ndarray, flags: np.ndarray, interval_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return sigma and flags (F, n + 1) of a track in which places with implausible acceleration are unsure.

    The places (F, n + 1, 2) are those of frames evenly spaced in time.
    """
    deviation_m = np.full(points_m.shape[:2], np.nan)
    half_m = 0.5 * np.linalg.norm(points_m[:-2] - 2 * points_m[1:-1] + points_m[2:], axis=2)
    deviation_m[1:-1] = half_m
    # Next to a gap, use the two frames on the other side.
    deviation_m[2:] = np.where(np.isnan(deviation_m[2:]), half_m, deviation_m[2:])
    deviation_m[:-2] = np.where(np.isnan(deviation_m[:-2]), half_m, deviation_m[:-2])
    bar_m = max(LEAST_DEVIATION_M, 0.5 * LARGEST_ACCELERATION_M_S2 * interval_s**2)
    jumps = np.nan_to_num(deviation_m) > bar_m
    flagged = np.where(jumps, flags | UNSURE, flags)
    return np.where(jumps, np.maximum(sigma_m, UNSURE_M), sigma_m), flagged
