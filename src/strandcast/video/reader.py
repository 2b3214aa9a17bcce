"""Frames of a video, in order, as full-range grey images with the time on the camera's clock."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from strandcast.video.child import Limits, decode_in_child
from strandcast.video.files import check_video_path
from strandcast.video.formats import open_source
from strandcast.video.source import Grey, Source, VideoInfo, is_copy

TOLD = 5  # of the kinds of the decoder's messages, and of the runs of copies
NUMBER = re.compile(r"-?\b(0x)?[0-9A-F]*[0-9][0-9A-Fa-f.]*")


@dataclass
class VideoFile:
    """An open video: iterate once for ``(index, time_s, grey)``.

    ``grey`` is (height, width) uint8, or uint16 for 9 to 16 bits, from 0 to ``info.max_level``. It is
    not copied: use it before the next frame is taken (or `keep` frames later), and do not write into it.

    Attributes
    ----------
    info
        Of the frames.
    frames
        The iterator.
    messages
        The decoder's complaints, as they come.
    copies
        Indices of the frames that are exact copies of the one before: the camera or a converter froze.
    pid
        Of the process that decodes, None where it is this one.
    """

    info: VideoInfo
    frames: Iterator[tuple[int, float, Grey]]
    messages: list[str] = field(default_factory=list)
    copies: list[int] = field(default_factory=list)
    pid: int | None = None

    def __iter__(self) -> Iterator[tuple[int, float, Grey]]:
        return self.frames

    def warnings(self) -> list[str]:
        """Return what the frames so far leave to be told: the decoder's complaints, frozen frames."""
        told = [f"decoder: {text}" for text in summed_up(self.messages)[:TOLD]]
        frozen = runs(self.copies)
        for first, last in frozen[:TOLD]:
            these = f"frames {first} to {last} are copies" if last > first else f"frame {first} is a copy"
            told.append(f"{these} of frame {first - 1}, bit by bit")
        if len(frozen) > TOLD:
            told.append(f"{len(frozen) - TOLD} more runs of copied frames, {len(self.copies)} copies in all")
        return told


def summed_up(messages: list[str]) -> list[str]:
    """Return one message of each kind, with how often it came; messages of a kind differ in numbers only."""
    kinds: dict[str, list[str]] = {}
    for text in messages:
        kinds.setdefault(NUMBER.sub("#", text), []).append(text)
    return [texts[0] + (f" ({len(texts)} times)" if len(texts) > 1 else "") for texts in kinds.values()]


def runs(indices: list[int]) -> list[tuple[int, int]]:
    """Return first and last of each run of successive numbers, from numbers in order."""
    found: list[tuple[int, int]] = []
    for index in indices:
        if found and index == found[-1][1] + 1:
            found[-1] = (found[-1][0], index)
        else:
            found.append((index, index))
    return found


@contextmanager
def open_video(
    path: str | Path,
    threads: int = 1,
    isolated: bool = True,
    frames: int | None = None,
    keep: int = 1,
    limits: Limits | None = None,
) -> Iterator[VideoFile]:
    """Open a video for one sequential decoding pass.

    Parameters
    ----------
    path
        A video (mp4, mov, avi, mkv, cine, mraw/cihx, TIFF) or a folder of pictures.
    threads
        Decoder threads, 0 for the decoder's choice. The frames are the same.
    isolated
        Decode in a process of its own, which a bad file cannot take this one down with, and which works
        while this one does.
    frames
        Decode only so many, the first; of a file that was cut, those before the cut.
    keep
        A frame stays as it is until so many more have been taken.
    limits
        What the process may take.

    Yields
    ------
    VideoFile
        Frames in order of display; time is the container's time stamp (s), whatever the nominal rate says.
        A video without clock counts 1 frame/s.

    Raises
    ------
    StrandcastError
        As the format's reader: SC-V001 to V007 and V013 to V016 when it is opened; while iterating, SC-V008
        the data end in damage, SC-V009 a frame without time or of another size, SC-V010 a pixel format that
        is not read. Isolated also SC-V031 the decoder crashed, SC-V032 it hangs, SC-V033 it needs too much
        memory, SC-V034 it could not run.
    """
    check_video_path(path)
    copies: list[int] = []
    if not isolated:
        with open_source(path, threads, frames) as source:
            video = VideoFile(source.info, _counted(_compared(source), copies), copies=copies)
            try:
                yield video
            finally:
                video.messages[:] = source.messages()
        return
    with decode_in_child(path, threads, frames, keep, limits or Limits()) as decoding:
        counted = _counted(decoding.frames(), copies)
        yield VideoFile(decoding.info, counted, decoding.messages, copies, decoding.child.process.pid)


def _compared(source: Source) -> Iterator[tuple[float, Grey, bool]]:
    before: Grey | None = None
    for time_s, raw in source.raws:
        grey = source.to_grey(raw, None)
        yield time_s, grey, before is not None and is_copy(grey, before)
        before = grey


def _counted(
    frames: Iterator[tuple[float, Grey, bool]], copies: list[int]
) -> Iterator[tuple[int, float, Grey]]:
    for index, (time_s, grey, copy) in enumerate(frames):
        if copy:
            copies.append(index)
        yield index, time_s, grey
