"""Beads on the string through a video: tracked from frame to frame where the chain misses them."""

import numpy as np

from strandcast.tracking.chain.bead_search import BEAD_REACH_PX, Beads, bead_centre
from strandcast.tracking.chain.fit import FrameFit
from strandcast.tracking.chain.frames import StringFrames
from strandcast.tracking.chain.links import place_on

FAR_PX = 6.0  # chosen: from the chain's place; beyond it a bead is searched from frame to frame instead


def track_beads(frames: StringFrames, fits: list[FrameFit | None], beads: Beads) -> np.ndarray:
    """Return where the beads are, (F, B, 2) m; NaN where they are not found.

    A chain that cuts a fold short misses the weight in the fold. The weight itself is round, wider than the
    string, and moves steadily.
    """
    centres = np.full((len(fits), len(beads.place_m), 2), np.nan)
    if frames.given is not None:
        centres[:, : len(frames.given.share)] = frames.given.place_m
    searched = np.flatnonzero(beads.radius_m).tolist()
    for index, fit in enumerate(fits):
        window = frames.window(index) if fit is not None and len(beads.place_m) else None
        if fit is None or window is None:
            continue
        for b in searched:
            expected = place_on(fit.nodes(), fit.heading, beads.place_m[b])
            found = bead_centre(window, expected, beads, b)
            if np.hypot(*(found - expected)) < FAR_PX * window.plane.metre_per_pixel:
                centres[index, b] = found
    for b in searched:
        for order in (range(len(fits)), range(len(fits) - 1, -1, -1)):
            _continue(frames, centres[:, b], beads, b, order)
    return centres


def _continue(frames: StringFrames, centres: np.ndarray, beads: Beads, b: int, order: range) -> None:
    """Find bead `b` in frames that follow one in which it was found, in place (F, 2)."""
    for index in order[1:]:
        last = centres[index - order.step]
        if np.isfinite(centres[index, 0]) or not np.isfinite(last[0]):
            continue
        window = frames.window(index)
        if window is None:
            continue
        before = index - 2 * order.step
        known = 0 <= before < len(centres) and np.isfinite(centres[before, 0])
        expected = 2 * last - centres[before] if known else last
        found = bead_centre(window, expected, beads, b)
        if np.hypot(*(found - expected)) < BEAD_REACH_PX * window.plane.metre_per_pixel:
            centres[index] = found
