"""How far a fit is to be believed, point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.records.track import OCCLUDED, UNSURE
from strandcast.tracking.chain import place_nodes
from strandcast.tracking.follow import GOOD, Fit, point_sigmas
from strandcast.tracking.one_look import CLEAR
from strandcast.tracking.picture import Picture
from strandcast.tracking.pixelmap import to_pixel

SEEN_SHARE = 0.34  # of the nodes around a point that must be clear
TIP_SLIDE_PX = 4.0  # between the fitted tip and the string's visible end, from which the tip is unsure
UNSURE_M = 0.003  # sigma from which a place is unsure
FOLD_RAD = 0.7  # from a link to the next but one
FOLD_REACH_M = 0.06
LOST_M = 0.015  # sigma from which a place is no measurement
LONGEST_HIDDEN_M = 0.07  # of string whose course between seen ends is inferred


@dataclass(frozen=True)
class FrameResult:
    """The string in one frame: places (n, 2), sigmas and flags (n,) of the mass points 1 to n."""

    points_m: np.ndarray
    sigma_m: np.ndarray
    flags: np.ndarray
    value: float


def judge(fit: Fit, hand: np.ndarray, every: int, picture: Picture) -> FrameResult:
    """Return the mass points of a fit with sigma and flags; what was not seen to the end is NaN."""
    nodes = place_nodes(hand[:2], fit.heading, fit.link_m)
    points = nodes[every::every].copy()
    sigma = point_sigmas(fit, every)
    flags = np.zeros(len(points), dtype=np.int32)
    window = np.convolve((fit.reward[1:] >= CLEAR).astype(float), np.ones(every) / every, mode="same")
    seen = window[every - 1 :: every].copy()
    if fit.ball_seen:
        seen[-1] = 1.0
    flags[seen < SEEN_SHARE] |= OCCLUDED
    if (
        not np.isfinite(fit.tip_slide_m)
        or abs(fit.tip_slide_m) > TIP_SLIDE_PX * picture.pixels.metre_per_pixel
    ):
        flags[-1] |= UNSURE
        sigma[-1] = max(sigma[-1], UNSURE_M)
    doubtful = near_fold(fit, every)
    flags[doubtful] |= UNSURE
    sigma[doubtful] = np.maximum(sigma[doubtful], UNSURE_M)
    flags[sigma > UNSURE_M] |= UNSURE
    lost = (sigma > LOST_M) | in_long_gap(seen >= SEEN_SHARE, LONGEST_HIDDEN_M / (every * fit.link_m))
    lost |= outside(points, picture)
    points[lost] = np.nan
    sigma[lost] = np.nan
    flags[lost] = 0
    return FrameResult(points, sigma, flags, fit.value)


def near_fold(fit: Fit, every: int) -> np.ndarray:
    """Tell which points (n,) may have slid along the string.

    A fold that is tighter than the chain's links is cut short, and its length goes to its neighbours. Where
    the string's end is not seen, nothing says how much.
    """
    bend = np.abs(fit.heading[2:] - fit.heading[:-2])
    folds = 1 + np.flatnonzero(bend > FOLD_RAD)
    count = len(fit.heading) // every
    if fit.value < GOOD or (len(folds) and not np.isfinite(fit.tip_slide_m)):
        return np.ones(count, dtype=bool)
    place = np.arange(1, count + 1) * every
    near = (np.abs(place[:, None] - folds) * fit.link_m < FOLD_REACH_M).any(axis=1)
    near[-1] = False
    return near


def in_long_gap(seen: np.ndarray, longest: float) -> np.ndarray:
    """Tell which points (n,) lie in a run of more than `longest` unseen ones, or of over one at the end.

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


def outside(points_m: np.ndarray, picture: Picture) -> np.ndarray:
    """Tell which points (n,) lie outside the picture."""
    pixels = picture.pixels
    rows, columns = picture.image.shape
    uv = np.array([to_pixel(x, y, pixels.origin_m, pixels.step_m, pixels.uv) for x, y in points_m])
    return np.asarray((uv < 0).any(axis=1) | (uv[:, 0] > columns - 1) | (uv[:, 1] > rows - 1))
