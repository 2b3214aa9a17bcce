"""A small video of grey pictures for a page, H.264 in MP4; the same pictures give the same bytes."""

import io
from collections.abc import Iterable

import av
import numpy as np

# Chosen. A lab throw of 625 frames at 512 x 444 px: 290 kB, 2.3 grey levels rms from the pictures;
# in groups of 12 frames 619 kB, as WebP pictures 3 MB. A group is decoded in some 20 ms, so any frame can be
# sought. One thread, and no choice by the processor: the same bytes everywhere.
ENCODER = {
    "preset": "superfast",
    "crf": "28",
    "g": "25",
    "bf": "0",
    "threads": "1",
    "x264-params": "cpu-independent=1:scenecut=0:aq-mode=0",
}
BUFFER_S = 2.0  # chosen: over which the rate is limited
FULL_RANGE = 2
NO_COLOUR = 128


def small_video(
    pictures: Iterable[np.ndarray],
    *,
    width_px: int,
    height_px: int,
    count: int,
    rate_hz: int,
    most_bytes: int,
) -> bytes:
    """Return grey pictures (H, W) uint8 as a video of about `most_bytes` at most; sides must be even."""
    out = io.BytesIO()
    bit_s = int(8 * most_bytes / (count / rate_hz + BUFFER_S))
    limit = {"maxrate": str(bit_s), "bufsize": str(int(BUFFER_S * bit_s))}
    with av.open(out, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=rate_hz)
        stream.width, stream.height, stream.pix_fmt = width_px, height_px, "yuv420p"
        stream.codec_context.color_range = FULL_RANGE
        stream.codec_context.thread_count = 1
        stream.codec_context.options = ENCODER | limit
        for number, grey in enumerate(pictures):
            container.mux(stream.encode(full_range_frame(grey, number)))
        container.mux(stream.encode(None))
    return out.getvalue()


def full_range_frame(grey: np.ndarray, number: int, pixels: str = "yuv420p") -> av.VideoFrame:
    """Return a colourless frame with the grey picture (H, W) uint8 as its luma, unchanged."""
    frame = av.VideoFrame(grey.shape[1], grey.shape[0], pixels)
    frame.color_range = FULL_RANGE
    frame.pts = number
    luma, *colours = frame.planes
    padded = np.zeros((luma.height, luma.line_size), np.uint8)
    padded[:, : grey.shape[1]] = grey
    luma.update(padded)
    for plane in colours:
        plane.update(bytes([NO_COLOUR]) * plane.buffer_size)
    return frame
