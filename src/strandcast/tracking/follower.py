"""The string from frame to frame: what is remembered, what is expected, and when to search anew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from strandcast.tracking.chain import place_nodes
from strandcast.tracking.fit import NARROW_PX, WIDE_PX, Fit, fit_frame
from strandcast.tracking.picture import Looks, Picture
from strandcast.tracking.search import trace_string

LINK_M = 0.006  # longest link of the tracker's chain
GOOD = 0.55  # mean reward with which a fit is taken without trying others
ENOUGH = 0.3  # mean reward under which the string is lost
BEAMS = 60
WORSE = 0.12  # than usual: a fit that is so much worse is held against others
USUAL_SHARE = 0.1  # of the newest frame in what is usual
STALE_FRAMES = 8  # after which the last fit is no guide any more
EAGER_TRIES = 1  # searches without success, after which only every so many frames are searched
RARE_TRIES = 4
LEAST_WAY = 0.12  # mean reward of a way worth fitting; what is hidden earns nothing
WIDEST_BLUR_PX = 6.0
BETTER = 0.02  # another start's or a second look's fit must be, to be taken
ANEW_BETTER = 0.05  # a searched string must be


@dataclass(frozen=True)
class Sight:
    """One frame as the string is looked for: picture, time, hand's pose (x_m, y_m, angle_rad), clamp (2,)."""

    picture: Picture
    time_s: float
    hand: np.ndarray
    clamp_m: np.ndarray


@dataclass(frozen=True)
class Moment:
    """The string where it was found last: time, root, headings."""

    time_s: float
    root: np.ndarray
    heading: np.ndarray


class Follower:
    """Follows the string from frame to frame, forwards or backwards; holds the last two moments."""

    def __init__(self, links: int, link_m: float, looks: Looks, balls: np.ndarray, exposure_s: float) -> None:
        self.links = links
        self.link_m = link_m
        self.looks = looks
        self.balls = balls
        self.no_guess = np.full((len(balls), 2), np.nan)
        self.exposure_s = exposure_s
        self.found_anew = 0
        self._moments: list[Moment] = []
        self._usual_value = GOOD
        self._lost = 0
        self._tries = 0  # searches since the last good fit

    def twin(self) -> Follower:
        """Return another that knows the same and remembers nothing."""
        return Follower(self.links, self.link_m, self.looks, self.balls, self.exposure_s)

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
        self._moments = [*self._moments[-1:], Moment(sight.time_s, fit.root, fit.heading)]
        return fit

    def _next(self, sight: Sight) -> Fit | None:
        """Fit from the prediction; where that is not good, from other starts, and keep the best."""
        if not self._moments:
            return self._anew(sight, None, None)
        last = self._moments[-1]
        expected = self._predict(sight.time_s)
        share = min(1.0, self.exposure_s / max(abs(sight.time_s - last.time_s), 1e-9))
        blur = (last.root, last.heading, expected, share)
        half_px = blurred_half_px(
            self.looks, self.link_m, sight.clamp_m, sight.picture.plane.metre_per_pixel, *blur
        )
        good = max(GOOD, self._usual_value - WORSE)
        best: Fit | None = None
        for start, reach_px in ((expected, NARROW_PX), (expected, WIDE_PX), (last.heading, WIDE_PX)):
            fit = fit_frame(
                sight.picture,
                sight.clamp_m,
                start,
                expected,
                self.link_m,
                half_px,
                self.looks,
                self.balls,
                self.no_guess,
                reach_px,
                True,
            )
            if best is None or fit.value > best.value + BETTER:
                best = fit
            if best.value >= good and not best.end_is_off:
                self._tries = 0
                return best
        assert best is not None
        return best if best.value >= good else self._anew(sight, expected, best)

    def _predict(self, time_s: float) -> np.ndarray:
        last = self._moments[-1]
        if len(self._moments) == 1:
            return last.heading
        before = self._moments[0]
        share = (time_s - last.time_s) / (last.time_s - before.time_s)
        return np.asarray(carried_on(before.heading, last.heading, share))

    def _anew(self, sight: Sight, expected: np.ndarray | None, best: Fit | None) -> Fit | None:
        self._tries += 1
        if self._tries > EAGER_TRIES and self._tries % RARE_TRIES:
            return best
        # What is expected may be what is wrong, so the string is searched without that guide too.
        for guide in (None,) if expected is None else (expected, None):
            fit = self._search(sight, guide)
            if fit is not None and (best is None or fit.value > best.value + ANEW_BETTER):
                self.found_anew += 1
                best = fit
        return best

    def _search(self, sight: Sight, guide: np.ndarray | None) -> Fit | None:
        """Find the string from the clamp on, near the headings `guide` if there are any."""
        heading, value = find_string(sight, guide, self.links, self.link_m, self.looks)
        if value < LEAST_WAY:
            return None
        if self._moments:
            turns = np.round((self._moments[-1].heading[0] - heading[0]) / (2 * np.pi))
            heading = heading + 2 * np.pi * turns
        return self.fit(sight, heading)

    def fit(self, sight: Sight, heading: np.ndarray) -> Fit:
        """Fit the chain to a frame from headings found in it."""
        half_px = still_half_px(self.looks, self.links, sight.picture)
        return fit_frame(
            sight.picture,
            sight.clamp_m,
            heading,
            heading,
            self.link_m,
            half_px,
            self.looks,
            self.balls,
            self.no_guess,
            WIDE_PX,
            True,
        )


def find_string(
    sight: Sight, guide: np.ndarray | None, links: int, link_m: float, looks: Looks
) -> tuple[np.ndarray, float]:
    """Find the string anew from the clamp; returns headings (links,) and the way's mean reward."""
    weight = 0.0 if guide is None else 0.1 / 0.05**2
    nodes = np.zeros((links + 1, 2)) if guide is None else place_nodes(sight.clamp_m, guide, link_m)
    return trace_string(
        sight.picture, float(sight.hand[2]), link_m, links, looks, sight.clamp_m, nodes, weight, BEAMS
    )


def still_half_px(looks: Looks, links: int, picture: Picture) -> np.ndarray:
    """Return half the visible width at each node (links + 1,) of a string at rest."""
    return np.full(links + 1, looks.half_m / picture.plane.metre_per_pixel)


@njit(cache=True)
def carried_on(before: np.ndarray, last: np.ndarray, share: float) -> np.ndarray:
    """Return headings (M,) carried on by `share` of their last change, which is smoothed along the string."""
    count = len(last)
    weights = (1.0 / 16, 4.0 / 16, 6.0 / 16, 4.0 / 16, 1.0 / 16)
    out = np.empty(count)
    for j in range(count):
        change = 0.0
        for a in range(5):
            k = min(max(j + a - 2, 0), count - 1)
            change += weights[a] * (last[k] - before[k])
        out[j] = last[j] + share * change
    return out


@njit(cache=True)
def blurred_half_px(
    looks: Looks,
    link_m: float,
    root: np.ndarray,
    metre_per_pixel: float,
    last_root: np.ndarray,
    last: np.ndarray,
    expected: np.ndarray,
    share: float,
) -> np.ndarray:
    """Return half the visible width at each node (M + 1,): the string's, and half its way in the exposure.

    `share` is the exposure's part of the time from the last headings to those expected.
    """
    was = place_nodes(last_root, last, link_m)
    now = place_nodes(root, expected, link_m)
    count = len(expected)
    half_px = np.empty(count + 1)
    for k in range(count + 1):
        angle = expected[min(k, count - 1)]
        across = -np.sin(angle) * (now[k, 0] - was[k, 0]) + np.cos(angle) * (now[k, 1] - was[k, 1])
        half_px[k] = min((looks.half_m + 0.5 * abs(across) * share) / metre_per_pixel, WIDEST_BLUR_PX)
    half_px[0] = looks.half_m / metre_per_pixel
    return half_px
