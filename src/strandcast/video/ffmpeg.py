"""Opening of video containers with FFmpeg's libraries."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import av
from av.stream import Disposition

from strandcast.errors import StrandcastError
from strandcast.video.files import check_video_path, damaged
from strandcast.video.source import check_pixels

# Demuxers that read one file and open no other (no playlists, no image patterns, no network).
FORMATS = "mov,matroska,avi,mjpeg,h264,hevc,ivf,ogg,nut,mpegts,asf,cine"


@dataclass(frozen=True)
class OpenContainer:
    """An open container, its first video stream that is no picture, and FFmpeg's log while it is open."""

    container: av.container.InputContainer
    stream: av.VideoStream
    log: list[tuple[int, str, str]]

    def messages(self) -> list[str]:
        """Return FFmpeg's messages so far."""
        return [f"{name}: {text.strip()}" for _, name, text in self.log]


@contextmanager
def open_container(path: str | Path) -> Iterator[OpenContainer]:
    """Open a video file.

    Raises
    ------
    StrandcastError
        As `check_video_path`, and SC-V005 not a video or index missing, SC-V010 no video stream,
        an unsupported codec or frames in another file, SC-V007 frames too large.
    """
    file = check_video_path(path)
    options = {"protocol_whitelist": "file", "format_whitelist": FORMATS}
    av.logging.set_level(av.logging.WARNING)
    try:
        # Decoder threads are not this thread: the capture must be global.
        with av.logging.Capture(local=False) as log:
            try:
                container = av.open(f"file:{file}", options=options)
            except (av.FFmpegError, ValueError) as error:
                what = f"is not a video that can be read ({reason(error)})"
                raise damaged("SC-V005", what, path, fix=_open_hint(file)) from None
            with container:
                _check_self_contained(log, path)
                yield OpenContainer(container, _video_stream(container, path), log)
    finally:
        av.logging.set_level(None)


def _video_stream(container: av.container.InputContainer, path: str | Path) -> av.VideoStream:
    if not container.streams.video:
        raise StrandcastError("SC-V010", "contains no video stream", file=path, fix="give the camera's file")
    films = [each for each in container.streams.video if not each.disposition & Disposition.attached_pic]
    stream = (films or container.streams.video)[0]
    context = stream.codec_context
    if context is None:
        fix = "convert the video to FFV1 or H.264"
        raise StrandcastError("SC-V010", "has an unsupported codec", file=path, fix=fix)
    check_pixels(context.width, context.height, path)
    if context.format is None:
        raise damaged("SC-V005", "contains no complete frame", path)
    return stream


def _check_self_contained(log: list[tuple[int, str, str]], path: str | Path) -> None:
    """Refuse a QuickTime file that refers to another one for its frames: FFmpeg logs that it skipped it."""
    if any("external track" in text for _, _, text in log):
        what = "its frames are in another file, which is not opened"
        raise StrandcastError("SC-V010", what, file=path, fix="save it as a self-contained movie")


def reason(error: Exception) -> str:
    """Return FFmpeg's description of an error; raise MemoryError if memory ran out."""
    if getattr(error, "errno", None) == errno.ENOMEM:
        raise MemoryError from None
    return str(getattr(error, "strerror", None) or error)


def _open_hint(file: Path) -> str:
    if file.suffix.lower() in {".mp4", ".mov", ".m4v"}:
        return "copy the file again: a truncated or unfinished mp4 has no index at its end"
    return "give an mp4, mov, avi, mkv or cine file"
