"""The ball at the end of a pendulum's thread: the largest thing that moves before the background."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from strandcast.errors import StrandcastError
from strandcast.progress import Progress
from strandcast.records.manifest import VideoFacts
from strandcast.tracking.background import Samples, learn_background
from strandcast.tracking.counts import check_count
from strandcast.video.reader import open_video

NOISE_TIMES = 8.0
LEAST_CHANGE = 12.0  # grey levels
LEAST_AREA_PX = 30.0
AREA_SPREAD = 0.3  # of the usual area, by which a silhouette may differ
SIGMA_PX = 0.3  # of a silhouette's centre


@dataclass(frozen=True)
class BallPath:
    """Where the ball was.

    Attributes
    ----------
    centre_px
        (F, 2), NaN where it was not seen whole.
    radius_px
        Its usual radius.
    background
        The scene without it (height, width).
    decoded
        Frames decoded.
    messages
        The decoder's complaints.
    """

    centre_px: np.ndarray
    radius_px: float
    background: np.ndarray
    decoded: int
    messages: list[str]


def follow_ball(path: str | Path, facts: VideoFacts, background_frames: int) -> BallPath:
    """Follow the ball through a video.

    The background is needed first, so the video is decoded twice: pendulum videos are short and small.

    Raises
    ------
    StrandcastError
        SC-T001 the decoded count differs from the manifest's; SC-T005 nothing of constant size moves.
    """
    background = scene_behind(path, facts, background_frames)
    tell = Progress("track: ball", total=facts.packets)
    seen = []
    with open_video(path) as video:
        for index, _, image in video:
            seen.append(silhouette(image, background))
            tell(index + 1)
    check_count(len(seen), facts, path)
    found = np.asarray(seen)
    area = found[:, 2]
    usual = float(np.median(area[area > 0])) if (area > 0).any() else 0.0
    whole = np.abs(area - usual) < AREA_SPREAD * usual
    if usual < LEAST_AREA_PX or whole.mean() < 0.5:
        raise StrandcastError(
            "SC-T005", f"no ball of constant size is seen in most frames (in {100 * whole.mean():.0f} %)",
            file=path, fix="film all of the ball's swing before a plain background")  # fmt: skip
    centre = np.where(whole[:, None], found[:, :2], np.nan)
    return BallPath(centre, float(np.sqrt(usual / np.pi)), background, len(seen), video.messages)


def scene_behind(path: str | Path, facts: VideoFacts, frames: int) -> np.ndarray:
    """Return the background of a video, from a decoding pass of its own."""
    with open_video(path) as video:
        depth = 1 if video.info.max_level < 256 else 2
        samples = Samples(facts.packets, frames, depth * video.info.width * video.info.height)
        for index, _, image in video:
            samples.offer(index, image)
    return learn_background(samples.pictures, frames)[0]


def silhouette(image: np.ndarray, background: np.ndarray) -> tuple[float, float, float]:
    """Return centre (px) and area (px²) of the convex hull of the largest change; area 0 where there is none.

    The hull closes what on the ball is as bright as the background.
    """
    change = cv2.absdiff(image, background)
    noise = 1.48 * float(np.median(change[::4, ::4]))
    mask = (change > max(LEAST_CHANGE, NOISE_TIMES * noise)).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return np.nan, np.nan, 0.0
    moments = cv2.moments(cv2.convexHull(max(outlines, key=cv2.contourArea)))
    if moments["m00"] < LEAST_AREA_PX:
        return np.nan, np.nan, 0.0
    return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"], float(moments["m00"])
