"""A string's centreline, measured to a fraction of a pixel and bridged stiffly at crossings."""

import numpy as np
from numba import njit
from scipy.linalg import solveh_banded

EDGE_LEVEL = 0.5  # level at the string's edge, as a share of its own level: half maximum
STEP_PX = 0.5  # between samples across the string; chosen, not sensitive


def even_line(points: np.ndarray, spacing_px: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return points (K, 2) evenly spaced along a polyline (N, 2), and their places (K,) in it, 0 to N - 1."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.r_[0.0, np.cumsum(lengths)]
    kept = np.r_[True, lengths > 1e-9]
    count = max(2, round(along[-1] / spacing_px) + 1)
    wanted = np.linspace(0.0, along[-1], count)
    place = np.interp(wanted, along[kept], np.flatnonzero(kept).astype(float))
    return np.column_stack([np.interp(wanted, along[kept], points[kept, c]) for c in (0, 1)]), place


def smooth(points: np.ndarray, weight: np.ndarray, length_px: float) -> np.ndarray:
    """Return the smooth line (K, 2) close to the weighted points that bends least where they have no weight.

    Whittaker smoother: least squares with squared second differences weighted by `length_px`⁴, for points one
    pixel apart. Waves shorter than six lengths are damped; without weights the line is an unloaded beam.
    """
    count = len(points)
    if count < 5:
        return points
    stiffness = max(length_px, 0.1) ** 4
    bands = np.zeros((3, count))
    second = np.array([1.0, -2.0, 1.0])
    for i in range(3):
        for j in range(i, 3):
            # D'D of the second differences D: upper bands.
            bands[2 - (j - i), j : count - 2 + j] += stiffness * second[i] * second[j]
    bands[2] += np.maximum(weight, 1e-9)
    return np.asarray(solveh_banded(bands, np.maximum(weight, 1e-9)[:, None] * points))


def normals(line: np.ndarray) -> np.ndarray:
    """Return the unit normals (K, 2) of a line: its direction rotated by +90°."""
    along = np.gradient(line, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return np.column_stack([-along[:, 1], along[:, 0]])


def measure_across(field: np.ndarray, line: np.ndarray, half_width: float) -> tuple[np.ndarray, np.ndarray]:
    """Measure a string's centre and width across a line.

    The edges are where the field falls to half the string's own level, the mean over the inner half of its
    width; the centre is midway between them.

    Parameters
    ----------
    field
        (height, width) float32: contrast of the picture, or a mask of zeros and ones.
    line
        (K, 2) px, near the centreline.
    half_width
        Of the string, px.

    Returns
    -------
    offset : ndarray (K,)
        Of the centre along the line's normal, px; NaN where fewer than two edges are found within two widths.
    width : ndarray (K,)
        Between the edges, px; NaN in the same places.
    """
    offset, width = _measure_across(field, line, normals(line), half_width, 4.0 * half_width + 2.0)
    return offset, width


@njit(cache=True)
def _measure_across(
    field: np.ndarray, line: np.ndarray, normal: np.ndarray, half_width: float, reach_px: float
) -> tuple[np.ndarray, np.ndarray]:
    count = len(line)
    offset, width = np.full(count, np.nan), np.full(count, np.nan)
    inner = max(1, int(0.5 * half_width / STEP_PX))
    for k in range(count):
        level = 0.0
        for i in range(-inner, inner + 1):
            o = i * STEP_PX
            level += sample(field, line[k, 0] + o * normal[k, 0], line[k, 1] + o * normal[k, 1])
        level *= EDGE_LEVEL / (2 * inner + 1)
        if level <= 0.0:
            continue
        edges = np.empty(2)
        for side in range(2):
            sign = 2.0 * side - 1.0
            edges[side] = np.nan
            before = sample(field, line[k, 0], line[k, 1])
            if before < level:
                continue
            o = 0.0
            while o < reach_px:
                o += STEP_PX
                x, y = line[k, 0] + sign * o * normal[k, 0], line[k, 1] + sign * o * normal[k, 1]
                if x < 0 or y < 0 or x > field.shape[1] - 1 or y > field.shape[0] - 1:
                    break  # the border of the picture is not an edge of the string
                now = sample(field, x, y)
                if now < level:
                    edges[side] = sign * (o - STEP_PX * (level - now) / max(before - now, 1e-9))
                    break
                before = now
        offset[k] = 0.5 * (edges[0] + edges[1])
        width[k] = edges[1] - edges[0]
    return offset, width


@njit(cache=True)
def sample(field: np.ndarray, x: float, y: float) -> float:
    """Return the bilinear interpolation of a field (height, width) at a place in px; 0 outside."""
    j, i = int(np.floor(x)), int(np.floor(y))
    if i < -1 or j < -1 or i >= field.shape[0] or j >= field.shape[1]:
        return 0.0
    value = 0.0
    for r in range(2):
        for c in range(2):
            if 0 <= i + r < field.shape[0] and 0 <= j + c < field.shape[1]:
                share = (1.0 - abs(y - i - r)) * (1.0 - abs(x - j - c))
                value += share * field[i + r, j + c]
    return value
