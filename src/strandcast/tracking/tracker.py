"""A tracker's input and protocol: the extension point for other ways to track a string."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.config.align import LedSettings
from strandcast.config.string import String
from strandcast.config.track import TrackSettings
from strandcast.core.hand_marker import HandMarker
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.tracking.result import Tracked


@dataclass(frozen=True)
class StringHint:
    """The string as known before tracking: free length, number of mass points n, thickness if measured.

    `beyond_m` is its length beyond the middle of the last declared weight.
    """

    length_m: float
    points: int
    thickness_m: float | None = None
    beyond_m: float = math.inf


@dataclass(frozen=True, eq=False)
class TrackerInput:
    """One video and what is known about it; None where something is unknown or absent."""

    video: Path
    facts: VideoFacts  # the manifest's entry: time stamps, frame count, size
    camera: Camera
    string: String  # as declared
    free_length_m: float  # of the string beyond the clamp
    markers: tuple[HandMarker, ...] = ()
    marker_dictionary: str = "DICT_4X4_50"  # of OpenCV's ArUco dictionaries
    target_m: np.ndarray | None = None  # (2,); None if it need not be located
    exposure_s: float | None = None
    led: LedSettings | None = None
    background: np.ndarray | None = None  # the empty scene, grey (H, W); None: learn it
    settings_file: Path | None = None  # for messages

    @property
    def hint(self) -> StringHint:
        """Return the string as the chain is fitted to it."""
        length_m, weights = self.free_length_m, self.string.weights
        last_m = max((weight.place_m for weight in weights), default=-math.inf)
        return StringHint(length_m, self.string.n, self.string.thickness_m, max(length_m - last_m, 0.0))


@dataclass(frozen=True)
class Tracker:
    """A way to track a string.

    An experiment that sets one of the `unused_settings`, e.g. "track.polarity", is refused. `calibrate`, if
    there is one, makes the camera of an experiment without markers from the first trial's film, its facts
    and the string's length [m]; it returns the camera and a picture, grey (H, W), on which it is shown.
    """

    track: Callable[[TrackerInput, TrackSettings], Tracked]
    unused_settings: tuple[str, ...] = ()
    calibrate: Callable[[Path, VideoFacts, float, TrackSettings], tuple[Camera, np.ndarray]] | None = None
