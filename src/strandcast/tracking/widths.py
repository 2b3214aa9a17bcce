"""How wide the string is along its length, frame by frame: what hangs on it is wider than the string.

The width is the equivalent one: the change of grey level summed across the string, over the change that the
string's own grey level makes. Motion and lens spread an edge without changing that sum, so no blur has to be
known; and what stands behind the string cancels.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from strandcast.tracking.picture import Picture, is_outside, levels_at
from strandcast.tracking.pixelmap import to_pixel

PITCH_PX = 0.5  # between places along the string, and between samples across it
HALF_M, HALF_PX = 0.02, 4.0  # how far to each side something may reach: the larger of both
FLANK_PX = 5.0  # beyond it, where there must be background
LEAST_SHARE = 0.35  # of the string's usual contrast, under which the background is too like the string
MOST_FLANK = 0.15  # of the string's contrast, that the flanks may have changed
MOST_TILT = 0.25  # by which the flanks may differ from each other
BEYOND_M = 0.04  # how far beyond the tip is looked
STEP_PX = 3.0  # that the string must move between frames that count as two
CLEAR = 0.5  # mean quality of the nodes of a frame that is read
WORSE = 0.15  # than the median frame's quality, at most
MOST_FRAMES = 80


def choose_frames(nodes_m: np.ndarray, quality: np.ndarray, metre_per_pixel: float) -> np.ndarray:
    """Return the frames in which the string is seen well, each at another place than the one before.

    Parameters
    ----------
    nodes_m
        The tracked chain (F, M + 1, 2) [m], NaN where it was not found.
    quality
        How well each node is seen (F, M + 1), 0 to 1.
    metre_per_pixel
        Scale of the picture.
    """
    seen = np.isfinite(nodes_m).all(axis=(1, 2))
    mean = np.where(seen, np.nan_to_num(quality).mean(axis=1), 0.0)
    least = max(CLEAR, float(np.median(mean[seen])) - WORSE) if seen.any() else np.inf
    chosen: list[int] = []
    for frame in np.flatnonzero(mean >= least):
        if chosen:
            moved = np.linalg.norm(nodes_m[frame] - nodes_m[chosen[-1]], axis=1)
            if np.sqrt((moved**2).mean()) < STEP_PX * metre_per_pixel:
                continue
        chosen.append(int(frame))
    if not chosen:
        return np.zeros(0, dtype=np.int64)
    spread = np.linspace(0, len(chosen) - 1, MOST_FRAMES).round().astype(int)
    return np.asarray(chosen, dtype=np.int64)[np.unique(spread)]


def places_along(length_m: float, metre_per_pixel: float) -> np.ndarray:
    """Return the places (K,) [m] along the string at which it is looked at, and beyond its tip."""
    return np.arange(0.0, length_m + BEYOND_M, PITCH_PX * metre_per_pixel)


@njit(cache=True)
def widths_along(
    picture: Picture, nodes: np.ndarray, places_m: np.ndarray, level: float, contrast: float
) -> np.ndarray:
    """Return the string's equivalent width (K,) [m] at places along it; NaN where it is not in the open.

    Parameters
    ----------
    picture
        The frame.
    nodes
        The chain in this frame, (M + 1, 2) m, of equal links. Beyond its tip it is thought to go on straight.
    places_m
        (K,), from the clamp on.
    level, contrast
        The string's own grey level, and its usual difference from the background.
    """
    plane = picture.plane
    pitch_m = PITCH_PX * plane.metre_per_pixel
    links = len(nodes) - 1
    link_m = np.hypot(nodes[1, 0] - nodes[0, 0], nodes[1, 1] - nodes[0, 1])
    half = int(np.ceil(max(HALF_M / pitch_m, HALF_PX / PITCH_PX)))
    flank = int(FLANK_PX / PITCH_PX)
    samples = np.empty(2 * (half + flank) + 1)
    widths = np.full(len(places_m), np.nan)
    reach_px = (half + flank) * PITCH_PX + 1.0
    for k in range(len(places_m)):
        link = min(int(places_m[k] / link_m), links - 1)
        way_x = (nodes[link + 1, 0] - nodes[link, 0]) / link_m
        way_y = (nodes[link + 1, 1] - nodes[link, 1]) / link_m
        along_m = places_m[k] - link * link_m
        x, y = nodes[link, 0] + along_m * way_x, nodes[link, 1] + along_m * way_y
        u0, v0 = to_pixel(x, y, plane)
        if is_outside(picture, u0, v0, reach_px):
            continue
        u1, v1 = to_pixel(x - pitch_m * way_y, y + pitch_m * way_x, plane)
        good = True
        for w in range(len(samples)):
            u, v = u0 + (w - half - flank) * (u1 - u0), v0 + (w - half - flank) * (v1 - v0)
            now, behind = levels_at(picture, u, v)
            if abs(level - behind) < LEAST_SHARE * contrast:
                good = False
                break
            samples[w] = (now - behind) / (level - behind)
        if not good:
            continue
        left, right = samples[:flank].mean(), samples[-flank:].mean()
        if abs(left + right) < 2 * MOST_FLANK and abs(left - right) < MOST_TILT:
            middle = samples[flank:-flank]
            widths[k] = (middle.mean() - 0.5 * (left + right)) * len(middle) * pitch_m
    return widths
