"""The hand through the video: its path, with short gaps bridged, and each detected marker."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from strandcast.core.pose import Pose
from strandcast.records.track import PREDICTED
from strandcast.tracking.hand.finder import HandDetection, HandFinder
from strandcast.tracking.result import marker_columns

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


def marker_table(
    finder: HandFinder, hands: Sequence[HandDetection | None], time_s: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the columns of markers.parquet, sorted by frame and marker; frames at times (F,)."""
    parts = []
    for marker in finder.markers:
        corners_px = {
            index: hand.corners_px[marker]
            for index, hand in enumerate(hands)
            if hand is not None and marker in hand.corners_px
        }
        if not corners_px:
            continue
        frames = list(corners_px)
        pose, sigma_m = finder.marker_poses(marker, np.stack(list(corners_px.values())))
        pose[:, 2] = np.unwrap(pose[:, 2])
        parts.append(np.column_stack([frames, time_s[frames], np.full(len(frames), marker), pose, sigma_m]))
    table = np.concatenate(parts) if parts else np.zeros((0, 7))
    return marker_columns(table[np.lexsort((table[:, 2], table[:, 0]))])
