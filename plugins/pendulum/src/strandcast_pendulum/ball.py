"""The ball at the end of a pendulum's thread: the largest object that moves in front of the background."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from strandcast.errors import StrandcastError
from strandcast.progress import Progress
from strandcast.records.manifest import VideoFacts
from strandcast.tracking.background import Samples, learn_background
from strandcast.tracking.preconditions import check_count, check_pixel_aspect, open_ingested

NOISE_TIMES = 8.0
LEAST_CHANGE = 12.0  # grey levels
LEAST_AREA_PX = 30.0
RADIUS_SPREAD = 0.1  # largest relative difference of an outline from the usual radius
SIGMA_PX = 0.3  # of an outline's centre
RAYS = 180
RAY_STEP_PX = 0.5
WINDOWS = (0.35, 0.2, 0.1, 0.1)  # of the radius, to both sides: search range of the outline, round by round
ROUNDS = 3  # of the robust fit to the steps found
LEAST_SCATTER_PX = 0.3
LEAST_RADIUS_PX = 2.0


@dataclass(frozen=True)
class BallTrack:
    """The ball's path through a video of F frames."""

    centre_px: np.ndarray  # (F, 2), NaN where it is not fully visible
    radius_px: float  # median
    background: np.ndarray  # the scene without it (height, width)
    decoded: int  # frames
    warnings: list[str]  # of the decoder


def track_ball(path: str | Path, facts: VideoFacts) -> BallTrack:
    """Track the ball through a video.

    The background is needed first, so the video is decoded twice: pendulum videos are short and small.

    Raises
    ------
    StrandcastError
        SC-V005 the decoded count differs from the manifest's; SC-T004 nothing of constant size moves;
        SC-C012 pixels that are not square.
    """
    background = learn_scene(path, facts)
    progress = Progress("track: ball", total=facts.packets)
    balls = []
    with open_ingested(path, facts) as video:
        for index, _, image in video:
            balls.append(find_ball(image, background))
            progress(index + 1)
    check_count(len(balls), facts, path)
    found = np.asarray(balls)
    radius = found[:, 2]
    usual = float(np.median(radius[radius > 0])) if (radius > 0).any() else 0.0
    whole = np.abs(radius - usual) < RADIUS_SPREAD * usual
    if np.pi * usual**2 < LEAST_AREA_PX or whole.mean() < 0.5:
        raise StrandcastError(
            "SC-T004",
            f"no ball of constant size is detected in most frames (in {100 * whole.mean():.0f} %)",
            file=path,
            fix="film all of the ball's swing in front of a plain background",
        )
    centre = np.where(whole[:, None], found[:, :2], np.nan)
    return BallTrack(centre, usual, background, len(balls), video.warnings())


def learn_scene(path: str | Path, facts: VideoFacts) -> np.ndarray:
    """Return the background of a video, from a decoding pass of its own."""
    with open_ingested(path, facts) as video:
        check_pixel_aspect(video.info, None, path)
        samples = Samples(facts.packets, video.info.frame_bytes)
        for index, _, image in video:
            samples.offer(index, image)
    return learn_background(samples.pictures)[0]


def find_ball(image: np.ndarray, background: np.ndarray) -> tuple[float, float, float]:
    """Return the ball's centre (px) and radius (px); radius 0 where there is none."""
    x, y, area = silhouette(image, background)
    if area == 0.0:
        return np.nan, np.nan, 0.0
    return outline(image, np.array([x, y]), float(np.sqrt(area / np.pi)))


def silhouette(image: np.ndarray, background: np.ndarray) -> tuple[float, float, float]:
    """Return centre (px) and area (px²) of the convex hull of the largest change; area 0 where there is none.

    The hull includes parts of the ball that are as bright as the background. A change of the whole scene's
    brightness does not count: cameras adapt their exposure.
    """
    change = cv2.subtract(image, background, dtype=cv2.CV_32F)
    some = change[::4, ::4]
    brighter = float(np.median(some))
    noise = 1.48 * float(np.median(np.abs(some - brighter)))
    mask = (np.abs(change - brighter) > max(LEAST_CHANGE, NOISE_TIMES * noise)).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return np.nan, np.nan, 0.0
    moments = cv2.moments(cv2.convexHull(max(outlines, key=cv2.contourArea)))
    if moments["m00"] < LEAST_AREA_PX:
        return np.nan, np.nan, 0.0
    return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"], float(moments["m00"])


def outline(image: np.ndarray, centre: np.ndarray, radius: float) -> tuple[float, float, float]:
    """Return centre (px) and radius (px) of the circle through the strongest steps around a silhouette.

    A silhouette includes the ball's shadow and excludes parts as bright as the wall; both shift its centre
    (2,) and radius [px], but not the outline's.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, RAYS, endpoint=False)
    rays = np.column_stack([np.cos(angle), np.sin(angle)])
    for window in WINDOWS:
        far, strength = _steps(image, centre, rays, radius * (1.0 - window), radius * (1.0 + window))
        centre, radius = _circle(centre + far[:, None] * rays, strength > LEAST_CHANGE, centre, radius)
        if radius < LEAST_RADIUS_PX:
            return np.nan, np.nan, 0.0
    return float(centre[0]), float(centre[1]), radius


def _steps(
    image: np.ndarray, centre: np.ndarray, rays: np.ndarray, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return distance (R,) [px] and size (R,), over 2 px, of the largest grey step on each ray (R, 2)."""
    far = np.arange(low - 1.0, high + 1.0 + RAY_STEP_PX, RAY_STEP_PX)
    places = (centre + far[:, None, None] * rays).astype(np.float32)
    levels = cv2.remap(
        image, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    step = np.abs(levels[4:].astype(np.float32) - levels[:-4])
    best = np.clip(step.argmax(axis=0), 1, len(step) - 2)
    before, top, after = (np.take_along_axis(step, (best + k)[None], axis=0)[0] for k in (-1, 0, 1))
    curve = np.minimum(before - 2.0 * top + after, -1e-6)
    part = np.clip(0.5 * (before - after) / curve, -1.0, 1.0)
    return far[2 + best] + part * RAY_STEP_PX, top


def _circle(
    places: np.ndarray, used: np.ndarray, centre: np.ndarray, radius: float
) -> tuple[np.ndarray, float]:
    """Fit a circle to places (R, 2) robustly; radius 0 where too few are used."""
    if used.sum() < RAYS // 4:
        return centre, 0.0
    about = places - centre
    design = np.column_stack([2.0 * about, np.ones(len(about))])
    weight = used.astype(float)
    for _ in range(ROUNDS):
        weighted = weight[:, None] * design
        answer = np.linalg.lstsq(design.T @ weighted, weighted.T @ (about**2).sum(axis=1), rcond=None)[0]
        radius = float(np.sqrt(max(answer[2] + answer[0] ** 2 + answer[1] ** 2, 0.0)))
        off = np.abs(np.hypot(*(about - answer[:2]).T) - radius)
        scatter = max(LEAST_SCATTER_PX, 1.48 * float(np.median(off[used])))
        weight = used / (1.0 + (off / scatter) ** 2) ** 2
    return centre + answer[:2], radius
