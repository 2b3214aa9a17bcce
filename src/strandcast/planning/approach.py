"""How near simulated paths come to places: kernels."""

import math
from collections.abc import Callable

import numpy as np
from numba import njit

from strandcast.threads import over_ranges

Approaches = tuple[np.ndarray, np.ndarray]  # (B,) least distances [m], and (B,) the samples after them


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


def approaches(kernel: Callable[..., None], count: int, *given: object) -> Approaches:
    """Return what a kernel finds: (B,) least distances or infinity, and (B,) the samples after them."""
    miss, index = np.full(count, np.inf), np.zeros(count, np.int64)
    over_ranges(count, lambda first, last: kernel(first, last, *given, miss, index))
    return miss, index


def closest_approaches(paths: np.ndarray, last: np.ndarray, target: np.ndarray) -> Approaches:
    """Return the closest approaches of paths (B, T, 2 or 3) to a place (2 or 3,)."""
    return approaches(_closest_approaches, len(paths), np.ascontiguousarray(paths), last, target)


def bar_approaches(tips: np.ndarray, last: np.ndarray, ends: np.ndarray) -> Approaches:
    """Return the closest approaches of tips (B, T, 2) to a bar (2, 2)."""
    return approaches(_bar_approaches, len(tips), tips, last, ends)


@njit(cache=True, nogil=True)
def _closest_approaches(
    first: int,
    end: int,
    paths: np.ndarray,
    last: np.ndarray,
    target: np.ndarray,
    miss: np.ndarray,
    index: np.ndarray,
) -> None:
    for b in range(first, end):
        for t in range(1, last[b] + 1):
            square, along = 0.0, 0.0
            for axis in range(len(target)):
                step = paths[b, t, axis] - paths[b, t - 1, axis]
                square += step * step
                along += (target[axis] - paths[b, t - 1, axis]) * step
            share = min(1.0, max(0.0, along / square)) if square > 0.0 else 0.0
            away2 = 0.0
            for axis in range(len(target)):
                before = paths[b, t - 1, axis]
                off = target[axis] - before - share * (paths[b, t, axis] - before)
                away2 += off * off
            away = math.sqrt(away2)
            if away < miss[b]:
                miss[b], index[b] = away, t


@njit(cache=True, nogil=True)
def _bar_approaches(
    first: int,
    end: int,
    tips: np.ndarray,
    last: np.ndarray,
    ends: np.ndarray,
    miss: np.ndarray,
    index: np.ndarray,
) -> None:
    for b in range(first, end):
        for t in range(1, last[b] + 1):
            away = bar_distance(tips[b, t - 1], tips[b, t], ends[0], ends[1])
            if away < miss[b]:
                miss[b], index[b] = away, t
