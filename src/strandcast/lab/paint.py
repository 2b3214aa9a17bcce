"""Anti-aliased strokes and markers on a grey picture, exact to a few hundredths of a pixel.

A stroke's edge is that of a straight edge seen through a Gaussian blur of PSF_PX, computed, not sampled.
"""

import math

import numpy as np
from numba import njit

PSF_PX = 0.6  # chosen
REACH_PX = 3.0 * PSF_PX
# Sampling places within a pixel, with weights, which approximate the blur of a marker.
TAPS = np.array([(x, y) for x in (-0.9, -0.3, 0.3, 0.9) for y in (-0.9, -0.3, 0.3, 0.9)])
TAP_WEIGHTS = np.exp(-0.5 * (TAPS**2).sum(axis=1) / PSF_PX**2)
TAP_WEIGHTS /= TAP_WEIGHTS.sum()


@njit(cache=True, nogil=True)
def _edge(distance: float) -> float:
    return 0.5 * (1.0 + math.erf(distance / (1.4142135623730951 * PSF_PX)))


@njit(cache=True, nogil=True)
def stroke(cover: np.ndarray, spans: np.ndarray, line: np.ndarray, half_px: np.ndarray) -> None:
    """Cover a polyline (K, 2) [px] with half widths (K - 1,) on `cover` (H, W), 0 to 1; overlaps count once.

    `spans` (H, 2) holds the first column touched in each row, and the one after the last.
    """
    height, width = cover.shape
    for k in range(len(line) - 1):
        x0, y0, x1, y1 = line[k, 0], line[k, 1], line[k + 1, 0], line[k + 1, 1]
        half = half_px[k]
        reach = half + REACH_PX
        left, right = max(0, int(min(x0, x1) - reach)), min(width - 1, int(max(x0, x1) + reach) + 1)
        top, bottom = max(0, int(min(y0, y1) - reach)), min(height - 1, int(max(y0, y1) + reach) + 1)
        dx, dy = x1 - x0, y1 - y0
        square = dx * dx + dy * dy
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                along = 0.0
                if square > 0.0:
                    along = min(1.0, max(0.0, ((u - x0) * dx + (v - y0) * dy) / square))
                distance = math.hypot(u - x0 - along * dx, v - y0 - along * dy)
                if distance > reach:
                    continue
                value = 1.0
                if distance > half - REACH_PX:
                    value = _edge(half - distance) - _edge(-half - distance)
                if value > cover[v, u]:
                    cover[v, u] = value
                    spans[v, 0] = min(spans[v, 0], u)
                    spans[v, 1] = max(spans[v, 1], u + 1)


@njit(cache=True, nogil=True)
def blend(
    picture: np.ndarray, cover: np.ndarray, spans: np.ndarray, touched: np.ndarray, tone: float
) -> None:
    """Blend a tone into the picture where it is covered, and clear `cover` and `spans`."""
    for v in range(len(spans)):
        first, end = spans[v, 0], spans[v, 1]
        for u in range(first, end):
            a = cover[v, u]
            picture[v, u] += a * (tone - picture[v, u])
            cover[v, u] = 0.0
        if end > first:
            touched[v, 0] = min(touched[v, 0], first)
            touched[v, 1] = max(touched[v, 1], end)
        spans[v, 0], spans[v, 1] = cover.shape[1], 0


@njit(cache=True, nogil=True)
def stamp(
    picture: np.ndarray, touched: np.ndarray, to_cells: np.ndarray, corners: np.ndarray, cells: np.ndarray
) -> None:
    """Paint a printed pattern over the picture.

    Parameters
    ----------
    to_cells
        (3, 3) homography from pixels to the pattern's cells, x to the right, y down.
    corners
        (4, 2) outline [px].
    cells
        (rows, columns) tones.
    """
    height, width = picture.shape
    left, right = max(0, int(corners[:, 0].min() - 2)), min(width - 1, int(corners[:, 0].max() + 3))
    top, bottom = max(0, int(corners[:, 1].min() - 2)), min(height - 1, int(corners[:, 1].max() + 3))
    rows, columns = cells.shape
    for v in range(top, bottom + 1):
        for u in range(left, right + 1):
            shown, weight = 0.0, 0.0
            for k in range(len(TAPS)):
                x, y = u + TAPS[k, 0], v + TAPS[k, 1]
                w = to_cells[2, 0] * x + to_cells[2, 1] * y + to_cells[2, 2]
                column = math.floor((to_cells[0, 0] * x + to_cells[0, 1] * y + to_cells[0, 2]) / w)
                row = math.floor((to_cells[1, 0] * x + to_cells[1, 1] * y + to_cells[1, 2]) / w)
                if 0 <= column < columns and 0 <= row < rows:
                    shown += TAP_WEIGHTS[k] * cells[row, column]
                    weight += TAP_WEIGHTS[k]
            picture[v, u] += shown - weight * picture[v, u]
        if right >= left:
            touched[v, 0] = min(touched[v, 0], left)
            touched[v, 1] = max(touched[v, 1], right + 1)


@njit(cache=True, nogil=True)
def gather(
    total: np.ndarray, picture: np.ndarray, still: np.ndarray, touched: np.ndarray, share: float
) -> None:
    """Add one instant's difference from the still scene to the exposure, and restore the scene."""
    for v in range(len(touched)):
        for u in range(touched[v, 0], touched[v, 1]):
            total[v, u] += share * (picture[v, u] - still[v, u])
            picture[v, u] = still[v, u]
        touched[v, 0], touched[v, 1] = picture.shape[1], 0


@njit(cache=True, nogil=True)
def expose(
    light: np.ndarray,
    gain: np.ndarray,
    flicker: float,
    noise: np.ndarray,
    corner: tuple[int, int],
    noise_powers: tuple[float, float],
    out: np.ndarray,
) -> None:
    """Convert light (H, W) to a sensor's grey levels: vignetting, flicker, read and photon noise, rounding.

    Parameters
    ----------
    noise, corner
        A larger field of standard normal noise, and the corner of the region to use.
    noise_powers
        Power of read-out noise [grey²] and of photon noise [grey² per grey].
    """
    height, width = light.shape
    zero, white, half = np.float32(0.0), np.float32(255.0), np.float32(0.5)
    bright, floor, photon = np.float32(flicker), np.float32(noise_powers[0]), np.float32(noise_powers[1])
    for v in range(height):
        seen, share, row = light[v], gain[v], noise[corner[0] + v]
        for u in range(width):
            level = seen[u] * share[u] * bright
            level += np.sqrt(floor + photon * max(level, zero)) * row[corner[1] + u]
            out[v, u] = np.uint8(min(white, max(zero, level + half)))
