"""The string from frame to frame: what is remembered, what is expected, and when to search anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strandcast.tracking.chain import place_nodes
from strandcast.tracking.crops import View
from strandcast.tracking.follow import ENOUGH, GOOD, LINK_M, Fit, find_string, fit_string, nearest_turn
from strandcast.tracking.judge import FrameResult, judge
from strandcast.tracking.looks import first_fit, level_at, visible_end
from strandcast.tracking.picture import Looks, Picture
from strandcast.tracking.result import StringHint

LONGEST_GAP = 10  # frames over which a hand that is not seen is carried on
LARGEST_CORRECTION = 0.03  # of the length, by the string's visible end
WORSE = 0.12  # than usual: a fit that is so much worse is held against others
USUAL_SHARE = 0.1  # of the newest frame in what is usual
STALE_FRAMES = 8  # after which the last fit is no guide any more
BALL_TIMES = 1.6  # wider than this, in the string's own widths and a pixel more, is a ball at the tip


class Follower:
    """Follows the string from frame to frame; holds the last two frames' headings and the string's looks."""

    def __init__(
        self, string: StringHint, exposure_s: float, hand_box: np.ndarray, polarity: float | None
    ) -> None:
        self.string = string
        self.every = max(1, round(string.length_m / string.points / LINK_M))
        self.links = self.every * string.points
        self.link_m = string.length_m / self.links
        self.exposure_s = exposure_s
        self.hand_box = hand_box
        self.polarity = polarity
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
        return judge(fit, hand, self.link_m, self.every, view)

    def _follow_hand(self, time_s: float, hand: np.ndarray | None) -> np.ndarray | None:
        """Return the hand, carried on as it moved where it is not seen; note it."""
        if hand is None:
            return _extrapolate(self._hand, time_s)
        if self._hand:
            hand = np.array([hand[0], hand[1], nearest_turn(hand[2], self._hand[-1][1][2])])
        self._hand = [*self._hand[-1:], (time_s, hand)]
        return hand

    def _start(self, picture: Picture, hand: np.ndarray) -> Fit | None:
        found = first_fit(picture, hand, self.links, self.link_m, self.string.thickness_m, self.polarity)
        if found is None:
            return None
        self.looks, fit = found
        self.first_frame = self._frame
        self._learn_length(picture, hand, fit)
        return self._fit(picture, hand, fit.heading, fit.heading, 0.0)

    def _learn_length(self, picture: Picture, hand: np.ndarray, fit: Fit) -> None:
        """Take the visible end for the string's, less what is beyond the tip: half its width, or a ball."""
        assert self.looks is not None
        end_m, half_m = visible_end(picture, hand, fit, self.link_m, self.looks)
        ball = half_m > BALL_TIMES * self.looks.half_m + picture.pixels.metre_per_pixel
        excess_m = half_m if ball else self.looks.half_m
        correction_m = end_m - excess_m
        if not abs(correction_m) <= LARGEST_CORRECTION * self.string.length_m:
            off = (
                f"it is {1e3 * correction_m:+.1f} mm off" if np.isfinite(correction_m) else "it is not clear"
            )
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
        self,
        picture: Picture,
        hand: np.ndarray,
        start: np.ndarray,
        prior: np.ndarray,
        blur_m: np.ndarray | float,
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
