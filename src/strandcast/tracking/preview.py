"""A quick look at what the tracker sees in a few frames of a video, before and without tracking it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import cv2
import numpy as np

from strandcast.camera.flat import flat_camera
from strandcast.camera.mapping import metre_to_pixel
from strandcast.camera.markers import FAMILIES, detect_markers, eight_bit, marker_detector, same_family
from strandcast.records.camera import Camera
from strandcast.records.track import SeenTarget
from strandcast.tracking.background import learn_background
from strandcast.tracking.hand import HandFinder, HandMarker, HandSighting, box_around
from strandcast.tracking.picture import Picture
from strandcast.tracking.pixelmap import PixelMap, tabulate
from strandcast.tracking.result import StringHint
from strandcast.tracking.sampled import Sampled
from strandcast.tracking.single_frame import SingleSighting, find_alone
from strandcast.tracking.target import locate_target

SHOWN = 6
LEAST_BACKGROUND = 7  # frames of which the background is the median, at least
SEARCHED_FOR_IDS = 8  # frames that are read for markers that should not be there
OFTEN = (
    2  # pictures in which a marker must be read, to be told: large dictionaries read markers into anything
)


@dataclass(frozen=True)
class Wanted:
    """What should be in the picture.

    Attributes
    ----------
    string
        What is known of the string.
    markers, dictionary
        On the hand.
    target_m
        In the world frame (2,).
    weights_m
        Places of typed weights along the string.
    plane_ids
        Markers of the plane of motion, which are of the same dictionary as the hand's.
    polarity
        1, -1, or None to find out.
    """

    string: StringHint
    markers: list[HandMarker]
    dictionary: str
    target_m: np.ndarray
    weights_m: tuple[float, ...] = ()
    polarity: float | None = None
    plane_ids: tuple[int, ...] = ()


@dataclass(frozen=True)
class Look:
    """One frame: its index, time and picture, the hand and the string if they are seen."""

    index: int
    time_s: float
    image: np.ndarray
    hand: HandSighting | None
    string: SingleSighting | None = None


@dataclass(frozen=True)
class OtherMarkers:
    """Markers that were seen where the hand's were not: how they were read, and which ids."""

    how: str
    ids: tuple[int, ...]


@dataclass(frozen=True)
class Preview:
    """What the tracker sees.

    Attributes
    ----------
    looks
        The frames that are shown.
    hands_seen, sampled
        In how many of the sampled frames the hand was found, and how many there are.
    background
        The scene without arm and string.
    noise, max_level
        Standard deviation of what does not change [grey levels]; the whitest grey.
    camera, calibrated
        The calibration, or a guess from the hand's markers; None where not even that can be had.
    target
        What is seen where the target should be.
    others
        Markers that are no part of the hand, where no marker of the hand is seen.
    """

    looks: list[Look]
    hands_seen: int
    sampled: int
    background: np.ndarray
    noise: float
    max_level: int
    camera: Camera | None
    calibrated: bool
    target: SeenTarget | None
    others: list[OtherMarkers]
    wanted: Wanted

    @property
    def strings(self) -> list[SingleSighting]:
        """Return the strings that were found."""
        return [look.string for look in self.looks if look.string is not None]


def preview(
    sampled: Sampled,
    camera: Camera | None,
    wanted: Wanted,
    background_frames: int = 40,
    background: np.ndarray | None = None,
) -> Preview:
    """Look at sampled frames.

    Parameters
    ----------
    sampled
        Frames spread over the video.
    camera
        The calibration; None before there is one: then metres come from the size of the hand's markers.
    wanted
        What should be seen.
    background_frames
        Frames that the background is the median of, at most.
    background
        The empty scene, where that is given.
    """
    if background is None:
        # Of all frames, those that are unlike: where the arm rests for long, it would stay in the background.
        few = max(LEAST_BACKGROUND, len(sampled.pictures) // 3)
        background, _ = learn_background(sampled.pictures, min(few, background_frames))
    noise = unchanged_noise(sampled.pictures)
    eye = camera or rough_camera(sampled.pictures, wanted)
    hands = find_hands(sampled.pictures, eye, wanted)
    looks = [
        Look(int(sampled.indices[k]), float(sampled.time_s[k]), sampled.pictures[k], hands[k])
        for k in choose_shown(sampled.pictures, hands)
    ]
    if eye is not None:
        pixels = tabulate(eye, eye.string_offset_m)
        looks = [with_string(look, background, pixels, wanted) for look in looks]
    return Preview(
        looks=looks,
        hands_seen=sum(hand is not None for hand in hands),
        sampled=len(hands),
        background=background,
        noise=noise,
        max_level=sampled.max_level,
        camera=eye,
        calibrated=camera is not None,
        target=None if camera is None else locate_target(background, camera, wanted.target_m),
        others=[] if any(hand is not None for hand in hands) else other_markers(sampled.pictures, wanted),
        wanted=wanted,
    )


def unchanged_noise(pictures: list[np.ndarray]) -> float:
    """Return the standard deviation [grey levels] of what does not change, from pairs of pictures."""
    found = []
    for k in range(0, len(pictures) - 1, max(1, len(pictures) // 8)):
        change = (pictures[k][::4, ::4].astype(np.float32) - pictures[k + 1][::4, ::4]) / np.sqrt(2.0)
        change -= np.median(change)
        usual = np.abs(change) < 5.0 * max(1.48 * float(np.median(np.abs(change))), 0.7)
        found.append(float(change[usual].std()))
    return float(np.median(found))


def rough_camera(pictures: list[np.ndarray], wanted: Wanted) -> Camera | None:
    """Return a flat camera whose scale is that of the hand's markers; None where none of them is seen."""
    detector = marker_detector(wanted.dictionary)
    sizes = {marker.marker: marker.size_m for marker in wanted.markers}
    scales = []
    for picture in pictures[:: max(1, len(pictures) // SEARCHED_FOR_IDS)]:
        ids, corners = detect_markers(picture, detector)
        for marker, four in zip(ids.tolist(), corners, strict=True):
            if marker in sizes:
                side_px = np.linalg.norm(four - np.roll(four, 1, axis=0), axis=1).mean()
                scales.append(sizes[marker] / side_px)
    if not scales:
        return None
    height, width = pictures[0].shape
    return flat_camera(width, height, float(np.median(scales)), (0.5 * width, 0.5 * height), source="hand")


def find_hands(
    pictures: list[np.ndarray], camera: Camera | None, wanted: Wanted
) -> list[HandSighting | None]:
    """Return the hand in each picture; the pictures are too far apart to follow it from one to the next."""
    if camera is None:
        return [None] * len(pictures)
    finder = HandFinder(camera, wanted.markers, wanted.dictionary, camera.string_offset_m)
    return [finder.find(picture) for picture in pictures]


def choose_shown(pictures: list[np.ndarray], hands: list[HandSighting | None]) -> list[int]:
    """Return which pictures to show: spread evenly along the hand's way, or in time if it is not seen."""
    seen = [k for k, hand in enumerate(hands) if hand is not None]
    if len(seen) < SHOWN:
        return np.unique(np.linspace(0, len(pictures) - 1, SHOWN).astype(int)).tolist()
    poses = np.array([hand.pose for hand in hands if hand is not None])
    turn = np.unwrap(poses[:, 2])
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T) + 0.1 * np.abs(np.diff(turn)) + 1e-4
    way = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, way[-1], SHOWN)
    return [seen[k] for k in np.unique(np.abs(way[:, None] - wanted).argmin(axis=0))]


def with_string(look: Look, background: np.ndarray, pixels: PixelMap, wanted: Wanted) -> Look:
    """Return the look with the string that starts at its hand, if it is found."""
    if look.hand is None:
        return look
    box = np.concatenate([look.hand.pose, box_around(wanted.markers)])
    picture = Picture(np.ascontiguousarray(look.image), 0, 0, np.ascontiguousarray(background), pixels, box)
    return replace(look, string=find_alone(picture, look.hand.pose, wanted.string, wanted.polarity))


def other_markers(pictures: list[np.ndarray], wanted: Wanted) -> list[OtherMarkers]:
    """Return which markers are seen instead of the hand's: of its dictionary, in a mirror, of others."""
    few = [eight_bit(picture) for picture in pictures[:: max(1, len(pictures) // SEARCHED_FOR_IDS)]]
    others = tuple(sorted(set(_ids(few, wanted.dictionary)) - set(wanted.plane_ids)))
    if others:
        return [OtherMarkers(f"of {wanted.dictionary}", others)]
    mirrored = _ids([cv2.flip(picture, 1) for picture in few], wanted.dictionary)
    if set(mirrored) & {marker.marker for marker in wanted.markers}:
        return [OtherMarkers("mirrored", mirrored)]
    found = [
        OtherMarkers(f"of {family}", _ids(few[:4], family))
        for family in FAMILIES
        if not same_family(family, wanted.dictionary)
    ]
    return [other for other in found if other.ids]


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
