"""How near simulated paths come to places: kernels."""

import math

import numpy as np
from numba import njit, prange


@njit(cache=True)
def segment_distance(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Distance of point p to the segment from a to b."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    s = 0.0
    if length2 > 0.0:
        s = min(1.0, max(0.0, ((px - ax) * dx + (py - ay) * dy) / length2))
    x, y = px - ax - s * dx, py - ay - s * dy
    return math.sqrt(x * x + y * y)


@njit(cache=True)
def bar_distance(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> float:
    """Distance between the segments from a to b and from c to d."""
    if _side(a, b, c) * _side(a, b, d) < 0.0 and _side(c, d, a) * _side(c, d, b) < 0.0:
        return 0.0
    return min(
        segment_distance(a[0], a[1], c[0], c[1], d[0], d[1]),
        segment_distance(b[0], b[1], c[0], c[1], d[0], d[1]),
        segment_distance(c[0], c[1], a[0], a[1], b[0], b[1]),
        segment_distance(d[0], d[1], a[0], a[1], b[0], b[1]),
    )


@njit(cache=True)
def _side(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> float:
    """On which side of the line from a to b a place is: above 0 on its left."""
    result: float = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
    return result


@njit(cache=True)
def closest_approach(tip: np.ndarray, last: int, x: float, y: float) -> tuple[float, int]:
    """Least distance of the target to the path of tip (T, 2) up to sample `last`, and the sample after it."""
    best, index = np.inf, 0
    for t in range(1, last + 1):
        d = segment_distance(x, y, tip[t - 1, 0], tip[t - 1, 1], tip[t, 0], tip[t, 1])
        if d < best:
            best, index = d, t
    return best, index


@njit(cache=True, parallel=True)
def closest_approaches(
    paths: np.ndarray, last: np.ndarray, x: float, y: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return (B,) least distances of a place to paths (B, T, 2), and (B,) the samples after them."""
    miss, index = np.empty(len(paths)), np.empty(len(paths), np.int64)
    for b in prange(len(paths)):
        miss[b], index[b] = closest_approach(paths[b], last[b], x, y)
    return miss, index


@njit(cache=True, parallel=True)
def tip_approaches(
    points: np.ndarray, tip_bias: np.ndarray, last: np.ndarray, x: float, y: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the closest approaches of the tips of strings (B, T, n+1, 2), bias (B, T, 2) added."""
    miss, index = np.empty(len(points)), np.empty(len(points), np.int64)
    for b in prange(len(points)):
        tip = points[b, :, -1, :] + tip_bias[b]
        miss[b], index[b] = closest_approach(tip, last[b], x, y)
    return miss, index


@njit(cache=True, parallel=True)
def bar_approaches(tips: np.ndarray, last: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (B,) least distances of tips (B, T, 2) to a bar (2, 2), and (B,) the samples after them."""
    miss, index = np.full(len(tips), np.inf), np.zeros(len(tips), np.int64)
    for b in prange(len(tips)):
        for t in range(1, last[b] + 1):
            away = bar_distance(tips[b, t - 1], tips[b, t], ends[0], ends[1])
            if away < miss[b]:
                miss[b], index[b] = away, t
    return miss, index
