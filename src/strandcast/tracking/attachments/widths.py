"""The string's width along its length, frame by frame: a weight or a section is wider than the string.

It is the equivalent width: the change of grey level summed across the string, divided by the change that the
string's own grey level makes. Motion and lens spread an edge without changing that sum, so the blur need not
be known; the background cancels.
"""

import numpy as np
from numba import njit

from strandcast.tracking.chain.search_window import SearchWindow, add_levels, corner_levels, is_outside
from strandcast.tracking.pixel_map import to_pixel

PITCH_PX = 0.5  # between places along the string, and between samples across it
HALF_M, HALF_PX = 0.02, 4.0  # an attachment's largest reach to each side: the larger of both
FLANK_PX = 5.0  # of background beyond that reach
LEAST_SHARE = 0.35  # of the string's usual contrast; below it the background is too similar to the string
MOST_FLANK = 0.15  # largest change of the flanks, relative to the string's contrast
MOST_TILT = 0.25  # largest difference between the flanks
BEYOND_M = 0.04  # measured beyond the tip
STEP_PX = 3.0  # least motion of the string between two chosen frames
CLEAR = 0.5  # least mean quality of a chosen frame's nodes
WORSE = 0.15  # largest shortfall from the median frame's quality
MOST_FRAMES = 80


def choose_frames(nodes_m: np.ndarray, quality: np.ndarray, metre_per_pixel: float) -> np.ndarray:
    """Return the frames that show the string clearly, each at another place than the one before.

    `nodes_m` (F, M + 1, 2) is the tracked chain, NaN where it was not found; `quality` (F, M + 1), 0 to 1,
    shows how clearly each node is visible.
    """
    tracked = np.isfinite(nodes_m).all(axis=(1, 2))
    mean = np.where(tracked, np.nan_to_num(quality).mean(axis=1), 0.0)
    least = max(CLEAR, float(np.median(mean[tracked])) - WORSE) if tracked.any() else np.inf
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
    return np.asarray(np.asarray(chosen, dtype=np.int64)[np.unique(spread)])


def places_along(length_m: float, metre_per_pixel: float) -> np.ndarray:
    """Return the measured places (K,) [m] along the string and beyond its tip."""
    return np.arange(0.0, length_m + BEYOND_M, PITCH_PX * metre_per_pixel)


@njit(cache=True)
def widths_along(
    window: SearchWindow, nodes: np.ndarray, places_m: np.ndarray, level: float, contrast: float
) -> np.ndarray:
    """Return the string's equivalent width (K,) [m] at places (K,) from the clamp; NaN where it is hidden.

    The chain in this frame, `nodes` (M + 1, 2) [m], has equal links; beyond its tip it continues straight.
    `level` is the string's grey level, `contrast` its usual difference from the background.
    """
    plane = window.plane
    pitch_m = PITCH_PX * plane.metre_per_pixel
    links = len(nodes) - 1
    link_m = np.hypot(nodes[1, 0] - nodes[0, 0], nodes[1, 1] - nodes[0, 1])
    half = int(np.ceil(max(HALF_M / pitch_m, HALF_PX / PITCH_PX)))
    flank = int(FLANK_PX / PITCH_PX)
    samples = np.empty(2 * (half + flank) + 1)
    u, v = np.empty(len(samples)), np.empty(len(samples))
    now, behind = np.empty(len(samples)), np.empty(len(samples))
    corners = corner_levels(window, len(samples))
    widths = np.full(len(places_m), np.nan)
    reach_px = (half + flank) * PITCH_PX + 1.0
    for k in range(len(places_m)):
        link = min(int(places_m[k] / link_m), links - 1)
        along_x = (nodes[link + 1, 0] - nodes[link, 0]) / link_m
        along_y = (nodes[link + 1, 1] - nodes[link, 1]) / link_m
        along_m = places_m[k] - link * link_m
        x, y = nodes[link, 0] + along_m * along_x, nodes[link, 1] + along_m * along_y
        u0, v0 = to_pixel(x, y, plane)
        if is_outside(window, u0, v0, reach_px):
            continue
        u1, v1 = to_pixel(x - pitch_m * along_y, y + pitch_m * along_x, plane)
        for w in range(len(samples)):
            u[w], v[w] = u0 + (w - half - flank) * (u1 - u0), v0 + (w - half - flank) * (v1 - v0)
            now[w] = behind[w] = 0.0
        add_levels(window, u, v, 1.0, now, behind, corners)
        least = np.inf
        for w in range(len(samples)):
            depth = level - behind[w]
            least = min(least, abs(depth))
            samples[w] = (now[w] - behind[w]) / depth if depth != 0 else 0.0
        if least < LEAST_SHARE * contrast:
            continue
        left, right = samples[:flank].mean(), samples[-flank:].mean()
        if abs(left + right) < 2 * MOST_FLANK and abs(left - right) < MOST_TILT:
            middle = samples[flank:-flank]
            widths[k] = (middle.mean() - 0.5 * (left + right)) * len(middle) * pitch_m
    return widths
