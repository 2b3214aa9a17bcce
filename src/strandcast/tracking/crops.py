"""The part of each frame that the string can reach, kept for a second look: in memory, then in a file.

The hand is found while frames are decoded, the background is known only after: the string waits in crops.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from types import TracebackType
from typing import IO

import numpy as np

from strandcast.tracking.pixelmap import PixelMap, to_pixel

MEMORY_BYTES = 150e6  # beyond this, crops go to a file


@dataclass(frozen=True)
class View:
    """A crop of one frame: picture, background, the plane's map to its pixels, and its place in the frame."""

    image: np.ndarray
    background: np.ndarray
    pixels: PixelMap
    left: int
    top: int


class Crops:
    """Crops of successive frames around the hand."""

    def __init__(self, pixels: PixelMap, reach_m: float) -> None:
        self.pixels = pixels
        self.reach_px = int(np.ceil(reach_m / pixels.metre_per_pixel))
        self._kept: list[tuple[int, int, tuple[int, int], np.dtype, bytes | int] | None] = []
        self._bytes = 0
        self._file: IO[bytes] | None = None
        self._hand: np.ndarray | None = None

    def __enter__(self) -> Crops:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()

    def keep(self, image: np.ndarray, hand: np.ndarray | None) -> None:
        """Keep what lies around the hand, or around where it was last; nothing before it was seen."""
        self._hand = hand if hand is not None else self._hand
        if self._hand is None:
            self._kept.append(None)
            return
        pixels = self.pixels
        u, v = to_pixel(self._hand[0], self._hand[1], pixels.origin_m, pixels.step_m, pixels.uv)
        left, top = max(0, int(u) - self.reach_px), max(0, int(v) - self.reach_px)
        crop = image[top : max(top, int(v) + self.reach_px + 1), left : max(left, int(u) + self.reach_px + 1)]
        if min(crop.shape) < 8:
            self._kept.append(None)
            return
        shape = (crop.shape[0], crop.shape[1])
        self._kept.append((left, top, shape, crop.dtype, self._store(crop.tobytes())))

    def _store(self, data: bytes) -> bytes | int:
        """Return the data while there is room in memory, else their place in the scratch file."""
        self._bytes += len(data)
        if self._bytes <= MEMORY_BYTES:
            return data
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="strandcast-")  # noqa: SIM115  (closed by __exit__)
        place = self._file.seek(0, 2)
        self._file.write(data)
        return place

    def view(self, index: int, background: np.ndarray) -> View | None:
        """Return the crop of a frame."""
        kept = self._kept[index]
        if kept is None:
            return None
        left, top, shape, dtype, data = kept
        if isinstance(data, int):
            assert self._file is not None
            self._file.seek(data)
            data = self._file.read(shape[0] * shape[1] * dtype.itemsize)
        image = np.frombuffer(data, dtype).reshape(shape)
        behind = np.ascontiguousarray(background[top : top + shape[0], left : left + shape[1]])
        return View(image, behind, self.pixels.shifted(left, top), left, top)
