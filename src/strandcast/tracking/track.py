"""One trial's video to its track: the decoding pass, the hand, the string, and an honest account of both."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.progress import Progress, progress
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.records.track import OCCLUDED, PREDICTED, UNSURE
from strandcast.tracking.background import Samples, learn_background
from strandcast.tracking.chain import place_nodes
from strandcast.tracking.counts import check_count, check_size
from strandcast.tracking.crops import Crops, View
from strandcast.tracking.follow import (
    CLEAR, ENOUGH, GOOD, LINK_M, Fit, Looks, Picture, find_string, fit_string, nearest_turn, point_sigmas,
)  # fmt: skip
from strandcast.tracking.hand import HandFinder, HandMarker, HandSighting, box_around
from strandcast.tracking.looks import first_fit, level_at, visible_end
from strandcast.tracking.pixelmap import PixelMap, tabulate
from strandcast.tracking.strobe import Strobe
from strandcast.video.ingest import camera_times
from strandcast.video.reader import open_video

CROP_LENGTHS = 1.25  # around the hand, in lengths of the string
EXPOSURE_SHARE = 0.2  # of the frame interval, where the exposure is not given
LARGEST_CORRECTION = 0.03  # of the length, by the string's visible end
WORSE = 0.12  # than usual: a fit that is so much worse is held against others
USUAL_SHARE = 0.1  # of the newest frame in what is usual
STALE_FRAMES = 8  # after which the last fit is no guide any more
BALL_TIMES = 1.6  # wider than this, in the string's own widths and a pixel more, is a ball at the tip
UNSURE_M = 0.003  # sigma from which a place is unsure
LOST_M = 0.015  # sigma from which a place is no measurement
LONGEST_HIDDEN_M = 0.07  # of string whose course between seen ends is inferred
LONGEST_GAP = 10  # frames over which a hand that was not seen is bridged


@dataclass(frozen=True)
class StringHint:
    """What is known of the string: free length, number of mass points n, and its thickness if measured."""

    length_m: float
    points: int
    thickness_m: float | None = None


@dataclass
class Tracked:
    """What the pass found: arrays over F frames and n + 1 points (0 the hand); NaN where not seen.

    ``markers`` are the columns of markers.parquet. ``strobe`` is a colour picture (height, width, 3).
    """

    camera_time_s: np.ndarray
    points_m: np.ndarray
    sigma_m: np.ndarray
    flags: np.ndarray
    markers: dict[str, np.ndarray]
    strobe: np.ndarray
    decoded_frames: int
    choices: dict[str, float | int | str | bool | None]
    warnings: list[str] = field(default_factory=list)


def track_video(
    path: str | Path,
    facts: VideoFacts,
    camera: Camera,
    string: StringHint,
    markers: list[HandMarker],
    dictionary: str = "DICT_4X4_50",
    background_frames: int = 40,
    exposure_s: float | None = None,
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
        follower = Follower(string, exposure_s, box_around(markers))
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


@dataclass(frozen=True)
class FrameResult:
    """The string in one frame: places (n, 2), sigmas and flags (n,) of the mass points 1 to n."""

    points_m: np.ndarray
    sigma_m: np.ndarray
    flags: np.ndarray
    value: float


class Follower:
    """Follows the string from frame to frame; holds the last two frames' headings and the string's looks."""

    def __init__(
        self, string: StringHint, exposure_s: float, hand_box: np.ndarray
    ) -> None:
        self.string = string
        self.every = max(1, round(string.length_m / string.points / LINK_M))
        self.links = self.every * string.points
        self.link_m = string.length_m / self.links
        self.exposure_s = exposure_s
        self.hand_box = hand_box
        self.looks: Looks | None = None
        self.first_frame: int | None = None
        self.found_anew = 0
        self.warnings: list[str] = []
        self._usual_value = GOOD
        self._frame = -1
        self._lost = 0
        self._hand: list[tuple[float, np.ndarray]] = []  # the last two times and poses
        self._heading: list[tuple[float, np.ndarray]] = []  # the last two times and headings

    def step(self, view: View, time_s: float, hand: np.ndarray | None) -> FrameResult | None:
        """Take one frame; returns the string's points, or None where it is not found."""
        self._frame += 1
        hand = self._follow_hand(time_s, hand)
        if hand is None:
            return None
        picture = Picture(view.image, view.background, view.pixels, self.hand_box)
        fit = self._start(picture, hand) if self.looks is None else self._next(picture, time_s, hand)
        if fit is None or fit.value < ENOUGH:
            self._lost += 1
            self._heading = self._heading[-1:] if self._lost < STALE_FRAMES else []
            return None
        self._lost = 0
        self._usual_value += USUAL_SHARE * (fit.value - self._usual_value)
        self._heading = [*self._heading[-1:], (time_s, fit.heading)]
        return judge(fit, hand, self.link_m, self.every, view.pixels)

    def _follow_hand(self, time_s: float, hand: np.ndarray | None) -> np.ndarray | None:
        """Return the hand, carried on as it moved where it is not seen; note it."""
        if hand is None:
            return _extrapolate(self._hand, time_s)
        if self._hand:
            hand = np.array([hand[0], hand[1], nearest_turn(hand[2], self._hand[-1][1][2])])
        self._hand = [*self._hand[-1:], (time_s, hand)]
        return hand

    def _start(self, picture: Picture, hand: np.ndarray) -> Fit | None:
        found = first_fit(picture, hand, self.links, self.link_m, self.string.thickness_m)
        if found is None:
            return None
        self.looks, fit = found
        self.first_frame = self._frame
        self._learn_length(picture, hand, fit)
        return self._fit(picture, hand, fit.heading, fit.heading, 0.0)

    def _learn_length(self, picture: Picture, hand: np.ndarray, fit: Fit) -> None:
        """Take the visible end for the string's end, less what is beyond its middle: half its width, or a ball."""
        assert self.looks is not None
        end_m, half_m = visible_end(picture, hand, fit, self.link_m, self.looks)
        ball = half_m > BALL_TIMES * self.looks.half_m + picture.pixels.metre_per_pixel
        excess_m = half_m if ball else self.looks.half_m
        correction_m = end_m - excess_m
        if not abs(correction_m) <= LARGEST_CORRECTION * self.string.length_m:
            off = f"it is {1e3 * correction_m:+.1f} mm off" if np.isfinite(correction_m) else "it is not clear"
            self.warnings.append(f"the string's visible end does not fit its length: {off}")
            correction_m = 0.0
        self.link_m = (self.string.length_m + correction_m) / self.links
        self.looks = replace(self.looks, tip_excess_m=excess_m)
        if ball and np.isfinite(end_m):
            tip = place_nodes(hand[:2], fit.heading, self.link_m)[-1]
            self.looks = replace(self.looks, ball_level=level_at(picture, tip))

    def _next(self, picture: Picture, time_s: float, hand: np.ndarray) -> Fit | None:
        """Fit from the prediction; where that is not good, from other starts, and keep the best."""
        last_s, last = self._heading[-1] if self._heading else (time_s, None)
        if last is None:
            return self._anew(picture, hand, None, None)
        expected = _predict(self._heading, time_s)
        blur_m = self._blur(hand, expected, last, time_s - last_s)
        fit = self._fit(picture, hand, expected, expected, blur_m)
        good = max(GOOD, self._usual_value - WORSE)
        if fit.value >= good:
            return fit
        other = self._fit(picture, hand, last, expected, blur_m)
        best = other if other.value > fit.value + 0.02 else fit
        return self._anew(picture, hand, expected, best) if best.value < good else best

    def _anew(
        self, picture: Picture, hand: np.ndarray, expected: np.ndarray | None, best: Fit | None
    ) -> Fit | None:
        assert self.looks is not None
        guide = None if expected is None else place_nodes(hand[:2], expected, self.link_m)
        heading, value = find_string(picture, hand, guide, self.links, self.link_m, self.looks)
        if value < ENOUGH:
            return best
        if expected is not None:
            heading = heading + 2 * np.pi * np.round((expected[0] - heading[0]) / (2 * np.pi))
        fit = self._fit(picture, hand, heading, heading, 0.0)
        if best is None or fit.value > best.value + 0.05:
            self.found_anew += 1
            return fit
        return best

    def _fit(
        self, picture: Picture, hand: np.ndarray, start: np.ndarray, prior: np.ndarray, blur_m: np.ndarray | float
    ) -> Fit:
        assert self.looks is not None
        half_px = (self.looks.half_m + 0.5 * blur_m) / picture.pixels.metre_per_pixel
        half_px = np.minimum(np.broadcast_to(half_px, (self.links + 1,)), 6.0).copy()
        half_px[0] = self.looks.half_m / picture.pixels.metre_per_pixel
        return fit_string(picture, hand, start, prior, self.link_m, half_px, self.looks)

    def _blur(self, hand: np.ndarray, expected: np.ndarray, last: np.ndarray, span_s: float) -> np.ndarray:
        """Return how far each node moves across the string while the shutter is open (m), (links + 1,)."""
        before = self._hand[-2][1] if len(self._hand) > 1 else hand
        was = place_nodes(before[:2], last, self.link_m)
        now = place_nodes(hand[:2], expected, self.link_m)
        middle = np.append(expected, expected[-1])
        across = -np.sin(middle) * (now - was)[:, 0] + np.cos(middle) * (now - was)[:, 1]
        return np.abs(across) * min(1.0, self.exposure_s / max(span_s, 1e-9))


def _extrapolate(history: list[tuple[float, np.ndarray]], time_s: float) -> np.ndarray | None:
    if not history:
        return None
    if len(history) == 1:
        return history[0][1]
    (before_s, before), (last_s, last) = history
    if time_s - last_s > LONGEST_GAP * (last_s - before_s):
        return None
    return np.asarray(last + (last - before) * (time_s - last_s) / (last_s - before_s))


def _predict(history: list[tuple[float, np.ndarray]], time_s: float) -> np.ndarray:
    """Return headings carried on at their rate; the rate is smoothed along the string."""
    last_s, last = history[-1]
    if len(history) == 1:
        return last
    before_s, before = history[0]
    rate = (last - before) / (last_s - before_s)
    padded = np.concatenate([rate[:1], rate[:1], rate, rate[-1:], rate[-1:]])
    rate = np.convolve(padded, np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0, mode="valid")
    return np.asarray(last + rate * (time_s - last_s))


def judge(
    fit: Fit, hand: np.ndarray, link_m: float, every: int, pixels: PixelMap
) -> FrameResult:
    """Return the mass points of a fit with sigma and flags; what was not seen to the end is NaN."""
    nodes = place_nodes(hand[:2], fit.heading, link_m)
    points = nodes[every::every].copy()
    sigma = point_sigmas(fit, link_m, every)
    flags = np.zeros(len(points), dtype=np.int32)
    window = np.convolve((fit.reward[1:] >= CLEAR).astype(float), np.ones(every) / every, mode="same")
    seen = window[every - 1 :: every].copy()
    if fit.ball_seen:
        seen[-1] = 1.0
    flags[seen < 0.34] |= OCCLUDED
    if not np.isfinite(fit.tip_slide_m) or abs(fit.tip_slide_m) > 4 * pixels.metre_per_pixel:
        flags[-1] |= UNSURE
        sigma[-1] = max(sigma[-1], UNSURE_M)
    flags[sigma > UNSURE_M] |= UNSURE
    lost = (sigma > LOST_M) | in_long_gap(seen >= 0.34, LONGEST_HIDDEN_M / (every * link_m))
    points[lost] = np.nan
    sigma[lost] = np.nan
    flags[lost] = 0
    return FrameResult(points, sigma, flags, fit.value)


def in_long_gap(seen: np.ndarray, longest: float) -> np.ndarray:
    """Tell which points (n,) lie in a run of more than `longest` unseen ones, or in an unseen end of over one.

    Before the first point is the hand, which counts as seen.
    """
    lost = np.zeros(len(seen), dtype=bool)
    start = 0
    for k in range(len(seen) + 1):
        if k < len(seen) and not seen[k]:
            continue
        run = k - start
        if run > (longest if k < len(seen) else 1):
            lost[start:k] = True
        start = k + 1
    return lost


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
            places[index, 1:], sigma[index, 1:], flags[index, 1:] = result.points_m, result.sigma_m, result.flags
    bridge_hand(time_s, places, sigma, flags)
    empty = {name: np.zeros(0) for name in ("frame",)}
    return Tracked(time_s, places, sigma, flags, empty, np.zeros((1, 1, 3), np.uint8), count, {})


def bridge_hand(time_s: np.ndarray, places: np.ndarray, sigma: np.ndarray, flags: np.ndarray) -> None:
    """Fill short gaps in the hand's path by straight lines, in place, flagged as predicted."""
    seen = np.flatnonzero(np.isfinite(places[:, 0, 0]))
    for left, right in zip(seen[:-1], seen[1:], strict=True):
        if not 1 < right - left <= LONGEST_GAP:
            continue
        inside = np.arange(left + 1, right)
        for axis in range(2):
            places[inside, 0, axis] = np.interp(time_s[inside], time_s[[left, right]], places[[left, right], 0, axis])
        step_m = float(np.linalg.norm(places[right, 0] - places[left, 0])) / (right - left)
        sigma[inside, 0] = max(sigma[left, 0], sigma[right, 0]) + 0.25 * step_m
        flags[inside, 0] |= PREDICTED


def marker_columns(
    finder: HandFinder, hands: list[HandSighting | None], time_s: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the columns of markers.parquet: each marker seen on the hand, by frame."""
    names = ("frame", "camera_time_s", "marker", "x_m", "y_m", "angle_rad", "sigma_m")
    parts = []
    for marker in finder.markers:
        frames = [index for index, hand in enumerate(hands) if hand is not None and marker in hand.corners_px]
        if frames:
            seen = [hand.corners_px[marker] for hand in hands if hand is not None and marker in hand.corners_px]
            pose, sigma_m = finder.marker_poses(marker, np.stack(seen))
            pose[:, 2] = np.unwrap(pose[:, 2])
            parts.append(
                np.column_stack([frames, time_s[frames], np.full(len(frames), marker), pose, sigma_m])
            )
    table = np.concatenate(parts) if parts else np.zeros((0, 7))
    table = table[np.lexsort((table[:, 2], table[:, 0]))]
    columns = {name: table[:, i] for i, name in enumerate(names)}
    for name in ("frame", "marker"):
        columns[name] = columns[name].astype(np.int32)
    return columns
