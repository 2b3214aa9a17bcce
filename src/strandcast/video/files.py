"""The door for video files: a regular file that a video reader knows, and nothing else."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import av

from strandcast.errors import INTEGRITY, StrandcastError

# Demuxers that read one file and open no other (no playlists, no image patterns, no network).
FORMATS = "mov,matroska,avi,mjpeg,h264,hevc,ivf,ogg,nut,mpegts,asf"
MAX_PIXELS = 40_000_000  # a tiny file can claim frames that need gigabytes


def check_video_path(path: str | Path) -> Path:
    """Return `path` as an absolute path of a regular, non-empty file.

    Raises
    ------
    StrandcastError
        SC-V001 it is an address, a protocol or a pattern; SC-V002 it is missing (near names are listed);
        SC-V003 it is not a regular file; SC-V004 it is empty.
    """
    text = str(path)
    if re.match(r"^[a-zA-Z][a-zA-Z0-9+.-]+:", text):
        raise StrandcastError(
            "SC-V001", f"{text!r} is not a file of this machine: addresses and protocols are not opened",
            file=text, fix="copy the video here and give its path")  # fmt: skip
    file = Path(path)
    if not file.exists():
        pattern = " (patterns such as %03d are not opened)" if "%" in text else ""
        raise StrandcastError("SC-V002", f"the video is not there{pattern}", file=text, fix=_near_names(file))
    if not file.is_file():
        raise StrandcastError("SC-V003", "is not a regular file", file=text, fix="give the video file itself")
    if file.stat().st_size == 0:
        raise StrandcastError(
            "SC-V004", "the video is empty (0 bytes)", file=text, exit_code=INTEGRITY,
            fix="copy it again from the camera")  # fmt: skip
    return file.resolve()


def _near_names(file: Path) -> str:
    names = sorted(entry.name for entry in file.parent.iterdir()) if file.parent.is_dir() else []
    near = difflib.get_close_matches(file.name, names, n=3) or names[:3]
    if not near:
        return f"put the video into {file.parent}"
    return f"in {file.parent} there is: {', '.join(near)}"


@contextmanager
def open_container(path: str | Path) -> Iterator[tuple[av.container.InputContainer, av.VideoStream]]:
    """Open a video file; yields its container and its first video stream.

    Raises
    ------
    StrandcastError
        As `check_video_path`, and SC-V005 not a video or index lost, SC-V006 no video stream in it,
        SC-V007 frames too large.
    """
    file = check_video_path(path)
    options = {"protocol_whitelist": "file", "format_whitelist": FORMATS}
    try:
        container = av.open(f"file:{file}", options=options)
    except (av.FFmpegError, ValueError) as error:
        raise StrandcastError(
            "SC-V005", f"is not a video that can be read ({_reason(error)})", file=path,
            exit_code=INTEGRITY, fix=_open_hint(file)) from None  # fmt: skip
    with container:
        if not container.streams.video:
            raise StrandcastError("SC-V006", "holds no video stream", file=path, fix="give the camera's file")
        stream = container.streams.video[0]
        width, height = stream.codec_context.width, stream.codec_context.height
        if width * height == 0 or width * height > MAX_PIXELS:
            raise StrandcastError(
                "SC-V007", f"frames of {width} x {height} pixels are not read (limit {MAX_PIXELS} pixels)",
                file=path, fix="crop or scale the video")  # fmt: skip
        yield container, stream


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)


def _open_hint(file: Path) -> str:
    if file.suffix.lower() in {".mp4", ".mov", ".m4v"}:
        return "copy the file again: an mp4 that was cut loses the index at its end"
    return "give an mp4, mov, avi or mkv file"
