"""Each marker detected on the hand, frame by frame: the columns of markers.parquet."""

from collections.abc import Sequence

import numpy as np

from strandcast.tracking.hand.finder import HandDetection, HandFinder
from strandcast.tracking.result import marker_columns


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
