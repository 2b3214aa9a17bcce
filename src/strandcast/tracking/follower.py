"""The string from frame to frame: what is remembered, what is expected, and when to search anew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.tracking.chain import place_nodes
from strandcast.tracking.follow import ENOUGH, GOOD, Fit, find_string, fit_string
from strandcast.tracking.picture import Looks, Picture

WORSE = 0.12  # than usual: a fit that is so much worse is held against others
USUAL_SHARE = 0.1  # of the newest frame in what is usual
STALE_FRAMES = 8  # after which the last fit is no guide any more
EAGER_TRIES = 2  # searches without success, after which only every so many frames are searched
RARE_TRIES = 4
LEAST_WAY = 0.12  # mean reward of a way worth fitting; what is hidden earns nothing
WIDEST_BLUR_PX = 6.0


@dataclass(frozen=True)
class Sight:
    """One frame as the string is looked for: picture, time, hand's pose (x_m, y_m, angle_rad)."""

    picture: Picture
    time_s: float
    hand: np.ndarray


@dataclass(frozen=True)
class Moment:
    """The string where it was found last: time, hand's pose, headings."""

    time_s: float
    hand: np.ndarray
    heading: np.ndarray


class Follower:
    """Follows the string from frame to frame, forwards or backwards; holds the last two moments."""

    def __init__(self, links: int, link_m: float, looks: Looks, exposure_s: float) -> None:
        self.links = links
        self.link_m = link_m
        self.looks = looks
        self.exposure_s = exposure_s
        self.found_anew = 0
        self._moments: list[Moment] = []
        self._usual_value = GOOD
        self._lost = 0
        self._tries = 0  # searches without success since the last good fit

    def restart(self, moments: list[Moment]) -> None:
        """Go on from other moments, the last one last."""
        self._moments = moments[-2:]
        self._lost = self._tries = 0

    def step(self, sight: Sight) -> Fit | None:
        """Take the next frame; returns the fit, or None where the string is not found."""
        fit = self._next(sight)
        if fit is None or fit.value < ENOUGH:
            self._lost += 1
            self._moments = self._moments[-1:] if self._lost < STALE_FRAMES else []
            return None
        self._lost = 0
        self._usual_value += USUAL_SHARE * (fit.value - self._usual_value)
        self._moments = [*self._moments[-1:], Moment(sight.time_s, sight.hand, fit.heading)]
        return fit

    def _next(self, sight: Sight) -> Fit | None:
        """Fit from the prediction; where that is not good, from other starts, and keep the best."""
        if not self._moments:
            return self._anew(sight, None, None)
        last = self._moments[-1]
        expected = _predict(self._moments, sight.time_s)
        blur_m = self._blur(last, expected, sight)
        fit = self.fit(sight, expected, expected, blur_m)
        good = max(GOOD, self._usual_value - WORSE)
        if fit.value >= good and not fit.end_is_off:
            self._tries = 0
            return fit
        other = self.fit(sight, last.heading, expected, blur_m)
        best = other if other.value > fit.value + 0.02 else fit
        return best if best.value >= good else self._anew(sight, expected, best)

    def _anew(self, sight: Sight, expected: np.ndarray | None, best: Fit | None) -> Fit | None:
        self._tries += 1
        if self._tries > EAGER_TRIES and self._tries % RARE_TRIES:
            return best
        # What is expected may be what is wrong, so the string is searched without that guide too.
        for guide in (None,) if expected is None else (expected, None):
            fit = self._search(sight, guide)
            if fit is not None and (best is None or fit.value > best.value + 0.05):
                self.found_anew += 1
                best = fit
        return best

    def _search(self, sight: Sight, guide: np.ndarray | None) -> Fit | None:
        """Find the string from the clamp on, near the headings `guide` if there are any."""
        nodes = None if guide is None else place_nodes(sight.hand[:2], guide, self.link_m)
        heading, value = find_string(sight.picture, sight.hand, nodes, self.links, self.link_m, self.looks)
        if value < LEAST_WAY:
            return None
        if self._moments:
            turns = np.round((self._moments[-1].heading[0] - heading[0]) / (2 * np.pi))
            heading = heading + 2 * np.pi * turns
        return self.fit(sight, heading, heading, 0.0)

    def fit(self, sight: Sight, start: np.ndarray, prior: np.ndarray, blur_m: np.ndarray | float) -> Fit:
        """Fit the chain to a frame from headings `start`; `blur_m` is each node's way in the exposure."""
        scale = sight.picture.pixels.metre_per_pixel
        half_px = np.broadcast_to((self.looks.half_m + 0.5 * blur_m) / scale, (self.links + 1,))
        half_px = np.minimum(half_px, WIDEST_BLUR_PX)
        half_px[0] = self.looks.half_m / scale
        return fit_string(sight.picture, sight.hand, start, prior, self.link_m, half_px, self.looks)

    def _blur(self, last: Moment, expected: np.ndarray, sight: Sight) -> np.ndarray:
        """Return how far each node moves across the string while the shutter is open (m), (links + 1,)."""
        was = place_nodes(last.hand[:2], last.heading, self.link_m)
        now = place_nodes(sight.hand[:2], expected, self.link_m)
        middle = np.append(expected, expected[-1])
        across = -np.sin(middle) * (now - was)[:, 0] + np.cos(middle) * (now - was)[:, 1]
        return np.abs(across) * min(1.0, self.exposure_s / max(abs(sight.time_s - last.time_s), 1e-9))


def _predict(moments: list[Moment], time_s: float) -> np.ndarray:
    """Return headings carried on at their rate; the rate is smoothed along the string."""
    last = moments[-1]
    if len(moments) == 1:
        return last.heading
    rate = (last.heading - moments[0].heading) / (last.time_s - moments[0].time_s)
    padded = np.concatenate([rate[:1], rate[:1], rate, rate[-1:], rate[-1:]])
    rate = np.convolve(padded, np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0, mode="valid")
    return np.asarray(last.heading + rate * (time_s - last.time_s))
