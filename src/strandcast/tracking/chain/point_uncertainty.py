"""Mass points of a fit, each with standard deviation and flags."""

import numpy as np
from numba import njit

from strandcast.records.track import OCCLUDED, UNSURE
from strandcast.tracking.chain.fit import CLEAR, FrameFit
from strandcast.tracking.chain.links import per_axis
from strandcast.tracking.chain.search_window import SearchWindow, is_outside
from strandcast.tracking.chain.tracker import GOOD
from strandcast.tracking.pixel_map import to_pixel

# All chosen on the drawn and lab videos of the tracking benchmark.
VISIBLE_SHARE = 0.34  # of the nodes around a point, that must be clear
TIP_SLIDE_PX = 4.0  # between the fitted tip and the string's visible end; beyond it the tip is unsure
UNSURE_M = 0.003  # sigma from which a place is unsure
FOLD_RAD = 0.7  # of a fold: bend from a link to the next but one
FOLD_REACH_M = 0.06
LOST_M = 0.015  # sigma from which a place is not a measurement
HIDDEN_REACH_M = 0.035  # of a hidden place from the visible string, up to which it is interpolated
# The fit's weights are those of a stiff smoother. The share of its own sigma that remains where the string is
# visible and held by its tip, and the floor for errors that no fit shows (map, lens, edges), were measured on
# lab videos.
VISIBLE_SIGMA_SHARE = 0.2
LEAST_SIGMA_PX = 0.05
HIDDEN_SHARE = 0.3  # chosen: standard deviation of a hidden place, in its largest distance
DOUBLED = 4  # nodes along another part of the chain: it may be folded onto itself
SLIPPED_M = 0.0065  # of the chain's start off the clamp: the chain is too long or too short by a piece
LARGEST_ACCELERATION_M_S2 = 4000.0  # chosen: more than any string reaches
LEAST_DEVIATION_M = 0.003  # chosen: from the mean of both neighbours; less may be the tracker's noise


def frame_points(
    fit: FrameFit, count: int, window: SearchWindow, clamp_m: np.ndarray, length_sigma_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (n, 2), sigmas and flags (n,) of a fit's n mass points; NaN where they are not supported.

    `clamp_m` (2,) is where the string leaves the clamp, `length_sigma_m` the uncertainty of its length.
    """
    per_point = len(fit.heading) // count
    points = fit.nodes()[per_point::per_point].copy()
    flags = np.zeros(count, dtype=np.int32)
    clear_share = np.convolve(
        (fit.reward[1:] >= CLEAR).astype(float), np.ones(per_point) / per_point, mode="same"
    )
    visible = clear_share[per_point - 1 :: per_point].copy()
    if fit.bead_found:
        visible[-1] = 1.0
    flags[visible < VISIBLE_SHARE] |= OCCLUDED
    sigma = point_sigmas(
        fit, per_point, visible >= VISIBLE_SHARE, window.plane.metre_per_pixel, length_sigma_m
    )
    reach_m = hidden_reach_m(points, fit.root, visible >= VISIBLE_SHARE, per_point * fit.link_m)
    sigma = np.hypot(sigma, HIDDEN_SHARE * reach_m)
    tip_off = not abs(fit.tip_slide_m) <= TIP_SLIDE_PX * window.plane.metre_per_pixel
    slip_m = float(np.hypot(*(fit.root - clamp_m)))
    doubtful = near_fold(fit, per_point)
    doubtful[-1] |= tip_off
    if slip_m > SLIPPED_M:
        sigma = np.hypot(sigma, slip_m)
    doubtful |= slip_m > SLIPPED_M or fit.doubled >= DOUBLED
    flags[doubtful] |= UNSURE
    sigma[doubtful] = np.maximum(sigma[doubtful], UNSURE_M)
    flags[sigma > UNSURE_M] |= UNSURE
    lost = (sigma > LOST_M) | (reach_m > HIDDEN_REACH_M)
    lost |= outside(points, window)
    points[lost] = np.nan
    sigma[lost] = np.nan
    flags[lost] = 0
    return points, sigma, flags


def point_sigmas(
    fit: FrameFit, per_point: int, visible: np.ndarray, metre_per_pixel: float, length_sigma_m: float
) -> np.ndarray:
    """Return sigma (n,) of the mass points, per axis (m).

    If the tip is visible, it anchors the chain, and an error of the length shifts the points near the clamp.
    Otherwise it shifts those near the tip, and the whole chain may have slid, as the fit's own covariance
    says.
    """
    fitted = per_axis(fit.covariances[per_point::per_point])
    count = len(fitted)
    anchored = np.isfinite(fit.tip_slide_m)
    own = np.where(visible & anchored, VISIBLE_SIGMA_SHARE, 1.0) * fitted
    from_tip = 1.0 - np.arange(1, count + 1) / count
    length = length_sigma_m * (from_tip if anchored else 1.0 - from_tip) / np.sqrt(2.0)
    off_end = 0.5 * fit.tip_slide_m if anchored else 0.0
    floor = LEAST_SIGMA_PX * metre_per_pixel
    return np.asarray(np.sqrt(own**2 + length**2 + off_end**2 + floor**2))


def near_fold(fit: FrameFit, per_point: int) -> np.ndarray:
    """Return which points (n,) may have slid along the string.

    A fold tighter than the chain's links is cut short, and its length goes to its neighbours. Where the
    string's end is not visible, the amount is unknown.
    """
    bend = np.abs(fit.heading[2:] - fit.heading[:-2])
    folds = 1 + np.flatnonzero(bend > FOLD_RAD)
    count = len(fit.heading) // per_point
    if fit.value < GOOD or (len(folds) and not np.isfinite(fit.tip_slide_m)):
        return np.ones(count, dtype=bool)
    place = np.arange(1, count + 1) * per_point
    near: np.ndarray = (np.abs(place[:, None] - folds) * fit.link_m < FOLD_REACH_M).any(axis=1)
    near[-1] = False
    return near


@njit(cache=True)
def hidden_reach_m(
    points_m: np.ndarray, root_m: np.ndarray, visible: np.ndarray, spacing_m: float
) -> np.ndarray:
    """Return how far hidden points (n,) may be from the visible string; 0 for visible ones.

    A hidden point is no farther from a visible one than the string between them is long. Between two visible
    ones, the chain's start counting as one, it is in a lens, whose half width is the bound: a taut string is
    straight, however long the hidden part.
    """
    count = len(points_m)
    reach_m = np.zeros(count)
    first = -1
    for k in range(count):
        if visible[k]:
            first = k
            continue
        last = k + 1
        while last < count and not visible[last]:
            last += 1
        before_m = (k - first) * spacing_m
        reach_m[k] = before_m
        if last < count:
            after_m = (last - k) * spacing_m
            start = root_m if first < 0 else points_m[first]
            chord_m = np.hypot(points_m[last, 0] - start[0], points_m[last, 1] - start[1])
            along_m = (chord_m**2 + before_m**2 - after_m**2) / (2.0 * max(chord_m, 1e-9))
            reach_m[k] = min(before_m, after_m)
            if 0.0 <= along_m <= chord_m:  # otherwise the lens is wider than it is there
                reach_m[k] = min(reach_m[k], np.sqrt(max(before_m**2 - along_m**2, 0.0)))
    return reach_m


@njit(cache=True)
def outside(points_m: np.ndarray, window: SearchWindow) -> np.ndarray:
    """Return which points (n,) lie outside the window."""
    out = np.empty(len(points_m), dtype=np.bool_)
    for k in range(len(points_m)):
        u, v = to_pixel(points_m[k, 0], points_m[k, 1], window.plane)
        out[k] = is_outside(window, u, v, 0.0)
    return out


def gate_accelerations(
    points_m: np.ndarray, sigma_m: np.ndarray, flags: np.ndarray, interval_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return sigma and flags (F, n + 1) of a track in which places with implausible acceleration are unsure.

    The places (F, n + 1, 2) are those of frames evenly spaced in time.
    """
    deviation_m = np.full(points_m.shape[:2], np.nan)
    half_m = 0.5 * np.linalg.norm(points_m[:-2] - 2 * points_m[1:-1] + points_m[2:], axis=2)
    deviation_m[1:-1] = half_m
    # Next to a gap, use the two frames on the other side.
    deviation_m[2:] = np.where(np.isnan(deviation_m[2:]), half_m, deviation_m[2:])
    deviation_m[:-2] = np.where(np.isnan(deviation_m[:-2]), half_m, deviation_m[:-2])
    bar_m = max(LEAST_DEVIATION_M, 0.5 * LARGEST_ACCELERATION_M_S2 * interval_s**2)
    jumps = np.nan_to_num(deviation_m) > bar_m
    flagged = np.where(jumps, flags | UNSURE, flags)
    return np.where(jumps, np.maximum(sigma_m, UNSURE_M), sigma_m), flagged
