"""A few whole frames spread over a video, for a quick look: decoded in order, none of them measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.progress import Progress
from strandcast.records.manifest import VideoFacts
from strandcast.video.ingest import camera_times
from strandcast.video.reader import open_video

SAMPLES = 36
MOST_DECODED = 2500  # frames of a longer video are not looked at


@dataclass(frozen=True)
class Sampled:
    """Frames (grey, full range) with their indices and times, and what the decoder said.

    `decoded` counts the frames that were decoded, `max_level` is the whitest grey that there can be,
    `warnings` are what the frames leave to be told.
    """

    indices: np.ndarray
    time_s: np.ndarray
    pictures: list[np.ndarray]
    decoded: int
    max_level: int
    warnings: list[str]


def sample_video(path: str | Path, facts: VideoFacts, count: int = SAMPLES) -> Sampled:
    """Decode a video up to the last of `count` frames spread over its first 2500.

    Parameters
    ----------
    path, facts
        The video and its manifest entry.
    count
        Pictures that are kept.
    """
    last = min(facts.packets, MOST_DECODED) - 1
    wanted = np.unique(np.linspace(0, last, count).astype(int))
    keep = set(wanted.tolist())
    tell = Progress("preview: frames", total=last + 1)
    pictures: dict[int, np.ndarray] = {}
    decoded = 0
    with open_video(path, frames=last + 1) as video:
        for index, _, image in video:
            decoded = index + 1
            if index in keep:
                pictures[index] = image.copy()
            tell(decoded)
    indices = np.array(sorted(pictures))
    return Sampled(
        indices, camera_times(facts)[indices], list(pictures.values()), decoded, video.info.max_level,
        video.warnings(),
    )  # fmt: skip
