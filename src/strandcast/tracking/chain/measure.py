"""Measure a string's appearance in one frame, along a chain that was fitted to it."""

import numpy as np
from numba import njit

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.fit import FrameFit
from strandcast.tracking.chain.links import node_normals
from strandcast.tracking.chain.profiles import STEP_PX, line_score, sample_across
from strandcast.tracking.chain.search_window import SearchWindow, is_outside, levels_at
from strandcast.tracking.pixel_map import to_pixel

LEAST_CONTRAST = 5.0  # chosen: grey levels
ONE_POLARITY = 0.9  # chosen: share that must be brighter than the background for a bright string
PROFILE_HALF = 24  # samples to each side of the chain
CLEAR_NODES = 5  # at least, to measure anything


def noise_of(window: SearchWindow) -> float:
    """Return the standard deviation (grey levels) of unchanged pixels, from every fourth pixel."""
    rows, columns = window.image.shape
    behind = window.background[window.top : window.top + rows, window.left : window.left + columns]
    change = window.image[::4, ::4].astype(np.float32) - behind[::4, ::4]
    return 1.48 * float(np.median(np.abs(change)))


def measure_appearance(window: SearchWindow, fit: FrameFit, known: Appearance) -> Appearance:
    """Return `known` with half width (at half height), contrast, polarity and level as this frame shows."""
    scale, half = window.plane.metre_per_pixel, PROFILE_HALF
    nodes = fit.nodes()[2:]
    normals = node_normals(fit.heading)[2:]
    level, difference = sample_across(window, nodes, normals, STEP_PX * scale, half, 1, known.polarity)
    clear = fit.reward[2:] > 0.5
    if clear.sum() < CLEAR_NODES:
        return known
    widths = [width_at_half(profile, half) for profile in difference[clear]]
    half_m = float(np.clip(0.5 * STEP_PX * np.median(widths), 0.6, 5.0)) * scale
    line_half = np.full(len(nodes), max(1, round(half_m / scale / STEP_PX)))
    score = line_score(level, difference, line_half, known.polarity)[clear, half - 2 : half + 3].max(axis=1)
    contrast = max(float(np.median(score)), 0.5 * LEAST_CONTRAST)
    shown, behind = levels_on(window, nodes[clear])
    if len(shown) < CLEAR_NODES:
        return known
    brighter = float((shown > behind).mean())
    polarity = 1.0 if brighter > ONE_POLARITY else (-1.0 if brighter < 1 - ONE_POLARITY else 0.0)
    return known._replace(half_m=half_m, contrast=contrast, polarity=polarity, level=float(np.median(shown)))


@njit(cache=True)
def width_at_half(profile: np.ndarray, middle: int) -> float:
    """Return the width (in samples) of the peak near `middle` at half its height above the median."""
    above = profile - np.median(profile)
    peak = middle - 2 + int(np.argmax(above[middle - 2 : middle + 3]))
    level = 0.5 * above[peak]
    width = 0.0
    for step in (-1, 1):
        under = peak
        while 0 <= under < len(above) and above[under] >= level:
            under += step
        if under != peak and 0 <= under < len(above):
            steep = max(above[under - step] - above[under], 1e-9)
            width += abs(under - peak) - (level - above[under]) / steep
    return width


def levels_on(window: SearchWindow, places_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the grey levels of image and background at places (K, 2) (m) inside the window."""
    pixels = [to_pixel(x, y, window.plane) for x, y in places_m]
    both = [levels_at(window, u, v) for u, v in pixels if not is_outside(window, u, v, 0.0)]
    now, was = np.array(both).reshape(-1, 2).T
    return now, was


def level_at(window: SearchWindow, place_m: np.ndarray) -> float:
    """Return the median grey level within two pixels of a place (2,) (m)."""
    u, v = to_pixel(place_m[0], place_m[1], window.plane)
    i, j = int(v) - window.top, int(u) - window.left
    around = window.image[max(0, i - 2) : max(0, i + 3), max(0, j - 2) : max(0, j + 3)]
    return float(np.median(around)) if around.size else float("nan")
