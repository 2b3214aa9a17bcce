"""What is kept of each frame after decoding, in temporary files.

The hand is found while frames are decoded, but the background is known only afterwards; the string is
searched in crops around the hand. What the string sweeps is known later still; the film on the page is cut
from small frames.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import IO

import cv2
import numpy as np

from strandcast.core.pose import Pose
from strandcast.records.files import no_scratch, open_scratch
from strandcast.tracking.pixel_map import PixelMap, to_pixel

SMALL_PX = 1024  # chosen: the longest side of a small frame


class KeptPixels:
    """Pictures in a file that disappears with this object. Several threads may read them at a time."""

    def __init__(self) -> None:
        self._file: IO[bytes] | None = None
        self._filled = 0
        self._places: list[tuple[int, tuple[int, ...], np.dtype]] = []

    def __del__(self) -> None:
        if self._file is not None:
            with suppress(OSError):  # what could not be written is needed no longer
                self._file.close()

    def put(self, picture: np.ndarray) -> int:
        """Keep a picture, and return its number."""
        if self._file is None:
            self._file = open_scratch()
        self._places.append((self._filled, picture.shape, picture.dtype))
        try:
            self._filled += self._file.write(np.ascontiguousarray(picture).data)
        except OSError as error:
            raise no_scratch(error) from error
        return len(self._places) - 1

    def get(self, number: int) -> np.ndarray:
        """Return a picture by its number."""
        assert self._file is not None
        try:
            self._file.flush()
        except OSError as error:
            raise no_scratch(error) from error
        place, shape, dtype = self._places[number]
        data = bytearray(os.pread(self._file.fileno(), shape[0] * shape[1] * dtype.itemsize, place))
        return np.frombuffer(data, dtype).reshape(shape)


class SmallFrames:
    """Whole frames of a video, smaller by a whole factor."""

    def __init__(self, width_px: int, height_px: int) -> None:
        self.factor = -(-max(width_px, height_px) // SMALL_PX)
        self._pixels = KeptPixels()

    def keep(self, image: np.ndarray) -> None:
        """Keep the next frame; each pixel is the mean of whole ones."""
        height, width = (side // self.factor for side in image.shape)
        small = image[: height * self.factor, : width * self.factor]
        if self.factor > 1:
            small = cv2.resize(small, (width, height), interpolation=cv2.INTER_AREA)
        self._pixels.put(small)

    def pictures(self, frames: Sequence[int]) -> Iterator[np.ndarray]:
        """Yield some frames (height, width) in the video's depth."""
        return (self._pixels.get(index) for index in frames)


class Crops:
    """Crops of successive frames around the hand."""

    def __init__(self, plane: PixelMap, reach_m: float) -> None:
        self.plane = plane
        self.reach_px = int(np.ceil(reach_m / plane.metre_per_pixel))
        self._pixels = KeptPixels()
        self._kept: list[tuple[int, int, int] | None] = []  # number of the crop, and its left and top
        self._hand: Pose | None = None

    def keep(self, image: np.ndarray, hand: Pose | None) -> None:
        """Keep the part around the hand, or around its last place; nothing before it was first found."""
        self._hand = hand if hand is not None else self._hand
        if self._hand is None:
            self._kept.append(None)
            return
        u, v = to_pixel(self._hand.position_m[0], self._hand.position_m[1], self.plane)
        left, top = max(0, int(u) - self.reach_px), max(0, int(v) - self.reach_px)
        crop = image[top : max(top, int(v) + self.reach_px + 1), left : max(left, int(u) + self.reach_px + 1)]
        self._kept.append(None if min(crop.shape) < 8 else (self._pixels.put(crop), left, top))

    def at(self, index: int) -> tuple[np.ndarray, int, int] | None:
        """Return the crop of a frame, and the left and top of its first pixel in the frame; or None."""
        kept = self._kept[index]
        if kept is None:
            return None
        number, left, top = kept
        return self._pixels.get(number), left, top
