"""One trial's video to its track: the decoding pass, the hand, the string, and an honest account of both."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.progress import Progress, progress
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.records.track import PREDICTED
from strandcast.tracking.background import Samples, learn_background
from strandcast.tracking.counts import check_count, check_size
from strandcast.tracking.crops import Crops
from strandcast.tracking.follower import Follower
from strandcast.tracking.hand import HandFinder, HandMarker, HandSighting, box_around
from strandcast.tracking.judge import FrameResult
from strandcast.tracking.pixelmap import tabulate
from strandcast.tracking.result import StringHint, Tracked, as_columns
from strandcast.tracking.strobe import Strobe
from strandcast.video.ingest import camera_times
from strandcast.video.reader import open_video

CROP_LENGTHS = 1.25  # around the hand, in lengths of the string
POLARITIES = {"bright": 1.0, "dark": -1.0, "auto": None}
EXPOSURE_SHARE = 0.2  # of the frame interval, where the exposure is not given
LONGEST_BRIDGE = 10  # frames over which a hand that was not seen is bridged


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
        hands, messages, background, chosen = decode(path, facts, finder, crops, background_frames)
        check_hand(hands, finder, path)
        follower = Follower(string, exposure_s, box_around(markers), POLARITIES[polarity])
        strobe = Strobe(background)
        results = []
        for index, hand in enumerate(progress(hands, "track: string", total=len(hands))):
            result = None
            view = crops.view(index, background)
            if view is not None:
                result = follower.step(view, time_s[index], None if hand is None else hand.pose)
            results.append(result)
            strobe.offer(index, view, None if result is None else result.points_m)
    if follower.looks is None:
        raise StrandcastError(
            "SC-T004", "no string is seen to leave the hand in any frame", file=path,
            fix="check the clamp's place and angle in the arm's file, and that the string moves")  # fmt: skip
    tracked = collect(time_s, hands, results, string.points)
    tracked.markers = marker_columns(finder, hands, time_s)
    tracked.strobe = strobe.picture(tracked.points_m, camera)
    tracked.choices |= {
        "background_frames": len(chosen),
        "exposure_s": exposure_s,
        "links": follower.links,
        "thickness_m": 2 * follower.looks.half_m,
        "polarity": follower.looks.polarity,
        "contrast_grey": follower.looks.contrast,
        "tip_excess_m": follower.looks.tip_excess_m,
        "ball_at_tip": follower.looks.has_ball,
        "length_m": follower.link_m * follower.links,
        "first_found_frame": follower.first_frame,
        "found_anew": follower.found_anew,
    }
    tracked.warnings += follower.warnings + [f"decoder: {text}" for text in sorted(set(messages))[:5]]
    return tracked


def decode(
    path: str | Path, facts: VideoFacts, finder: HandFinder, crops: Crops, background_frames: int
) -> tuple[list[HandSighting | None], list[str], np.ndarray, np.ndarray]:
    """Make the one decoding pass: find the hand, keep a crop around it of each frame, learn the background.

    Returns
    -------
    hands, messages, background, chosen
        The hand per frame, the decoder's complaints, the background, and the frames that it was learned from.
    """
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
    return hands, video.messages, background, np.asarray(samples.indices)[chosen]


def check_hand(hands: list[HandSighting | None], finder: HandFinder, path: str | Path) -> None:
    """Refuse a video in which the hand is never seen."""
    if not any(hands):
        raise StrandcastError(
            "SC-T003", f"none of the hand's markers {sorted(finder.markers)} is seen in any frame", file=path,
            field="markers", fix="check ids, dictionary and that the picture is not mirrored")  # fmt: skip


def collect(
    time_s: np.ndarray, hands: list[HandSighting | None], results: list[FrameResult | None], points: int
) -> Tracked:
    """Put the frames' results into arrays; a hand that was not seen for a few frames is bridged."""
    count = len(hands)
    places = np.full((count, points + 1, 2), np.nan)
    sigma = np.full((count, points + 1), np.nan)
    flags = np.zeros((count, points + 1), dtype=np.int32)
    for index, (hand, result) in enumerate(zip(hands, results, strict=True)):
        if hand is not None:
            places[index, 0], sigma[index, 0] = hand.pose[:2], hand.sigma_m
        if result is not None:
            places[index, 1:], sigma[index, 1:], flags[index, 1:] = (
                result.points_m,
                result.sigma_m,
                result.flags,
            )
    bridge_hand(time_s, places, sigma, flags)
    return Tracked(time_s, places, sigma, flags, {}, np.zeros((1, 1, 3), np.uint8), count, {})


def bridge_hand(time_s: np.ndarray, places: np.ndarray, sigma: np.ndarray, flags: np.ndarray) -> None:
    """Fill short gaps in the hand's path by straight lines, in place, flagged as predicted."""
    seen = np.flatnonzero(np.isfinite(places[:, 0, 0]))
    for left, right in pairwise(seen.tolist()):
        if not 1 < right - left <= LONGEST_BRIDGE:
            continue
        inside = np.arange(left + 1, right)
        for axis in range(2):
            places[inside, 0, axis] = np.interp(
                time_s[inside], time_s[[left, right]], places[[left, right], 0, axis]
            )
        step_m = float(np.linalg.norm(places[right, 0] - places[left, 0])) / (right - left)
        sigma[inside, 0] = max(sigma[left, 0], sigma[right, 0]) + 0.25 * step_m
        flags[inside, 0] |= PREDICTED


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
