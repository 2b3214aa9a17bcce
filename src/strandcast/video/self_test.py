"""Whether this installation decodes videos: a clip is encoded in memory and read back."""

import io

import av
import numpy as np

FRAMES, SIZE_PX = 5, 64
LARGEST_ERROR = 12.0  # grey levels, of a frame's mean; both codecs lose some


# Encoder, container and pixel format, by codec.
CLIPS = {"h264": ("libx264", "mp4", "yuv420p"), "mjpeg": ("mjpeg", "avi", "yuvj420p")}


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


def _encoded(clip: tuple[str, str, str], levels: np.ndarray) -> bytes:
    encoder, kind, pixels = clip
    out = io.BytesIO()
    with av.open(out, "w", format=kind) as container:
        stream = container.add_stream(encoder, rate=100)
        stream.width = stream.height = SIZE_PX
        stream.pix_fmt = pixels
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
