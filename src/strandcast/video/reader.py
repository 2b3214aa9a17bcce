"""Frames of a video file, in order, as full-range grey images with the time on the camera's clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import av
import cv2
import numpy as np

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.video.files import open_container

LUMA_8BIT = {"yuv420p", "yuv422p", "yuv444p", "yuv411p", "yuv440p", "nv12", "nv21"}
FULL_8BIT = {"yuvj420p", "yuvj422p", "yuvj444p", "gray"}
FULL_RANGE_TAG = 2  # AVCOL_RANGE_JPEG
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


@dataclass
class VideoFile:
    """An open video: iterate once for ``(index, time_s, grey)``; `messages` are the decoder's complaints.

    ``grey`` is (height, width) uint8, or uint16 for 9 to 16 bits, from 0 to ``info.max_level``. It is
    not copied: use it before the next frame is taken.
    """

    info: VideoInfo
    frames: Iterator[tuple[int, float, Grey]]
    messages: list[str] = field(default_factory=list)

    def __iter__(self) -> Iterator[tuple[int, float, Grey]]:
        return self.frames


@contextmanager
def open_video(path: str | Path, threads: int = 0) -> Iterator[VideoFile]:
    """Open a video for one sequential decoding pass.

    Parameters
    ----------
    path
        A video file (mp4, mov, avi, mkv ...).
    threads
        Decoder threads, 0 for the decoder's choice. The frames are the same.

    Yields
    ------
    VideoFile
        Frames in presentation order; time is ``pts * time_base`` (s), whatever the nominal rate says.

    Raises
    ------
    StrandcastError
        As `open_container`; while iterating SC-V008 the data end in damage, SC-V009 a frame without time
        or of another size, SC-V010 a pixel format that is not read.
    """
    av.logging.set_level(av.logging.WARNING)
    try:
        # Decoder threads are not this thread: the capture must be global.
        with av.logging.Capture(local=False) as log, open_container(path) as (container, stream):
            stream.thread_type = "AUTO"
            stream.codec_context.thread_count = threads
            context = stream.codec_context
            name = context.format.name
            to_grey, max_level = grey_converter(name, int(context.color_range), Path(path))
            info = VideoInfo(Path(path), context.width, context.height, context.name, name, max_level)
            video = VideoFile(info, _frames(container, stream, info, to_grey))
            try:
                yield video
            finally:
                video.messages.extend(f"{name}: {text.strip()}" for _, name, text in log)
    finally:
        av.logging.set_level(None)


def _frames(
    container: av.container.InputContainer,
    stream: av.VideoStream,
    info: VideoInfo,
    to_grey: Callable[[av.VideoFrame], Grey],
) -> Iterator[tuple[int, float, Grey]]:
    index = 0
    try:
        for frame in container.decode(stream):
            if frame.pts is None or (frame.width, frame.height) != (info.width, info.height):
                what = f"frame {index} has no time stamp or another size ({frame.width} x {frame.height})"
                raise StrandcastError("SC-V009", what, file=info.path, exit_code=INTEGRITY)
            yield index, float(frame.pts * frame.time_base), to_grey(frame)
            index += 1
    except av.FFmpegError as error:
        raise StrandcastError(
            "SC-V008", f"the video breaks off after {index} frames ({error.strerror})", file=info.path,
            exit_code=INTEGRITY, cost="the rest of the throw is not seen",
            fix="copy the file again from the camera") from None  # fmt: skip


def grey_converter(
    pixel_format: str, color_range: int, file: Path
) -> tuple[Callable[[av.VideoFrame], Grey], int]:
    """Return the function that makes a full-range grey image of a frame, and its largest level.

    The luma plane of ``yuv420p`` is of limited range: black is 16, white 235. Taken as it is, contrast
    is lost and levels do not compare with a grey video's; ``yuvj`` and ``gray`` are full.
    """
    if pixel_format in FULL_8BIT or (pixel_format in LUMA_8BIT and color_range == FULL_RANGE_TAG):
        return _luma, 255
    if pixel_format in LUMA_8BIT:
        return _expanded_luma, 255
    depth = _depth(pixel_format)
    if depth > 8 and pixel_format.startswith("gray"):
        return _luma_16, (1 << depth) - 1
    if depth > 8:
        return lambda frame: frame.to_ndarray(format="gray16le"), 65535
    if depth == 8:
        return lambda frame: frame.to_ndarray(format="gray"), 255
    raise StrandcastError(
        "SC-V010",
        f"pixel format {pixel_format!r} is not read",
        file=file,
        fix="convert the video to 8-bit grey",
    )


def _depth(pixel_format: str) -> int:
    components = av.VideoFormat(pixel_format).components
    return max((component.bits for component in components), default=0)


_EXPAND = np.clip(np.rint((np.arange(256) - 16.0) * 255.0 / 219.0), 0, 255).astype(np.uint8)


def _luma(frame: av.VideoFrame) -> Grey:
    plane = frame.planes[0]
    return np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[: frame.height, : frame.width]


def _expanded_luma(frame: av.VideoFrame) -> Grey:
    return np.asarray(cv2.LUT(_luma(frame), _EXPAND))


def _luma_16(frame: av.VideoFrame) -> Grey:
    plane = frame.planes[0]
    kind = np.dtype(">u2" if frame.format.name.endswith("be") else "<u2")
    rows = np.frombuffer(plane, kind).reshape(-1, plane.line_size // 2)[: frame.height, : frame.width]
    return rows.astype(np.uint16, copy=False)
