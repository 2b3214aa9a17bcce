"""The scene without arm and string: a median over frames that differ from each other as much as possible."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numba import njit, prange

from strandcast.video.reader import open_video

THUMB_PX = 8  # frames are compared on every 8th pixel
KEPT_BYTES = 120e6  # of frames held at a time


def learn_background(path: str | Path, packets: int, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Learn the background of a video.

    The string may rest in one place for most of the recording, so that a median over frames evenly spread in
    time would hold it. Frames are therefore chosen to be as unlike each other as possible.

    Parameters
    ----------
    path
        The video.
    packets
        How many frames it has.
    frames
        How many to take the median of.

    Returns
    -------
    background : ndarray (height, width)
        Grey levels, of the video's own type.
    chosen : ndarray
        Indices of the frames used.
    """
    every = max(1, packets // (3 * frames))
    indices: list[int] = []
    pictures: list[np.ndarray] = []
    with open_video(path) as video:
        limit = max(
            8, int(KEPT_BYTES / (video.info.width * video.info.height * (1 + (video.info.max_level > 255))))
        )
        every = max(every, -(-packets // limit))
        for index, _, grey in video:
            if index % every == 0:
                indices.append(index)
                pictures.append(grey.copy())
    stack = np.stack(pictures)
    kept = unlike_frames(stack[:, ::THUMB_PX, ::THUMB_PX], min(frames, len(stack)))
    return pixel_median(stack[kept]), np.asarray(indices)[kept]


def unlike_frames(thumbs: np.ndarray, count: int) -> np.ndarray:
    """Return indices of `count` pictures (N, h, w), each as unlike those before it as possible."""
    flat = thumbs.reshape(len(thumbs), -1).astype(np.float32)
    chosen = [0]
    nearest = np.abs(flat - flat[0]).mean(axis=1)
    while len(chosen) < count:
        new = int(np.argmax(nearest))
        chosen.append(new)
        nearest = np.minimum(nearest, np.abs(flat - flat[new]).mean(axis=1))
    return np.sort(np.asarray(chosen))


@njit(cache=True, parallel=True)
def pixel_median(stack: np.ndarray) -> np.ndarray:
    """Return the lower median over the first axis of (N, H, W)."""
    count, height, width = stack.shape
    median = np.empty((height, width), dtype=stack.dtype)
    for i in prange(height):
        values = np.empty(count, dtype=stack.dtype)
        for j in range(width):
            for k in range(count):
                value = stack[k, i, j]
                m = k
                while m > 0 and values[m - 1] > value:
                    values[m] = values[m - 1]
                    m -= 1
                values[m] = value
            median[i, j] = values[(count - 1) // 2]
    return median
