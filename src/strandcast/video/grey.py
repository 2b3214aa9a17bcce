"""Grey images of the frames that FFmpeg decodes, over the full range of levels; numpy is imported on use."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import av

from strandcast.errors import StrandcastError
from strandcast.video.source import Grey, in_place

LUMA_8BIT = {"yuv420p", "yuv422p", "yuv444p", "yuv411p", "yuv440p", "nv12", "nv21"}
FULL_8BIT = {"yuvj420p", "yuvj422p", "yuvj444p", "gray"}
UPRIGHT = {"gray": "yuvj420p", "gray16le": "gray16be"}  # the same grey in other formats: the scaler must copy
FULL_RANGE_TAG = 2  # AVCOL_RANGE_JPEG
BLACK, WHITE = 16, 235  # of limited range
CONVERT = "convert the video to 8-bit grey"


def grey_converter(
    pixel_format: str, color_range: int, file: Path
) -> tuple[Callable[[av.VideoFrame, Grey | None], Grey], int]:
    """Return a function from a frame to its full-range grey image, and the largest grey level.

    Black is 16 and white 235 in the luma plane of ``yuv420p`` (limited range), which is expanded, so that
    levels compare with those of a grey video; ``yuvj`` and ``gray`` have the full range.
    """
    if is_full_range(pixel_format, color_range):
        return lambda frame, out: in_place(luma(frame), out), 255
    if pixel_format in LUMA_8BIT:
        return lambda frame, out: expand(luma(frame), out), 255
    depth = max((component.bits for component in av.VideoFormat(pixel_format).components), default=0)
    if depth > 8 and pixel_format.startswith("gray"):
        return lambda frame, out: in_place(_luma_16(frame), out), (1 << depth) - 1
    if depth > 8:
        return lambda frame, out: in_place(_luma_16(_scaled(frame, "gray16le")), out), 65535
    if depth == 8:
        return lambda frame, out: in_place(luma(_scaled(frame, "gray")), out), 255
    raise StrandcastError("SC-V010", f"unsupported pixel format {pixel_format!r}", file=file, fix=CONVERT)


def is_full_range(pixel_format: str, color_range: int) -> bool:
    """Return whether the first plane of a pixel format is 8-bit grey from 0 to 255."""
    return pixel_format in FULL_8BIT or (pixel_format in LUMA_8BIT and color_range == FULL_RANGE_TAG)


def luma(frame: av.VideoFrame, kind: str = "u1") -> Grey:
    """Return the first plane of a frame as a view of pixels of the given NumPy type."""
    import numpy as np

    plane = frame.planes[0]
    pixels = np.frombuffer(plane, kind)
    return pixels.reshape(-1, plane.line_size // pixels.itemsize)[: frame.height, : frame.width]


def plain_luma(frame: av.VideoFrame) -> memoryview | None:
    """Return the first plane of an 8-bit frame, or None if there are gaps between its rows."""
    plane = frame.planes[0]
    whole = plane.line_size == frame.width
    return memoryview(plane)[: frame.width * frame.height] if whole else None


def _luma_16(frame: av.VideoFrame) -> Grey:
    return luma(frame, ">u2" if frame.format.name.endswith("be") else "<u2").astype("u2", copy=False)


def expand(limited: Grey, out: Grey | None) -> Grey:
    """Return the full range of limited levels: (level - 16) 255 / 219, rounded, within 0 and 255.

    No level comes near a half, so single precision rounds as exact arithmetic does.
    """
    import cv2  # here: most videos do without
    import numpy as np

    gain = 255.0 / (WHITE - BLACK)
    return np.asarray(cv2.addWeighted(limited, gain, limited, 0.0, -BLACK * gain, out))


def _scaled(frame: av.VideoFrame, pixel_format: str) -> av.VideoFrame:
    """Return a frame in another pixel format.

    With more threads, FFmpeg's scaler writes past the ends of rows into those of other threads: in widths
    that are not multiples of 16, some pixels then change from run to run.
    """
    return frame.reformat(format=pixel_format, threads=1)


def upright(frame: av.VideoFrame, file: Path) -> av.VideoFrame:
    """Return a frame with its rows from top to bottom in memory: those of a cine file are upside down.

    FFmpeg then points to the last row, and PyAV's view does not reach before it; FFmpeg's scaler copies.
    """
    name = frame.format.name
    if frame.planes[0].line_size >= 0:
        return frame
    if name in LUMA_8BIT or (name.startswith("gray") and name not in UPRIGHT):
        what = f"unsupported pixel format {name!r} with the bottom row first"
        raise StrandcastError("SC-V010", what, file=file, fix=CONVERT)
    return _scaled(frame, UPRIGHT[name]) if name in UPRIGHT else frame
