"""A preview of the tracker's detections in a few frames of a video, without tracking it."""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from strandcast.camera.flat import flat_camera
from strandcast.camera.mapping import metre_to_pixel
from strandcast.camera.markers import (
    FAMILIES,
    detect_markers,
    eight_bit,
    marker_detector,
    marker_side_px,
    same_family,
)
from strandcast.core.hand_marker import HandMarker
from strandcast.progress import Progress
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.records.track import DetectedTarget
from strandcast.tracking.background import FRAMES, learn_background
from strandcast.tracking.chain.search_window import HandBox, SearchWindow
from strandcast.tracking.events.target import locate_target
from strandcast.tracking.hand.finder import HandDetection, HandFinder
from strandcast.tracking.hand.rigid import box_around
from strandcast.tracking.pixel_map import PixelMap, tabulate
from strandcast.tracking.preview.single_frame import StringInFrame, string_in_frame
from strandcast.tracking.tracker import StringHint
from strandcast.video.ingest import camera_times
from strandcast.video.reader import open_video

SAMPLES = 36
MOST_DECODED = 2500  # later frames are ignored
SHOWN = 6
LEAST_BACKGROUND = 7  # frames for the background's median, at least
SEARCHED_FOR_IDS = 8  # frames searched for other markers than the hand's
OFTEN = 2  # pictures that must show a marker: large dictionaries find markers in any texture


@dataclass(frozen=True)
class SampledFrames:
    """Grey frames in full range, spread over a video."""

    indices: np.ndarray
    time_s: np.ndarray
    pictures: list[np.ndarray]
    decoded: int  # number of decoded frames
    max_level: int  # the whitest possible grey
    warnings: list[str]  # of the decoder


@dataclass(frozen=True)
class Expected:
    """The declared contents of the video."""

    string: StringHint
    markers: tuple[HandMarker, ...]  # on the hand
    dictionary: str  # of these markers
    target_m: np.ndarray | None  # (2,); None: the experiment has none
    weights_m: tuple[float, ...] = ()  # places of declared weights along the string
    polarity: float | None = None  # 1, -1, or None to measure it
    plane_ids: tuple[int, ...] = ()  # markers of the plane of motion from the hand's dictionary


@dataclass(frozen=True)
class PreviewFrame:
    """One frame: its index, time and picture, the hand and the string if they are found."""

    index: int
    time_s: float
    image: np.ndarray
    hand: HandDetection | None
    string: StringInFrame | None = None


@dataclass(frozen=True)
class Preview:
    """The tracker's detections in a few frames."""

    frames: list[PreviewFrame]  # those shown
    hands_found: int  # number of sampled frames with the hand
    sampled: int  # number of sampled frames
    background: np.ndarray  # the scene without arm and string
    noise: float  # standard deviation of unchanged pixels [grey levels]
    max_level: int  # the whitest grey
    camera: Camera | None  # the calibration, or an estimate from the hand's markers
    calibrated: bool
    target: DetectedTarget | None
    others: dict[str, tuple[int, ...]]  # see `other_markers`; empty if a marker of the hand is found
    expected: Expected

    @property
    def strings(self) -> list[StringInFrame]:
        """Return the strings that were found."""
        return [frame.string for frame in self.frames if frame.string is not None]


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


def preview(
    sampled: SampledFrames,
    camera: Camera | None,
    expected: Expected,
    background: np.ndarray | None = None,
) -> Preview:
    """Detect hand, string and target in sampled frames.

    Without a calibrated camera, metres come from the size of the hand's markers. Without a given background
    (H, W), it is a median of frames.
    """
    if background is None:
        # Few frames, which differ most: an arm that rests for long would otherwise stay in the background.
        few = max(LEAST_BACKGROUND, len(sampled.pictures) // 3)
        background, _ = learn_background(sampled.pictures, min(few, FRAMES))
    noise = unchanged_noise(sampled.pictures)
    used = camera or rough_camera(sampled.pictures, expected)
    finder = None
    if used is not None:
        finder = HandFinder(used, expected.markers, expected.dictionary, used.string_offset_m)
    hands = [None if finder is None else finder.find(picture) for picture in sampled.pictures]
    frames = [
        PreviewFrame(int(sampled.indices[k]), float(sampled.time_s[k]), sampled.pictures[k], hands[k])
        for k in choose_shown(sampled.pictures, hands)
    ]
    if used is not None:
        pixels = tabulate(used, used.string_offset_m)
        frames = [with_string(frame, background, pixels, expected) for frame in frames]
    return Preview(
        frames=frames,
        hands_found=sum(hand is not None for hand in hands),
        sampled=len(hands),
        background=background,
        noise=noise,
        max_level=sampled.max_level,
        camera=used,
        calibrated=camera is not None,
        target=None
        if camera is None or expected.target_m is None
        else locate_target(background, camera, expected.target_m),
        others={} if any(hand is not None for hand in hands) else other_markers(sampled.pictures, expected),
        expected=expected,
    )


def unchanged_noise(pictures: list[np.ndarray]) -> float:
    """Return the standard deviation [grey levels] of unchanged pixels, from pairs of pictures."""
    found = []
    for k in range(0, len(pictures) - 1, max(1, len(pictures) // 8)):
        change = (pictures[k][::4, ::4].astype(np.float32) - pictures[k + 1][::4, ::4]) / np.sqrt(2.0)
        change -= np.median(change)
        usual = np.abs(change) < 5.0 * max(1.48 * float(np.median(np.abs(change))), 0.7)
        found.append(float(change[usual].std()))
    return float(np.median(found))


def rough_camera(pictures: list[np.ndarray], expected: Expected) -> Camera | None:
    """Return a flat camera whose scale is that of the hand's markers; None if none is found."""
    few = pictures[:: max(1, len(pictures) // SEARCHED_FOR_IDS)]
    sides_px = [marker_side_px(few, expected.dictionary, [marker.id]) for marker in expected.markers]
    scales = [m.size_m / side for m, side in zip(expected.markers, sides_px, strict=True) if side is not None]
    if not scales:
        return None
    height, width = pictures[0].shape
    return flat_camera(width, height, float(np.median(scales)), (0.5 * width, 0.5 * height), source="hand")


def choose_shown(pictures: list[np.ndarray], hands: list[HandDetection | None]) -> list[int]:
    """Return the pictures to show, spread evenly along the hand's path, or in time if it is not found."""
    found = [k for k, hand in enumerate(hands) if hand is not None]
    if len(found) < SHOWN:
        return [int(k) for k in np.unique(np.linspace(0, len(pictures) - 1, SHOWN).astype(int))]
    poses = np.array([hand.pose.array() for hand in hands if hand is not None])
    turn = np.unwrap(poses[:, 2])
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T) + 0.1 * np.abs(np.diff(turn)) + 1e-4
    path = np.concatenate([[0.0], np.cumsum(steps)])
    spread = np.linspace(0.0, path[-1], SHOWN)
    return [found[k] for k in np.unique(np.abs(path[:, None] - spread).argmin(axis=0))]


def with_string(
    frame: PreviewFrame, background: np.ndarray, pixels: PixelMap, expected: Expected
) -> PreviewFrame:
    """Return the frame with the string that leaves its hand, if it is found."""
    if frame.hand is None:
        return frame
    box = HandBox(*frame.hand.pose.array().tolist(), *box_around(expected.markers).tolist())
    picture = SearchWindow(
        np.ascontiguousarray(frame.image), 0, 0, np.ascontiguousarray(background), pixels, box
    )
    return replace(
        frame, string=string_in_frame(picture, frame.hand.pose, expected.string, expected.polarity)
    )


def other_markers(pictures: list[np.ndarray], expected: Expected) -> dict[str, tuple[int, ...]]:
    """Return the ids of other markers than the hand's: of its dictionary, mirrored, or of other ones."""
    few = [eight_bit(picture) for picture in pictures[:: max(1, len(pictures) // SEARCHED_FOR_IDS)]]
    others = tuple(sorted(set(_ids(few, expected.dictionary)) - set(expected.plane_ids)))
    if others:
        return {f"of {expected.dictionary}": others}
    mirrored = _ids([cv2.flip(picture, 1) for picture in few], expected.dictionary)
    if set(mirrored) & {marker.id for marker in expected.markers}:
        return {"mirrored": mirrored}
    families = [family for family in FAMILIES if not same_family(family, expected.dictionary)]
    return {f"of {family}": ids for family in families if (ids := _ids(few[:4], family))}


def _ids(pictures: list[np.ndarray], dictionary: str) -> tuple[int, ...]:
    detector = marker_detector(dictionary)
    counts = Counter(
        int(i) for picture in pictures for i in set(detect_markers(picture, detector)[0].tolist())
    )
    return tuple(sorted(marker for marker, count in counts.items() if count >= min(OFTEN, len(pictures))))


def to_pixels(preview: Preview, points_m: np.ndarray) -> np.ndarray:
    """Return the pixels (K, 2) of points (K, 2) in the string's plane."""
    assert preview.camera is not None
    return metre_to_pixel(preview.camera, np.asarray(points_m, float), preview.camera.string_offset_m)
