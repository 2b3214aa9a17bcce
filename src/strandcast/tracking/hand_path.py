"""The hand frame by frame, short gaps bridged."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from strandcast.records.track import PREDICTED
from strandcast.tracking.hand import HandSighting

LONGEST_BRIDGE = 10  # frames over which a hand that was not seen is bridged


@dataclass(frozen=True)
class HandPath:
    """The hand frame by frame: pose (F, 3) (NaN where not known), sigma (F,) (m) and flags (F,)."""

    pose: np.ndarray
    sigma_m: np.ndarray
    flags: np.ndarray


def bridge_hand(time_s: np.ndarray, hands: list[HandSighting | None]) -> HandPath:
    """Return the hand's path; short gaps are filled by straight lines and flagged as predicted."""
    pose = np.full((len(hands), 3), np.nan)
    sigma = np.full(len(hands), np.nan)
    flags = np.full(len(hands), PREDICTED, dtype=np.int32)
    for index, hand in enumerate(hands):
        if hand is not None:
            pose[index], sigma[index], flags[index] = hand.pose, hand.sigma_m, 0
    seen = np.flatnonzero(flags == 0)
    pose[seen, 2] = np.unwrap(pose[seen, 2])
    for left, right in pairwise(seen.tolist()):
        if not 1 < right - left <= LONGEST_BRIDGE:
            continue
        inside = np.arange(left + 1, right)
        for axis in range(3):
            pose[inside, axis] = np.interp(time_s[inside], time_s[[left, right]], pose[[left, right], axis])
        step_m = float(np.linalg.norm(pose[right, :2] - pose[left, :2])) / (right - left)
        sigma[inside] = max(sigma[left], sigma[right]) + 0.25 * step_m
    return HandPath(pose, sigma, flags)
