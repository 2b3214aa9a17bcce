"""The hand's path through the video, with short gaps bridged."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from strandcast.core.pose import Pose
from strandcast.records.track import PREDICTED
from strandcast.tracking.hand.finder import HandDetection

LONGEST_BRIDGE = 10  # chosen: frames over which a hidden hand is interpolated


@dataclass(frozen=True, eq=False)
class TrackedHand:
    """The hand frame by frame: poses (F,), NaN where unknown; sigma (F,) (m) and flags (F,)."""

    pose: Pose
    sigma_m: np.ndarray
    flags: np.ndarray


def bridge_hand(time_s: np.ndarray, hands: list[HandDetection | None]) -> TrackedHand:
    """Return the hand's path; short gaps are interpolated and flagged as predicted."""
    pose = np.full((len(hands), 3), np.nan)
    sigma = np.full(len(hands), np.nan)
    flags = np.full(len(hands), PREDICTED, dtype=np.int32)
    for index, hand in enumerate(hands):
        if hand is not None:
            pose[index], sigma[index], flags[index] = hand.pose.array(), hand.sigma_m, 0
    found = np.flatnonzero(flags == 0)
    pose[found, 2] = np.unwrap(pose[found, 2])
    for left, right in pairwise(found.tolist()):
        if not 1 < right - left <= LONGEST_BRIDGE:
            continue
        inside = np.arange(left + 1, right)
        ends = Pose.from_array(pose[[left, right]])
        pose[inside] = ends.interpolated(time_s[[left, right]], time_s[inside]).array()
        step_m = float(np.linalg.norm(pose[right, :2] - pose[left, :2])) / (right - left)
        sigma[inside] = max(sigma[left], sigma[right]) + 0.25 * step_m
    return TrackedHand(Pose.from_array(pose), sigma, flags)
