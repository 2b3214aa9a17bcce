"""Frames that repeat the one before without being its exact copy: doubled, then encoded again."""

import cv2
import numpy as np

from strandcast.video.source import Grey

HALVINGS = 3  # chosen: blocks of 8 x 8 pixels are compared; their means hide noise and coding
# Chosen. A string of 3 px, 60 grey levels off its background, changes a block by 20 levels; noise of 3
# levels changes the worst of 15,000 blocks by 2.5, encoding again by about as much.
LEAST_MOTION = 8.0  # change of a block, in 255ths of the grey range, from one frame to the next
STOPPED = 0.25  # change relative to that of the frames on both sides, where a motion cannot have stopped
LONGEST_RUN = 16  # repeats of one frame; a longer rest is a real one
# Of the frames between the first and the last motion. A pendulum stands still in 2 % of its frames.
LEAST_SHARE, LEAST_COUNT = 0.1, 5


class MotionMeter:
    """The largest change of a block from each frame to the next, in 255ths of the grey range."""

    def __init__(self, max_level: int) -> None:
        self.changes: list[float] = []
        self._scale = 255.0 / max_level
        self._before: np.ndarray | None = None

    def add(self, grey: Grey) -> None:
        """Compare a frame with the one before; the first changes by 0."""
        blocks = grey
        for _ in range(HALVINGS):  # OpenCV halves fast: 0.1 ms for 1280 x 720 pixels, at once 0.3 ms
            height, width = (max(side // 2, 1) for side in blocks.shape)
            blocks = cv2.resize(blocks, (width, height), interpolation=cv2.INTER_AREA)
        change = 0.0 if self._before is None else cv2.norm(blocks, self._before, cv2.NORM_INF)
        self.changes.append(change * self._scale)
        self._before = blocks


def repeated_frames(changes: list[float]) -> list[int]:
    """Return the frames in which a motion stops at once and continues at once.

    Parameters
    ----------
    changes
        From `MotionMeter`, one per frame.
    """
    change = np.asarray(changes, dtype=float)
    still = np.zeros(len(change), dtype=bool)
    moving = change >= LEAST_MOTION
    stops = np.flatnonzero(moving[:-1] & (change[1:] < STOPPED * change[:-1])) + 1
    for first in stops.tolist():
        limit = STOPPED * change[first - 1]
        run = change[first : first + LONGEST_RUN + 1]
        ends = np.flatnonzero(run >= limit)
        if len(ends) and moving[first + ends[0]] and run[: ends[0]].max() < STOPPED * run[ends[0]]:
            still[first : first + ends[0]] = True
    return np.flatnonzero(still).tolist()


def repeat_warnings(changes: list[float], copies: list[int]) -> list[str]:
    """Return a warning if many frames of the motion repeat the one before, those apart that are `copies`."""
    moving = np.flatnonzero(np.asarray(changes) >= LEAST_MOTION)
    repeated = [frame for frame in repeated_frames(changes) if frame not in set(copies)]
    if len(repeated) < LEAST_COUNT or len(repeated) < LEAST_SHARE * np.ptp(moving):
        return []
    total = int(np.ptp(moving)) + 1
    real = 1.0 - len(repeated) / total
    examples = "{}, {} and {}".format(*repeated)
    return [
        f"{len(repeated)} of the {total} frames with motion show nothing new, as {examples}: a converter "
        f"doubled frames and encoded them again, so that about {real:.0%} of the frame rate is real; use the "
        "camera's original file"
    ]
