"""Write grey frames as an H.264 file; the same frames give the same bytes."""

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from strandcast.records.files import atomic_write
from strandcast.video.small import FULL_RANGE, full_range_frame

# A constant quantiser: rate control at 500 frames/s would remove the sensor's noise.
ENCODER = {"preset": "ultrafast", "qp": "20", "threads": "1"}


def write_video(
    path: Path,
    frames: Iterable[np.ndarray],
    width_px: int,
    height_px: int,
    rate_hz: float,
    encoder: Mapping[str, str] = ENCODER,
) -> int:
    """Write frames (H, W) uint8 and return how many; time stamps count 1/rate from zero."""
    rate = Fraction(rate_hz).limit_denominator(100_000)
    count = 0
    with atomic_write(path) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height, stream.pix_fmt = width_px, height_px, "yuv420p"
        stream.codec_context.time_base = 1 / rate
        stream.codec_context.color_range = FULL_RANGE
        stream.codec_context.thread_count = 1
        stream.codec_context.options = dict(encoder)
        upcoming = iter(frames)
        with ThreadPoolExecutor(1) as painter:
            # The next frame is painted while this one is encoded from its copy.
            pending = painter.submit(next, upcoming, None)
            while (grey := pending.result()) is not None:
                frame = full_range_frame(grey, count)
                pending = painter.submit(next, upcoming, None)
                container.mux(stream.encode(frame))
                count += 1
        container.mux(stream.encode(None))
    return count
