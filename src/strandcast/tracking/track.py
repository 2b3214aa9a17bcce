"""One trial's video to its track: the decoding pass, the hand, the string, and an honest account of both."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.progress import Progress
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.tracking.background import Samples, learn_background
from strandcast.tracking.counts import check_count, check_size
from strandcast.tracking.crops import Crops
from strandcast.tracking.follow import Fit
from strandcast.tracking.follower import Follower, Sight
from strandcast.tracking.hand import HandFinder, HandMarker, HandSighting, box_around
from strandcast.tracking.hand_path import HandPath, bridge_hand
from strandcast.tracking.judge import FrameResult, judge
from strandcast.tracking.jumps import doubt_jumps
from strandcast.tracking.looks import learn_looks
from strandcast.tracking.passes import Look, chain_of, follow, survey
from strandcast.tracking.picture import Picture
from strandcast.tracking.pixelmap import tabulate
from strandcast.tracking.result import StringHint, Tracked, as_columns
from strandcast.tracking.strobe import choose_instants, strobe_picture
from strandcast.video.ingest import camera_times
from strandcast.video.reader import open_video

CROP_LENGTHS = 1.25  # around the hand, in lengths of the string
POLARITIES = {"bright": 1.0, "dark": -1.0, "auto": None}
EXPOSURE_SHARE = 0.2  # of the frame interval, where the exposure is not given


def track_video(
    path: str | Path,
    facts: VideoFacts,
    camera: Camera,
    string: StringHint,
    markers: list[HandMarker],
    dictionary: str = "DICT_4X4_50",
    background_frames: int = 40,
    exposure_s: float | None = None,
    polarity: str = "auto",
) -> Tracked:
    """Track the hand and the string through a video.

    Parameters
    ----------
    path
        The video.
    facts
        Its manifest entry: time stamps, and the count that the decoded frames are held against.
    camera
        Lens, pose and the string's plane.
    string
        What is known of the string.
    markers, dictionary
        The markers on the hand.
    background_frames
        Frames of which the background is the median.
    exposure_s
        The camera's exposure; by default a fifth of the frame interval.
    polarity
        Whether the string is "bright" or "dark" before the background, or "auto".

    Raises
    ------
    StrandcastError
        SC-T001 the decoded count differs from the manifest's; SC-T002 the picture's size is not the
        calibration's; SC-T003 the hand's markers are never seen; SC-T004 no string leaves the hand.
    """
    check_size(facts, camera, path)
    exposure_s = exposure_s or EXPOSURE_SHARE / facts.frame_rate_hz
    pixels = tabulate(camera, camera.string_offset_m)
    finder = HandFinder(camera, markers, dictionary, camera.string_offset_m)
    time_s = camera_times(facts)
    with Crops(pixels, CROP_LENGTHS * string.length_m) as crops:
        scene = decode(path, facts, finder, crops, background_frames)
        check_hand(scene.hands, finder, path)
        hand = bridge_hand(time_s, scene.hands)
        look = looker(crops, scene.background, hand, time_s, box_around(markers))
        sightings = survey(look, np.flatnonzero(hand.flags == 0), string, POLARITIES[polarity])
        if not sightings:
            raise StrandcastError(
                "SC-T004", "no string is seen to leave the hand in any frame", file=path,
                fix="check the clamp's place and angle in the arm's file, and the string")  # fmt: skip
        lesson = learn_looks(sightings, string.length_m, pixels.metre_per_pixel)
        links, every = chain_of(string)
        follower = Follower(links, lesson.length_m / links, lesson.looks, exposure_s)
        fits = follow(look, len(scene.hands), sightings, follower)
        results = [judge_frame(look(index), fit, every) for index, fit in enumerate(fits)]
    tracked = collect(time_s, hand, results, string.points)
    tracked.markers = marker_columns(finder, scene.hands, time_s)
    instants = choose_instants(np.asarray(scene.samples.indices), tracked.points_m)
    pictures = [scene.samples.pictures[k] for k in np.searchsorted(scene.samples.indices, instants)]
    tracked.strobe = strobe_picture(scene.background, pictures, tracked.points_m[instants], camera)
    tracked.choices |= {
        "background_frames": len(scene.chosen),
        "exposure_s": exposure_s,
        "links": links,
        "thickness_m": 2 * lesson.looks.half_m,
        "polarity": lesson.looks.polarity,
        "contrast_grey": lesson.looks.contrast,
        "tip_excess_m": lesson.looks.tip_excess_m,
        "ball_at_tip": lesson.looks.has_ball,
        "length_m": lesson.length_m,
        "length_frames": lesson.teachers,
        "found_anew": follower.found_anew,
        "strobe_frames": " ".join(map(str, instants)),
    }
    tracked.warnings += lesson.warnings + [f"decoder: {text}" for text in sorted(set(scene.messages))[:5]]
    return tracked


def looker(crops: Crops, background: np.ndarray, hand: HandPath, time_s: np.ndarray, box: np.ndarray) -> Look:
    """Return the function that gives each frame as the string is looked for, None where there is no hand."""

    def look(index: int) -> Sight | None:
        view = crops.view(index, background)
        if view is None or not np.isfinite(hand.pose[index]).all():
            return None
        picture = Picture(view.image, view.background, view.pixels, box)
        return Sight(picture, time_s[index], hand.pose[index])

    return look


def judge_frame(sight: Sight | None, fit: Fit | None, every: int) -> FrameResult | None:
    """Return the mass points of a frame, None where the string was not found."""
    return None if sight is None or fit is None else judge(fit, sight.hand, every, sight.picture)


@dataclass(frozen=True)
class Scene:
    """What the decoding pass found.

    Attributes
    ----------
    hands
        The hand per frame.
    messages
        The decoder's complaints.
    background, chosen
        The scene without arm and string, and the frames that it was learned from.
    samples
        Whole frames that were kept.
    """

    hands: list[HandSighting | None]
    messages: list[str]
    background: np.ndarray
    chosen: np.ndarray
    samples: Samples


def decode(
    path: str | Path, facts: VideoFacts, finder: HandFinder, crops: Crops, background_frames: int
) -> Scene:
    """Make the one decoding pass: find the hand, keep a crop around it, learn the background."""
    hands: list[HandSighting | None] = []
    tell = Progress("track: frames", total=facts.packets)
    with open_video(path) as video:
        depth = 1 if video.info.max_level < 256 else 2
        samples = Samples(facts.packets, background_frames, depth * video.info.width * video.info.height)
        for index, _, image in video:
            samples.offer(index, image)
            hands.append(finder.find(image))
            crops.keep(image, None if hands[-1] is None else hands[-1].pose)
            tell(index + 1)
    check_count(len(hands), facts, path)
    background, chosen = learn_background(samples.pictures, background_frames)
    return Scene(hands, video.messages, background, np.asarray(samples.indices)[chosen], samples)


def check_hand(hands: list[HandSighting | None], finder: HandFinder, path: str | Path) -> None:
    """Refuse a video in which the hand is never seen."""
    if not any(hands):
        raise StrandcastError(
            "SC-T003", f"none of the hand's markers {sorted(finder.markers)} is seen in any frame", file=path,
            field="markers", fix="check ids, dictionary and that the picture is not mirrored")  # fmt: skip


def collect(time_s: np.ndarray, hand: HandPath, results: list[FrameResult | None], points: int) -> Tracked:
    """Put the frames' results into arrays."""
    count = len(results)
    places = np.full((count, points + 1, 2), np.nan)
    sigma = np.full((count, points + 1), np.nan)
    flags = np.zeros((count, points + 1), dtype=np.int32)
    places[:, 0], sigma[:, 0], flags[:, 0] = hand.pose[:, :2], hand.sigma_m, hand.flags
    for index, result in enumerate(results):
        if result is not None:
            places[index, 1:], sigma[index, 1:], flags[index, 1:] = (
                result.points_m,
                result.sigma_m,
                result.flags,
            )
    doubt_jumps(places, sigma, flags)
    return Tracked(time_s, places, sigma, flags, {}, np.zeros((1, 1, 3), np.uint8), count, {})


def marker_columns(
    finder: HandFinder, hands: list[HandSighting | None], time_s: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the columns of markers.parquet: each marker seen on the hand, by frame."""
    parts = []
    for marker in finder.markers:
        frames = [index for index, hand in enumerate(hands) if hand is not None and marker in hand.corners_px]
        if frames:
            seen = [
                hand.corners_px[marker] for hand in hands if hand is not None and marker in hand.corners_px
            ]
            pose, sigma_m = finder.marker_poses(marker, np.stack(seen))
            pose[:, 2] = np.unwrap(pose[:, 2])
            parts.append(
                np.column_stack([frames, time_s[frames], np.full(len(frames), marker), pose, sigma_m])
            )
    table = np.concatenate(parts) if parts else np.zeros((0, 7))
    table = table[np.lexsort((table[:, 2], table[:, 0]))]
    return as_columns(table)
