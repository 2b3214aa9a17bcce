"""Frames of a video, in order, as full-range grey images with the time on the camera's clock."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.video.files import check_video_path
from strandcast.video.isolated import Decoding, decode_isolated
from strandcast.video.repeats import MotionMeter, repeat_warnings
from strandcast.video.source import Grey, VideoInfo

MAX_REPORTED = 5  # chosen: kinds of decoder messages, and runs of copies
NUMBER = re.compile(r"-?\b(0x)?[0-9A-F]*[0-9][0-9A-Fa-f.]*")


@dataclass
class VideoFile:
    """An open video: iterate once for ``(index, time_s, grey)``.

    ``grey`` is (height, width) uint8, or uint16 for 9 to 16 bits, from 0 to ``info.max_level``. It is
    not copied: use it before taking the next frame, and do not write into it.

    Attributes
    ----------
    info
        Properties of the frames.
    frames
        The iterator.
    messages
        Messages of the decoder so far.
    copies
        Indices of frames that are exact copies of their predecessors: the camera or a converter froze.
    changes
        How much each frame changes from the one before, from `repeats.MotionMeter`.
    """

    info: VideoInfo
    frames: Iterator[tuple[int, float, Grey]]
    messages: list[str]
    copies: list[int]
    changes: list[float]

    def __iter__(self) -> Iterator[tuple[int, float, Grey]]:
        return self.frames

    def warnings(self) -> list[str]:
        """Return warnings about the frames so far: the decoder's messages, frozen and doubled frames."""
        warnings = [f"decoder: {text}" for text in summed_up(self.messages)[:MAX_REPORTED]]
        frozen = runs(self.copies)
        for first, last in frozen[:MAX_REPORTED]:
            these = f"frames {first} to {last} are copies" if last > first else f"frame {first} is a copy"
            warnings.append(f"{these} of frame {first - 1}, bit by bit")
        if len(frozen) > MAX_REPORTED:
            warnings.append(
                f"{len(frozen) - MAX_REPORTED} more runs of copied frames, {len(self.copies)} copies in all"
            )
        return warnings + repeat_warnings(self.changes, self.copies)


def summed_up(messages: list[str]) -> list[str]:
    """Return one message of each kind with its count; messages of a kind differ in numbers only."""
    kinds: dict[str, list[str]] = {}
    for text in messages:
        kinds.setdefault(NUMBER.sub("#", text), []).append(text)
    return [texts[0] + (f" ({len(texts)} times)" if len(texts) > 1 else "") for texts in kinds.values()]


def runs(indices: list[int]) -> list[tuple[int, int]]:
    """Return the first and last number of each run of consecutive numbers in an ascending list."""
    groups = np.split(np.array(indices), np.flatnonzero(np.diff(indices) != 1) + 1)
    return [(int(group[0]), int(group[-1])) for group in groups if len(group)]


@contextmanager
def open_video(
    path: str | Path,
    threads: int = 1,
    frames: int | None = None,
) -> Iterator[VideoFile]:
    """Open a video for one sequential decoding pass, in a separate process: a bad file cannot crash this one.

    Parameters
    ----------
    path
        A video (mp4, mov, avi, mkv, cine, mraw/cihx, TIFF) or a folder of pictures.
    threads
        Decoder threads, 0 for the decoder's choice. The frames are the same.
    frames
        Decode only the first so many; of a truncated file, those before the cut.

    Yields
    ------
    VideoFile
        Frames in display order; time is the container's time stamp [s], regardless of the nominal rate.
        A video without time stamps counts 1 frame/s.

    Raises
    ------
    StrandcastError
        From the format's reader: SC-V002, SC-V005, SC-V007, SC-V010 or SC-V020 on opening; while iterating,
        SC-V005 the data end in damage, SC-V010 a frame without time stamp, of another size or an unsupported
        pixel format, or the decoder crashed, hangs or needs too much memory; SC-W004 it could not run.
    """
    check_video_path(path)
    copies: list[int] = []
    with decode_isolated(path, threads, frames) as decoding:
        meter = MotionMeter(decoding.info.max_level)
        counted = _counted(decoding, copies, meter)
        yield VideoFile(decoding.info, counted, decoding.messages, copies, meter.changes)


def _counted(decoding: Decoding, copies: list[int], meter: MotionMeter) -> Iterator[tuple[int, float, Grey]]:
    """Yield number, time [s] and grey image of each frame; note copies of the one before, and changes."""
    for index, (time_s, grey, copy) in enumerate(decoding.frames()):
        if copy:
            copies.append(index)
        meter.add(grey)
        yield index, time_s, grey
