"""The decoding pass: find the hand in every frame, keep a crop around it and some whole frames."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from strandcast.camera.markers import eight_bit
from strandcast.errors import StrandcastError
from strandcast.progress import Progress
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.tracking.background import Samples, learn_background
from strandcast.tracking.crops import Crops
from strandcast.tracking.hand.finder import HandDetection
from strandcast.tracking.preconditions import check_count, check_pixel_aspect, open_ingested

DECODER_THREADS = 2  # chosen: beside this process, which finds the hand meanwhile
BRIGHTNESS_TOLERANCE = 0.15  # chosen: relative difference in median grey between a given background and video


class HeldEndFinder(Protocol):
    """What finds the held end of the string in one frame after another."""

    camera: Camera

    def find(self, image: np.ndarray) -> HandDetection | None:
        """Return the held end in the next frame, or None."""


@dataclass(frozen=True, eq=False)
class Decoded:
    """Result of the decoding pass."""

    hands: list[HandDetection | None]  # per frame; None where it was not found
    samples: Samples  # whole frames, spread over the video
    warnings: list[str]  # of the decoder


def decode(
    video: str | Path,
    facts: VideoFacts,
    finder: HeldEndFinder,
    crops: Crops,
    also: Sequence[Callable[[np.ndarray], None]] = (),
) -> Decoded:
    """Decode a video once, and keep the parts that later steps need; `also` are called with every frame.

    Raises
    ------
    StrandcastError
        SC-V005 the decoded count differs from the manifest's, or the file changed since ingestion; SC-C012
        its pixels are not the calibration's.
    """
    hands: list[HandDetection | None] = []
    progress = Progress("track: frames", total=facts.packets)
    with open_ingested(video, facts, threads=DECODER_THREADS) as opened:
        check_pixel_aspect(opened.info, finder.camera, video)
        samples = Samples(facts.packets, opened.info.frame_bytes)
        for index, _, image in opened:
            samples.offer(index, image)
            hands.append(finder.find(image))
            crops.keep(image, None if hands[-1] is None else hands[-1].pose)
            for look in also:
                look(image)
            progress(index + 1)
    check_count(len(hands), facts, video)
    return Decoded(hands, samples, opened.warnings())


def scene_background(samples: Samples, given: np.ndarray | None) -> tuple[np.ndarray, str]:
    """Return the empty scene (height, width) in the video's depth, and its source in words.

    It is the given picture, or a median over the sampled frames.

    Raises
    ------
    StrandcastError
        SC-T030 the given picture is much brighter or darker than the video.
    """
    learned, chosen = learn_background(samples.pictures)
    if given is None:
        return learned, f"median of {len(chosen)} frames"
    return _matched(given, learned), "given"


def _matched(given: np.ndarray, learned: np.ndarray) -> np.ndarray:
    """Return the given background in the video's depth; refuse one taken under different light."""
    if given.dtype != learned.dtype:
        given = eight_bit(given) if learned.dtype == np.uint8 else given.astype(learned.dtype)
    light, usual = float(np.median(given)), float(np.median(learned))
    if abs(light - usual) > BRIGHTNESS_TOLERANCE * max(usual, 1.0):
        raise StrandcastError(
            "SC-T030",
            f"the picture of the empty scene has a median grey level of {light:.0f}, the video of "
            f"{usual:.0f}",
            field="track.background_picture",
        )
    return given
