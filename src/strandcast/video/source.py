"""What every reader of a video format gives: facts without decoding, and frames one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.errors import StrandcastError

MAX_PIXELS = 40_000_000  # a tiny file can claim frames that need gigabytes
Grey = np.ndarray


@dataclass(frozen=True)
class VideoInfo:
    """What the decoder says about the frames: size in pixels, pixel format, levels of grey."""

    path: Path
    width: int
    height: int
    codec: str
    pixel_format: str
    max_level: int

    @property
    def dtype(self) -> np.dtype:
        """Return the type of a frame's pixels."""
        return np.dtype(np.uint8 if self.max_level < 256 else np.uint16)


@dataclass
class Source:
    """An open video in this process.

    Attributes
    ----------
    info
        Of the frames.
    raws
        Time (s) and raw frame, in order of display.
    to_grey
        Makes the grey image (height, width) of a raw frame, in the array given if there is one.
    messages
        Returns the decoder's complaints so far.
    """

    info: VideoInfo
    raws: Iterator[tuple[float, Any]]
    to_grey: Callable[[Any, Grey | None], Grey]
    messages: Callable[[], list[str]] = list


@dataclass(frozen=True)
class Contents:
    """What a video holds, told without decoding it (but for its first frame).

    Attributes
    ----------
    container, codec, pixel_format, width_px, height_px
        As the file says.
    ticks
        Time stamp of each frame in order of display, in `time_base_s`.
    time_base_s
        None where the file states no rate (image sequences): then ticks count frames.
    promised, exact
        Frames that the header promises, 0 if it does not; and whether that is a count, not a duration.
    discarded
        Frames that the container's edit list takes out.
    breaks_off
        Why the data end before the file does; None if they do not.
    notes
        What a user should know, in words.
    """

    container: str
    codec: str
    pixel_format: str
    width_px: int
    height_px: int
    ticks: list[int]
    time_base_s: float | None
    promised: int = 0
    exact: bool = True
    discarded: int = 0
    breaks_off: str | None = None
    notes: list[str] = field(default_factory=list)


def check_pixels(width: int, height: int, path: str | Path) -> None:
    """Refuse frames too large to be decoded, before any is (SC-V007)."""
    if width * height <= 0 or width * height > MAX_PIXELS:
        raise StrandcastError(
            "SC-V007", f"frames of {width} x {height} pixels are not read (limit {MAX_PIXELS} pixels)",
            file=path, fix="crop or scale the video")  # fmt: skip


def in_place(image: Grey, out: Grey | None) -> Grey:
    """Return `image`, in the array given if there is one."""
    if out is None:
        return image
    np.copyto(out, image)
    return out


def is_copy(now: Grey, before: Grey) -> bool:
    """Return whether a frame is the exact copy of another: a camera's noise never repeats.

    One row tells nearly all frames apart.
    """
    row = len(now) // 2
    return bool(np.array_equal(now[row], before[row]) and np.array_equal(now, before))
