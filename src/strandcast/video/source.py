"""The types that all frame readers share: a video's contents without decoding it, and its frames in order.

numpy is imported on use: the process that decodes a video starts in half the time if it can do without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from strandcast.errors import StrandcastError

if TYPE_CHECKING:
    import numpy as np

    Grey = np.ndarray
else:
    Grey = Any

MAX_PIXELS = 40_000_000  # a tiny file can claim frames that need gigabytes
# Chosen: relative difference of width and height above which pixels are not square. Scaling to whole pixels
# changes the ratio by less, as does a lens' fit.
SQUARE_TOLERANCE = 0.02
FEW_BYTES = 1024  # chosen: of the middle of a frame, which distinguish nearly all frames


@dataclass(frozen=True)
class VideoInfo:
    """Properties of the frames as the decoder states them; sizes in pixels, grey levels 0 to `max_level`.

    `pixel_aspect` is a pixel's width over its height; 1 where the file states none.
    """

    path: Path
    width: int
    height: int
    codec: str
    pixel_format: str
    max_level: int
    pixel_aspect: float = 1.0

    @property
    def pixel_bytes(self) -> int:
        """Return the size of a pixel [bytes]."""
        return 1 if self.max_level < 256 else 2

    @property
    def frame_bytes(self) -> int:
        """Return the size of a grey image [bytes]."""
        return self.width * self.height * self.pixel_bytes

    @property
    def dtype(self) -> np.dtype:
        """Return the type of a frame's pixels."""
        import numpy as np

        return np.dtype(f"u{self.pixel_bytes}")


@dataclass
class Source:
    """An open video in this process.

    Attributes
    ----------
    raws
        Time [s] and raw frame, in order of display.
    to_grey
        Returns the grey image (height, width) of a raw frame; writes it to the second argument if that is an
        array.
    messages
        Returns the decoder's messages so far.
    as_it_is
        Returns the memory of a raw frame if that is the grey image already, pixel after pixel, or None.
    """

    info: VideoInfo
    raws: Iterator[tuple[float, Any]]
    to_grey: Callable[[Any, Grey | None], Grey]
    messages: Callable[[], list[str]] = list
    as_it_is: Callable[[Any], memoryview | None] = lambda raw: None

    def write(self, raw: Any, slot: memoryview) -> None:
        """Write the grey image of a raw frame to memory of its size."""
        grey = self.as_it_is(raw)
        if grey is not None:
            slot[:] = grey
            return
        import numpy as np

        shape = (self.info.height, self.info.width)
        self.to_grey(raw, np.frombuffer(slot, self.info.dtype).reshape(shape))


@dataclass(frozen=True)
class Contents:
    """The contents of a video; at most its first frame is decoded for them.

    Attributes
    ----------
    ticks
        Time stamp of each frame in order of display, in units of `time_base_s`.
    time_base_s
        None if the file states no rate (image sequences): ticks then count frames.
    promised, exact
        Number of frames that the header states, 0 if it states none; False if derived from a duration.
    discarded
        Number of packets without a picture, or that the container's edit list removes.
    camera_clock
        Whether the camera wrote the times or the rate when it recorded, so that they are no playing speed.
    breaks_off
        Why the data end before the file does; None if they do not.
    several_rates
        Why the frames were filmed at more than one rate, by the file itself; None if it says no such thing.
    notes
        Remarks for the user.
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
    camera_clock: bool = False
    breaks_off: str | None = None
    several_rates: str | None = None
    notes: list[str] = field(default_factory=list)


def check_pixels(width: int, height: int, path: str | Path) -> None:
    """Refuse frames that are too large to decode (SC-V007)."""
    if width * height <= 0 or width * height > MAX_PIXELS:
        what = f"frames of {width} x {height} pixels are not supported (limit {MAX_PIXELS} pixels)"
        raise StrandcastError("SC-V007", what, file=path)


def in_place(image: Grey, out: Grey | None) -> Grey:
    """Return `image`, copied to `out` if that is an array."""
    if out is None:
        return image
    out[...] = image
    return out


def is_copy(frame: memoryview, previous: memoryview) -> bool:
    """Return whether the bytes of two frames are identical: a camera's noise never repeats."""
    middle = slice(len(frame) // 2, len(frame) // 2 + FEW_BYTES)
    return bytes(frame[middle]) == bytes(previous[middle]) and bytes(frame) == bytes(previous)
