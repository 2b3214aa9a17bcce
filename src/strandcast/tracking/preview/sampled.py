"""A few whole frames spread over a video, for a preview."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.progress import Progress
from strandcast.records.manifest import VideoFacts
from strandcast.video.ingest import camera_times
from strandcast.video.reader import open_video

SAMPLES = 36
MOST_DECODED = 2500  # later frames are ignored


@dataclass(frozen=True)
class SampledFrames:
    """Grey frames in full range, spread over a video."""

    indices: np.ndarray
    time_s: np.ndarray
    pictures: list[np.ndarray]
    decoded: int  # number of decoded frames
    max_level: int  # the whitest possible grey
    warnings: list[str]  # of the decoder


def sample_video(path: str | Path, facts: VideoFacts, count: int = SAMPLES) -> SampledFrames:
    """Decode a video up to the last of `count` frames spread over its first 2500, and keep these."""
    last = min(facts.packets, MOST_DECODED) - 1
    wanted = np.unique(np.linspace(0, last, count).astype(int))
    keep = set(wanted.tolist())
    progress = Progress("preview: frames", total=last + 1)
    pictures: dict[int, np.ndarray] = {}
    decoded = 0
    with open_video(path, frames=last + 1) as video:
        for index, _, image in video:
            decoded = index + 1
            if index in keep:
                pictures[index] = image.copy()
            progress(decoded)
    indices = np.array(sorted(pictures))
    time_s, max_level = camera_times(facts)[indices], video.info.max_level
    return SampledFrames(indices, time_s, list(pictures.values()), decoded, max_level, video.warnings())
