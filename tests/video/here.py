"""Frames decoded in this process, as its own process decodes them."""

from pathlib import Path

import numpy as np

from strandcast.video.registry import reader_of


def frames_here(path: Path) -> list[tuple[float, np.ndarray]]:
    """Return time [s] and grey image of each frame."""
    with reader_of(path).open_source(path, 1, None) as source:
        return [(time_s, np.array(source.to_grey(raw, None))) for time_s, raw in source.raws]
