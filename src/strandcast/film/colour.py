"""A film in which the string is found by its colour: as grey levels, brighter the nearer a pixel is to it."""

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import av
import numpy as np

from strandcast.errors import StrandcastError
from strandcast.video.ffmpeg import open_container, reason
from strandcast.video.files import damaged
from strandcast.video.small import FULL_RANGE, full_range_frame


@contextmanager
def film_of_colour(video: Path, colour: str | None) -> Iterator[Path]:
    """Yield a film of how near each pixel's colour is to ``#rrggbb``; the film itself without a colour.

    A grey level is 255 less the distance in red, green and blue. Times are those of the film.

    Raises
    ------
    StrandcastError
        SC-W021 the colour has another form; SC-V… the film cannot be read.
    """
    if colour is None:
        yield video
        return
    if re.fullmatch("#[0-9a-fA-F]{6}", colour) is None:
        what, fix = f"{colour!r} is no colour", "give red, green and blue in hexadecimal: #c03020"
        raise StrandcastError("SC-W021", what, field="colour", fix=fix)
    wanted = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], dtype=np.float32)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{video.stem}.mp4"
        with open_container(video) as opened, av.open(path, "w") as made:
            grey = made.add_stream("libx264", options={"qp": "0", "preset": "ultrafast"})
            grey.width, grey.height = opened.stream.width, opened.stream.height
            grey.pix_fmt, grey.time_base = "gray", opened.stream.time_base
            grey.codec_context.time_base = opened.stream.time_base
            grey.codec_context.color_range = FULL_RANGE
            try:
                for frame in opened.container.decode(opened.stream):
                    off = np.linalg.norm(frame.to_ndarray(format="rgb24") - wanted, axis=2)
                    near = full_range_frame(np.maximum(255.0 - off, 0.0).astype(np.uint8), 0, "gray")
                    near.pts, near.time_base = frame.pts, frame.time_base
                    made.mux(grey.encode(near))
            except av.FFmpegError as error:
                raise damaged("SC-V005", f"the video breaks off ({reason(error)})", video) from None
            made.mux(grey.encode(None))
        yield path
