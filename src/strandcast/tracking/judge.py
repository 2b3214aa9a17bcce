"""How far a fit is to be believed, point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from strandcast.records.track import OCCLUDED, UNSURE
from strandcast.tracking.chain import per_axis
from strandcast.tracking.fit import CLEAR, Fit
from strandcast.tracking.follower import GOOD
from strandcast.tracking.picture import Picture, is_outside
from strandcast.tracking.pixelmap import to_pixel

SEEN_SHARE = 0.34  # of the nodes around a point that must be clear
TIP_SLIDE_PX = 4.0  # between the fitted tip and the string's visible end, from which the tip is unsure
UNSURE_M = 0.003  # sigma from which a place is unsure
FOLD_RAD = 0.7  # from a link to the next but one
FOLD_REACH_M = 0.06
LOST_M = 0.015  # sigma from which a place is no measurement
LONGEST_HIDDEN_M = 0.07  # of string whose course between seen ends is inferred
# The fit's weights are those of a stiff smoother; what is left of its own sigma where the string is seen and
# held by its tip, and what no fit sees (map, lens, edges), were measured on lab videos.
SEEN_SIGMA_SHARE = 0.2
LEAST_SIGMA_PX = 0.05
DOUBLED = 4  # nodes along another part of the chain, from which it may have been folded onto itself
SLIPPED_M = 0.0065  # of the chain's start off the clamp, from which it has a piece too much or too little


@dataclass(frozen=True)
class FrameResult:
    """The string in one frame: places (n, 2), sigmas and flags (n,) of the mass points 1 to n."""

    points_m: np.ndarray
    sigma_m: np.ndarray
    flags: np.ndarray
    value: float


def judge(fit: Fit, every: int, picture: Picture, clamp_m: np.ndarray, length_sigma_m: float) -> FrameResult:
    """Return the mass points of a fit with sigma and flags; what was not seen to the end is NaN.

    Parameters
    ----------
    fit, every
        The string, and its links per mass point.
    picture
        The frame.
    clamp_m
        Where the string leaves the clamp, (2,).
    length_sigma_m
        Standard deviation of the string's length.
    """
    points = fit.nodes()[every::every].copy()
    count = len(points)
    flags = np.zeros(count, dtype=np.int32)
    window = np.convolve((fit.reward[1:] >= CLEAR).astype(float), np.ones(every) / every, mode="same")
    seen = window[every - 1 :: every].copy()
    if fit.ball_seen:
        seen[-1] = 1.0
    flags[seen < SEEN_SHARE] |= OCCLUDED
    sigma = point_sigmas(fit, every, seen >= SEEN_SHARE, picture.plane.metre_per_pixel, length_sigma_m)
    tip_off = not abs(fit.tip_slide_m) <= TIP_SLIDE_PX * picture.plane.metre_per_pixel
    slip_m = float(np.hypot(*(fit.root - clamp_m)))
    doubtful = near_fold(fit, every)
    doubtful[-1] |= tip_off
    if slip_m > SLIPPED_M:
        sigma = np.hypot(sigma, slip_m)
    doubtful |= slip_m > SLIPPED_M or fit.doubled >= DOUBLED
    flags[doubtful] |= UNSURE
    sigma[doubtful] = np.maximum(sigma[doubtful], UNSURE_M)
    flags[sigma > UNSURE_M] |= UNSURE
    lost = (sigma > LOST_M) | in_long_gap(seen >= SEEN_SHARE, LONGEST_HIDDEN_M / (every * fit.link_m))
    lost |= outside(points, picture)
    points[lost] = np.nan
    sigma[lost] = np.nan
    flags[lost] = 0
    return FrameResult(points, sigma, flags, fit.value)


def point_sigmas(
    fit: Fit, every: int, seen: np.ndarray, metre_per_pixel: float, length_sigma_m: float
) -> np.ndarray:
    """Return sigma (n,) of the mass points, per axis (m).

    Where the tip is seen the chain hangs on it, and an error of the length is one of the points near the
    clamp; where it is not, of those near the tip, and all of the chain may have slid, as the fit's own
    covariance says.
    """
    fitted = per_axis(fit.covariances[every::every])
    count = len(fitted)
    anchored = np.isfinite(fit.tip_slide_m)
    own = np.where(seen & anchored, SEEN_SIGMA_SHARE, 1.0) * fitted
    from_tip = 1.0 - np.arange(1, count + 1) / count
    length = length_sigma_m * (from_tip if anchored else 1.0 - from_tip) / np.sqrt(2.0)
    off_end = 0.5 * fit.tip_slide_m if anchored else 0.0
    return np.sqrt(own**2 + length**2 + off_end**2 + (LEAST_SIGMA_PX * metre_per_pixel) ** 2)


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


@njit(cache=True)
def outside(points_m: np.ndarray, picture: Picture) -> np.ndarray:
    """Tell which points (n,) lie outside the part of the picture that was looked at."""
    out = np.empty(len(points_m), dtype=np.bool_)
    for k in range(len(points_m)):
        u, v = to_pixel(points_m[k, 0], points_m[k, 1], picture.plane)
        out[k] = is_outside(picture, u, v, 0.0)
    return out
