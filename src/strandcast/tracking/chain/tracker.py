"""The string from frame to frame: predict, fit, and search again where the fit is poor."""

from __future__ import annotations

import numpy as np

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.fit import NARROW_PX, WIDE_PX, ChainModel, FrameFit, PredictedChain, fit_frame
from strandcast.tracking.chain.frames import FrameInput
from strandcast.tracking.chain.links import place_nodes
from strandcast.tracking.chain.motion import ChainState, extrapolate, moving_half_px, still_half_px
from strandcast.tracking.chain.search import LONG, Guide, Stride, trace_string
from strandcast.tracking.tracker import StringHint

# All chosen on the drawn and lab videos of the tracking benchmark.
LINK_M = 0.006  # longest link of the tracker's chain
GOOD = 0.55  # mean reward from which a fit is accepted without trying others
ENOUGH = 0.3  # mean reward below which the string is lost
WORSE = 0.12  # below the usual value: a fit this much worse is compared with others
USUAL_SHARE = 0.1  # weight of the newest frame in the usual value
STALE_FRAMES = 8  # after which the last fit no longer guides
EAGER_TRIES = 1  # searches without success, after which only every RARE_TRIES-th frame is searched
RARE_TRIES = 4
LEAST_PATH_REWARD = 0.12  # mean reward of a path worth fitting; hidden parts earn nothing
BETTER = 0.02  # by which the fit from another start, or a second one, must be better to be taken
REDETECTED_BETTER = 0.05  # by which a redetected string must be
GUIDE_WEIGHT = 0.1 / 0.05**2  # cost (1/m²) of a squared distance from the expected string


def links_of(string: StringHint) -> int:
    """Return the number of links of the tracker's chain: a multiple of the number of mass points."""
    return string.points * max(1, round(string.length_m / string.points / LINK_M))


class ChainTracker:
    """Tracks the string from frame to frame, forwards or backwards; remembers the last two states."""

    def __init__(self, links: int, string: ChainModel, exposure_s: float, stride: Stride = LONG) -> None:
        self.links = links
        self.string = string
        self.exposure_s = exposure_s
        self.stride = stride  # of searches
        self.redetections = 0
        self._states: list[ChainState] = []
        self._usual_value = GOOD
        self._lost = 0
        self._tries = 0  # searches since the last good fit

    def copy(self) -> ChainTracker:
        """Return a tracker of the same string that remembers no states."""
        return ChainTracker(self.links, self.string, self.exposure_s, self.stride)

    def restart(self, states: list[ChainState]) -> None:
        """Continue from other states, the newest last."""
        self._states = states[-2:]
        self._lost = self._tries = 0

    def step(self, frame: FrameInput, *, search: bool = True) -> FrameFit | None:
        """Process the next frame; returns the fit, or None where the string is not found.

        Without `search`, the string is only looked for near the last states.
        """
        fit = self._next(frame, search)
        if fit is None or fit.value < ENOUGH:
            self._lost += 1
            self._states = self._states[-1:] if self._lost < STALE_FRAMES else []
            return None
        self._lost = 0
        self._usual_value += USUAL_SHARE * (fit.value - self._usual_value)
        self._states = [*self._states[-1:], ChainState(frame.time_s, fit.root, fit.heading)]
        return fit

    def fit(self, frame: FrameInput, heading: np.ndarray) -> FrameFit:
        """Fit the chain to a frame from headings found in it."""
        half_px = still_half_px(self.string.appearance, self.links, frame.window)
        return self._fit(frame, heading, heading, half_px, WIDE_PX)

    def through_given(self, frame: FrameInput) -> FrameFit:
        """Fit the chain to a frame in which places along it are given.

        It starts with the shape of the last state, or a straight line, each piece turned to its given place.
        """
        beads, bead_m = self.string.beads, frame.bead_m
        assert bead_m is not None
        known = np.flatnonzero((beads.radius_m == 0.0) & np.isfinite(bead_m[:, 0]))
        heading = self._states[-1].heading.copy() if self._states else np.zeros(self.links)
        nodes = place_nodes(frame.clamp_m, heading, self.string.link_m)
        before, first = frame.clamp_m, 0
        for b in known[np.argsort(beads.place_m[known])].tolist():
            last = round(float(beads.place_m[b]) / self.string.link_m)
            off, was = bead_m[b] - before, nodes[last] - nodes[first]
            heading[first:last] += np.arctan2(off[1], off[0]) - np.arctan2(was[1], was[0])
            before, first = bead_m[b], last
        return self.fit(frame, np.unwrap(heading))

    def _next(self, frame: FrameInput, search: bool) -> FrameFit | None:
        """Fit from the prediction; if that is poor, from other starts, and keep the best."""
        if not self._states:
            return self._redetect(frame, None, None) if search else None
        last = self._states[-1]
        expected = self._predict(frame.time_s)
        half_px = moving_half_px(self.string, frame, last, expected, self.exposure_s)
        good = max(GOOD, self._usual_value - WORSE)
        best: FrameFit | None = None
        for start, reach_px in ((expected, NARROW_PX), (expected, WIDE_PX), (last.heading, WIDE_PX)):
            fit = self._fit(frame, start, expected, half_px, reach_px)
            if best is None or fit.value > best.value + BETTER:
                best = fit
            if best.value >= good and not best.end_is_off:
                self._tries = 0
                return best
        assert best is not None
        return self._redetect(frame, expected, best) if search and best.value < good else best

    def _fit(
        self, frame: FrameInput, start: np.ndarray, prior: np.ndarray, half_px: np.ndarray, reach_px: float
    ) -> FrameFit:
        bead_m = frame.bead_m
        if bead_m is None:
            bead_m = np.full((len(self.string.beads.place_m), 2), np.nan)
        expected = PredictedChain(frame.clamp_m, start, prior, half_px, bead_m)
        fit: FrameFit = fit_frame(frame.window, self.string, expected, reach_px, True)
        return fit

    def _predict(self, time_s: float) -> np.ndarray:
        last = self._states[-1]
        if len(self._states) == 1:
            return last.heading
        before = self._states[0]
        share = (time_s - last.time_s) / (last.time_s - before.time_s)
        return np.asarray(extrapolate(before.heading, last.heading, share))

    def _redetect(
        self, frame: FrameInput, expected: np.ndarray | None, best: FrameFit | None
    ) -> FrameFit | None:
        self._tries += 1
        if self._tries > EAGER_TRIES and self._tries % RARE_TRIES:
            return best
        # The expectation may be wrong, so the string is also searched without that guide.
        for guide in (None,) if expected is None else (expected, None):
            fit = self._search(frame, guide)
            if fit is not None and (best is None or fit.value > best.value + REDETECTED_BETTER):
                self.redetections += 1
                best = fit
        return best

    def _search(self, frame: FrameInput, guide: np.ndarray | None) -> FrameFit | None:
        """Find the string from the clamp on, near the headings `guide` if given."""
        heading, value = find_string(
            frame, guide, self.links, self.string.link_m, self.string.appearance, self.stride
        )
        if value < LEAST_PATH_REWARD:
            return None
        if self._states:
            turns = np.round((self._states[-1].heading[0] - heading[0]) / (2 * np.pi))
            heading = heading + 2 * np.pi * turns
        return self.fit(frame, heading)


def find_string(
    frame: FrameInput,
    guide: np.ndarray | None,
    links: int,
    link_m: float,
    appearance: Appearance,
    stride: Stride = LONG,
) -> tuple[np.ndarray, float]:
    """Find the string from the clamp on; returns headings (links,) and the path's mean reward."""
    if guide is None:
        near = Guide(np.zeros((links + 1, 2)), 0.0)
    else:
        near = Guide(place_nodes(frame.clamp_m, guide, link_m), GUIDE_WEIGHT)
    clamp_rad = frame.window.hand_box.angle_rad
    found: tuple[np.ndarray, float] = trace_string(
        frame.window, appearance, frame.clamp_m, clamp_rad, link_m, links, stride, near
    )
    return found
