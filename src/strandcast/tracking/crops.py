"""The part of each frame that the string can reach, kept after decoding: in memory, then in a file.

The hand is found while frames are decoded, but the background is known only afterwards; the string is
searched in these crops.
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import IO

import numpy as np

from strandcast.core.pose import Pose
from strandcast.records.files import no_scratch, open_scratch
from strandcast.tracking.pixel_map import PixelMap, to_pixel

MEMORY_BYTES = 150e6  # chosen: beyond this, crops go to a file


@dataclass(frozen=True)
class Crop:
    """A part of one frame."""

    left: int  # of its first pixel in the frame
    top: int
    shape: tuple[int, int]
    dtype: np.dtype
    data: np.ndarray | int  # the pixels, or their offset in the file


class Crops:
    """Crops of successive frames around the hand. Several threads may read them at a time."""

    def __init__(self, plane: PixelMap, reach_m: float) -> None:
        self.plane = plane
        self.reach_px = int(np.ceil(reach_m / plane.metre_per_pixel))
        self._kept: list[Crop | None] = []
        self._bytes = 0
        self._file: IO[bytes] | None = None
        self._filled = 0
        self._hand: Pose | None = None

    def __enter__(self) -> Crops:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            with suppress(OSError):  # what could not be written is needed no longer
                self._file.close()

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._kept)

    def keep(self, image: np.ndarray, hand: Pose | None) -> None:
        """Keep the part around the hand, or around its last place; nothing before it was first found."""
        self._hand = hand if hand is not None else self._hand
        if self._hand is None:
            self._kept.append(None)
            return
        u, v = to_pixel(self._hand.position_m[0], self._hand.position_m[1], self.plane)
        left, top = max(0, int(u) - self.reach_px), max(0, int(v) - self.reach_px)
        crop = image[top : max(top, int(v) + self.reach_px + 1), left : max(left, int(u) + self.reach_px + 1)]
        if min(crop.shape) < 8:
            self._kept.append(None)
            return
        shape = (crop.shape[0], crop.shape[1])
        self._kept.append(Crop(left, top, shape, crop.dtype, self._store(crop)))

    def _store(self, crop: np.ndarray) -> np.ndarray | int:
        """Return a copy while there is room in memory, then the offset in the scratch file."""
        self._bytes += crop.nbytes
        if self._bytes <= MEMORY_BYTES:
            return crop.copy()
        if self._file is None:
            self._file = open_scratch()
        place = self._filled
        try:
            self._filled += self._file.write(np.ascontiguousarray(crop).data)
        except OSError as error:
            raise no_scratch(error) from error
        return place

    def at(self, index: int) -> tuple[np.ndarray, int, int] | None:
        """Return the crop of a frame, and the left and top of its first pixel in the frame; or None."""
        kept = self._kept[index]
        if kept is None:
            return None
        if isinstance(kept.data, np.ndarray):
            return kept.data, kept.left, kept.top
        assert self._file is not None
        try:
            self._file.flush()
        except OSError as error:
            raise no_scratch(error) from error
        count = kept.shape[0] * kept.shape[1] * kept.dtype.itemsize
        data = bytearray(os.pread(self._file.fileno(), count, kept.data))
        return np.frombuffer(data, kept.dtype).reshape(kept.shape), kept.left, kept.top
