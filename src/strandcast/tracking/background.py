"""The empty scene: a median over frames that differ from each other as much as possible."""

from collections.abc import Sequence

import cv2
import numpy as np
from numba import njit

from strandcast.threads import over_ranges

FRAMES = 40  # of the median; chosen, not sensitive: they differ from each other as much as possible
THUMB_PX = 8  # chosen: frames are compared by the means of squares of this side
KEPT_BYTES = 120e6  # chosen: of frames held at a time
STACKED_ROWS = 16  # chosen: rows of all pictures that fit into a processor's cache


class Samples:
    """Frames kept during a decoding pass, evenly spread over a known number of frames."""

    def __init__(self, packets: int, frame_bytes: int) -> None:
        wanted = max(8, min(3 * FRAMES, int(KEPT_BYTES / frame_bytes)))
        self.every = max(1, -(-packets // wanted))
        self.indices: list[int] = []
        self.pictures: list[np.ndarray] = []

    def offer(self, index: int, image: np.ndarray) -> None:
        """Keep a copy of the frame if its index is one of those sampled."""
        if index % self.every == 0:
            self.indices.append(index)
            self.pictures.append(image.copy())


def learn_background(pictures: list[np.ndarray], frames: int = FRAMES) -> tuple[np.ndarray, np.ndarray]:
    """Return the median (H, W) of grey frames (H, W) in their type, and the indices of those used.

    The string may rest in one place for most of the recording; a median over frames evenly spread in time
    would then contain it. Instead, the `frames` pictures that differ most from each other are used.
    """
    size = (pictures[0].shape[1] // THUMB_PX, pictures[0].shape[0] // THUMB_PX)
    thumbs = np.stack([cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in pictures])
    chosen = unlike_frames(thumbs, min(frames, len(thumbs)))
    return pixel_median([pictures[k] for k in chosen]), chosen


def unlike_frames(thumbs: np.ndarray, count: int) -> np.ndarray:
    """Return indices of `count` pictures (N, h, w), each as different from those before it as possible."""
    chosen: list[int] = []
    nearest = np.full(len(thumbs), np.inf)
    while len(chosen) < count:
        new = int(np.argmax(nearest))
        chosen.append(new)
        nearest = np.minimum(nearest, [cv2.norm(thumb, thumbs[new], cv2.NORM_L1) for thumb in thumbs])
    return np.sort(np.asarray(chosen))


def pixel_median(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Return the lower median of pictures (H, W) of unsigned integers."""
    median = np.zeros_like(pictures[0])

    def of_rows(first: int, last: int) -> None:
        for start in range(first, last, STACKED_ROWS):
            rows = slice(start, min(start + STACKED_ROWS, last))
            stack = np.stack([picture[rows] for picture in pictures])
            _pixel_median(0, len(stack[0]), stack, median[rows])

    over_ranges(len(median), of_rows)
    return median


@njit(cache=True, nogil=True)
def _pixel_median(first: int, last: int, stack: np.ndarray, median: np.ndarray) -> None:
    """Fill the rows `first` to `last` of the median.

    Bit by bit from the highest: the median is the largest value that more than half of the pictures reach.
    Each step compares a whole row, many pixels at a time; sorting takes twenty times longer.
    """
    count, _, width = stack.shape
    bits = 8 * stack.itemsize
    needed = count - (count - 1) // 2
    for i in range(first, last):
        reached = np.empty(width, dtype=np.int16)
        trial = np.empty(width, dtype=stack.dtype)
        for bit in range(bits - 1, -1, -1):
            for j in range(width):
                trial[j] = median[i, j] | (1 << bit)
                reached[j] = 0
            for k in range(count):
                for j in range(width):
                    reached[j] += stack[k, i, j] >= trial[j]
            for j in range(width):
                if reached[j] >= needed:
                    median[i, j] = trial[j]
