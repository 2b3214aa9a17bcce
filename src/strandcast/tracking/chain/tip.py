"""The string's visible end, or that of the bead at its tip, along the chain and beyond."""

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.constraints import NO_TIP, Tip
from strandcast.tracking.chain.profiles import STEP_PX, sample_across
from strandcast.tracking.chain.search_window import SearchWindow, is_outside, levels_at
from strandcast.tracking.pixel_map import to_pixel

# All chosen on the drawn and lab videos of the tracking benchmark.
TIP_REACH_M = 0.018  # from the predicted tip, within which the string's end is searched
TIP_PX = 1.0  # standard deviation of the end's place along the string
ALONG_PX = 0.5  # between places along the string
WIDEST_PX = 14.0  # half width of the widest bead
LEAST_INSIDE = 0.4  # of a clear line, that the string must reach before its end
EDGE_PX = 4.0  # from the window's edge, within which no end is accepted
MOST_CHANGED = 1.5  # clear lines; in front of a darker background, a bright string changes more
END_PX = 5.0  # largest distance from the chain's tip to the string's visible end
# Distance of its centre from the end, in its own radii and pixels, up to which a bead reaches to the end.
REACHES, REACHES_PX = 1.2, 1.0
LEAST_DEPTH = 0.45  # of the usual difference between string and background, below which no end is visible
BEAD_TIMES = 1.6  # wider than this, in the string's own widths plus a pixel, is a bead at the tip
# A bead, or a side of it, that changes the image less than half of what the string does is seen by more than
# this share of that half, and this many times the noise.
PALE, PALE_NOISE = 0.4, 5.0
PALE_RIM_PX, PALE_TAIL_PX = 1.0, 3.0  # so much wider or longer than the rest; blur makes up to a pixel
OUTSIDE_RUN = 4  # places without string that make an end
BAND = 4  # samples to each side of the chain, within which the string is


class FoundEnd(NamedTuple):
    """The string's end along the chain and beyond its tip."""

    end_m: float  # beyond the tip, negative before it; NaN if it was not found
    last: int  # the last place of the walk on the string
    threshold: float  # grey levels by which the image has changed there
    places: np.ndarray  # of the walk, (K, 2)
    normals: np.ndarray  # (K, 2)


@njit(cache=True, inline="always")
def locate_tip(window: SearchWindow, nodes: np.ndarray, heading: np.ndarray, appearance: Appearance) -> Tip:
    """Return how far the tip should move to the string's visible end."""
    end_m = end_beyond_tip(window, nodes, heading, appearance, TIP_REACH_M + appearance.tip_excess_m).end_m
    if not np.isfinite(end_m):
        return NO_TIP
    return Tip(end_m - appearance.tip_excess_m, 1.0 / (TIP_PX * window.plane.metre_per_pixel) ** 2)


@njit(cache=True, inline="always")
def ends_at_tip(window: SearchWindow, nodes: np.ndarray, heading: np.ndarray, appearance: Appearance) -> bool:
    """Return whether the string, or the bead at its tip, visibly ends where the chain does."""
    end_m = end_beyond_tip(window, nodes, heading, appearance, TIP_REACH_M + appearance.tip_excess_m).end_m
    return bool(abs(end_m - appearance.tip_excess_m) < END_PX * window.plane.metre_per_pixel)


@njit(cache=True)
def end_of_string(
    window: SearchWindow, nodes: np.ndarray, heading: np.ndarray, appearance: Appearance, reach_m: float
) -> tuple[float, float]:
    """Return how far beyond the tip the string ends (m, negative before it), and its half width (px).

    As in `end_beyond_tip`, but a bead may change the image less than the string does; the width is the
    largest near the end, or that of the bare string beyond a bead that does not reach to the end.
    """
    end = end_beyond_tip(window, nodes, heading, appearance, reach_m)
    if not np.isfinite(end.end_m):
        return np.nan, np.nan
    around = int(2 * WIDEST_PX / ALONG_PX)
    first, after = max(0, end.last - around), end.last + 1 + around
    places, normals = end.places[first:after], end.normals[first:after]
    pitch_m, half = STEP_PX * window.plane.metre_per_pixel, int(np.ceil(WIDEST_PX / STEP_PX))
    _, difference = sample_across(window, places, normals, pitch_m, half, 0, appearance.polarity)
    last, pale = end.last - first, max(PALE_NOISE * appearance.noise, PALE * end.threshold)
    width_px, _ = widest_before(difference[: last + 1], end.threshold)
    further = last_above(best_in_band(difference[:, half - BAND : half + BAND + 1]), pale)
    pale_px, string_px = widest_before(difference[: further + 1], pale)
    beyond_px = (further - last) * ALONG_PX
    is_bead = (
        pale_px > BEAD_TIMES * string_px + 1.0 and beyond_px < 2.0 * pale_px + string_px
    )  # as long as wide
    if is_bead and (pale_px > width_px + PALE_RIM_PX or beyond_px > PALE_TAIL_PX):
        return end.end_m + beyond_px * window.plane.metre_per_pixel, pale_px
    return end.end_m, width_px


@njit(cache=True)
def widest_before(difference: np.ndarray, threshold: float) -> tuple[float, float]:
    """Return half the largest width of profiles (K, W) and their median.

    The first is that of the last ones if the widest is not at the end.
    """
    half_px = np.empty(len(difference))
    for i in range(len(difference)):
        half_px[i] = 0.5 * STEP_PX * (difference[i] > threshold).sum()
    widest = half_px.max()
    centre = np.median(np.flatnonzero(half_px == widest))
    bare = int(centre + (REACHES * widest + REACHES_PX) / ALONG_PX)
    return widest if bare >= len(half_px) else half_px[bare:].max(), float(np.median(half_px))


@njit(cache=True)
def end_beyond_tip(
    window: SearchWindow, nodes: np.ndarray, heading: np.ndarray, appearance: Appearance, reach_m: float
) -> FoundEnd:
    """Return where the string ends beyond the chain's tip.

    Walks along the chain's end and straight on until the image is the background again; NaN where that is not
    within `reach_m` of the tip, or not clear.
    """
    contrast, scale = appearance.contrast, window.plane.metre_per_pixel
    pitch_m = ALONG_PX * scale
    places, normals, before = walk_past_tip(nodes, heading, reach_m, pitch_m)
    not_found = FoundEnd(np.nan, 0, np.nan, places, normals)
    _, difference = sample_across(window, places, normals, STEP_PX * scale, BAND, 0, appearance.polarity)
    changed = best_in_band(difference)
    clear = scale_to_background(window, places, changed, appearance)
    changed = np.minimum(changed, MOST_CHANGED * contrast)
    inside = np.median(changed[: max(3, before // 2)])
    if inside < LEAST_INSIDE * contrast:
        return not_found
    threshold = 0.5 * inside
    last = last_above(changed, threshold)
    if last < 1 or last >= len(changed) - OUTSIDE_RUN:
        return not_found
    u, v = to_pixel(places[last + 1, 0], places[last + 1, 1], window.plane)
    if is_outside(window, u, v, EDGE_PX):
        return not_found  # it leaves the window instead of ending
    if not clear[last : last + 1 + OUTSIDE_RUN].all():
        return not_found
    fraction = (changed[last] - threshold) / max(changed[last] - changed[last + 1], 1e-9)
    end_m = (last + min(max(fraction, 0.0), 1.0) - before) * pitch_m
    return FoundEnd(end_m, last, threshold, places, normals)


@njit(cache=True)
def walk_past_tip(
    nodes: np.ndarray, heading: np.ndarray, reach_m: float, pitch_m: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return places (K, 2) along the chain's end and straight on, normals, and which place is the tip."""
    links = len(heading)
    link_m = np.hypot(nodes[-1, 0] - nodes[-2, 0], nodes[-1, 1] - nodes[-2, 1])
    before = int(min(np.ceil(reach_m / link_m), links - 1) * link_m / pitch_m)
    count = before + int(reach_m / pitch_m)
    places = np.empty((count, 2))
    normals = np.empty((count, 2))
    for i in range(count):
        beyond_m = (i - before) * pitch_m
        k = min(max(links + int(np.floor(beyond_m / link_m)), 0), links - 1)
        along_m = beyond_m - (k - links) * link_m
        places[i, 0] = nodes[k, 0] + along_m * np.cos(heading[k])
        places[i, 1] = nodes[k, 1] + along_m * np.sin(heading[k])
        normals[i, 0], normals[i, 1] = -np.sin(heading[k]), np.cos(heading[k])
    return places, normals, before


@njit(cache=True)
def best_in_band(difference: np.ndarray) -> np.ndarray:
    """Return each profile's largest mean of three neighbours: the chain may be off."""
    best = np.zeros(len(difference))
    for i in range(len(difference)):
        for w in range(1, difference.shape[1] - 1):
            value = (difference[i, w - 1] + difference[i, w] + difference[i, w + 1]) / 3.0
            best[i] = max(best[i], value)
    return best


@njit(cache=True)
def scale_to_background(
    window: SearchWindow, places: np.ndarray, changed: np.ndarray, appearance: Appearance
) -> np.ndarray:
    """Scale changes (K,) to the usual background, in place; return where that is possible (K,).

    In front of a background nearly as grey as the string, the string changes the image less.
    """
    clear = np.ones(len(places), dtype=np.bool_)
    if not np.isfinite(appearance.level):
        return clear
    depth = np.empty(len(places))
    for i in range(len(places)):
        u, v = to_pixel(places[i, 0], places[i, 1], window.plane)
        depth[i] = appearance.level - levels_at(window, u, v)[1]
        if appearance.polarity != 0:
            depth[i] = max(0.0, appearance.polarity * depth[i])
        depth[i] = abs(depth[i])
    usual = np.median(depth)
    for i in range(len(places)):
        clear[i] = depth[i] > LEAST_DEPTH * usual
        if clear[i]:
            changed[i] *= usual / depth[i]
    return clear


@njit(cache=True)
def last_above(values: np.ndarray, threshold: float) -> int:
    """Return the last place at or above the threshold before the first `OUTSIDE_RUN` below it, or -1."""
    last, run = -1, 0
    for i in range(len(values)):
        if values[i] >= threshold:
            last, run = i, 0
        else:
            run += 1
            if run == OUTSIDE_RUN:
                break
    return last
