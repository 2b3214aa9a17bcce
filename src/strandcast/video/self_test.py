"""Whether this installation decodes videos: a clip is encoded in memory and read back."""

import io
from typing import NamedTuple

import av
import numpy as np

FRAMES, SIZE_PX = 5, 64
LARGEST_ERROR = 12.0  # grey levels, of a frame's mean; both codecs lose some


class CodecTest(NamedTuple):
    """How a codec is tried: its encoder, container and pixel format."""

    encoder: str
    container: str
    pixels: str


CLIPS = {"h264": CodecTest("libx264", "mp4", "yuv420p"), "mjpeg": CodecTest("mjpeg", "avi", "yuvj420p")}


def decode_problem(codec: str) -> str | None:
    """Return what keeps this installation from decoding a codec of `CLIPS`; None: it decodes it."""
    levels = np.linspace(40, 200, FRAMES)
    try:
        means = _decoded(_encoded(CLIPS[codec], levels), codec)
    except (av.error.FFmpegError, ValueError, LookupError) as problem:
        return f"{problem}"
    if len(means) != FRAMES:
        return f"{len(means)} of {FRAMES} frames were decoded"
    wrong = float(np.abs(np.array(means) - levels).max())
    return None if wrong < LARGEST_ERROR else f"decoded frames differ by {wrong:.0f} grey levels"


def _encoded(clip: CodecTest, levels: np.ndarray) -> bytes:
    out = io.BytesIO()
    with av.open(out, "w", format=clip.container) as container:
        stream = container.add_stream(clip.encoder, rate=100)
        stream.width = stream.height = SIZE_PX
        stream.pix_fmt = clip.pixels
        for level in levels:
            picture = np.full((SIZE_PX, SIZE_PX, 3), round(level), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        container.mux(stream.encode(None))
    return out.getvalue()


def _decoded(data: bytes, codec: str) -> list[float]:
    with av.open(io.BytesIO(data)) as container:
        stream = container.streams.video[0]
        if stream.codec_context.name != codec:
            raise ValueError(f"{stream.codec_context.name} was decoded instead")
        return [float(frame.to_ndarray(format="rgb24").mean()) for frame in container.decode(stream)]
