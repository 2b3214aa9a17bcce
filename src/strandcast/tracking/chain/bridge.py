"""Bridge places of the string that are missing for a few frames, or contradict the frames around them."""

import numpy as np

from strandcast.core.interpolation import lagrange_weights
from strandcast.records.track import PREDICTED
from strandcast.tracking.chain.point_uncertainty import UNSURE_M

# All measured on the tracking benchmark's tuning videos, by bridging points whose place is known.
LONGEST_BRIDGE = 10  # frames
LONGEST_SPAN = LONGEST_BRIDGE + 6  # from the first to the last of the four frames that the bridge is based on
CURVED_SHARE = 0.3  # error of the bridge over its distance from the straight line
LEAST_SIGMA_M = 0.0005  # of the bridge, where it is straight
CONTRADICTS = 2.0  # in sigmas of the bridge, from which an uncertain place is replaced


def bridge_points(
    time_s: np.ndarray, points_m: np.ndarray, sigma_m: np.ndarray, flags: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (F, n, 2), sigma and flags (F, n) of the string's points with short gaps bridged in time.

    A bridge is the cubic through the two nearest unflagged places on both sides. It fills gaps, and replaces
    flagged places off it by more than its uncertainty. Bridged places are flagged as predicted.
    """
    sure = np.isfinite(points_m).all(axis=2) & (flags == 0)
    frame, point, four = _flanked(sure)
    if len(frame) == 0:
        return points_m, sigma_m, flags
    known_m = points_m[four, point[:, None]]
    bridge_m = np.einsum("kf,kfi->ki", lagrange_weights(time_s[four], time_s[frame]), known_m)
    middle_s = time_s[four[:, 1:3]]
    share = (time_s[frame] - middle_s[:, 0]) / (middle_s[:, 1] - middle_s[:, 0])
    line_m = known_m[:, 1] + share[:, None] * (known_m[:, 2] - known_m[:, 1])
    own_m = np.hypot(LEAST_SIGMA_M, CURVED_SHARE * np.linalg.norm(bridge_m - line_m, axis=1))
    bridge_sigma_m = np.hypot(own_m, sigma_m[four, point[:, None]].max(axis=1))
    off_m = np.linalg.norm(points_m[frame, point] - bridge_m, axis=1)
    used = (bridge_sigma_m < UNSURE_M) & ~(off_m < CONTRADICTS * bridge_sigma_m)
    at = frame[used], point[used]
    points_m, sigma_m, flags = points_m.copy(), sigma_m.copy(), flags.copy()
    points_m[at], sigma_m[at], flags[at] = bridge_m[used], bridge_sigma_m[used], PREDICTED
    return points_m, sigma_m, flags


def _flanked(sure: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frame and point (K,) of each doubtful place, and the four sure frames (K, 4) around it.

    Places that are too far from sure ones are left out.
    """
    count = len(sure)
    indices = np.arange(count)[:, None]
    before = np.maximum.accumulate(np.where(sure, indices, -1))
    after = np.minimum.accumulate(np.where(sure, indices, count)[::-1])[::-1]
    frame, point = np.nonzero(~sure)
    first, last = before[frame, point], after[frame, point]
    near = (first > 0) & (last < count - 1) & (last - first - 1 <= LONGEST_BRIDGE)
    frame, point, first, last = frame[near], point[near], first[near], last[near]
    four = np.column_stack([before[first - 1, point], first, last, after[last + 1, point]])
    near = (four[:, 0] >= 0) & (four[:, 3] < count) & (four[:, 3] - four[:, 0] <= LONGEST_SPAN)
    return frame[near], point[near], four[near]
