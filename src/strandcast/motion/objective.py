"""What a simulated throw is worth: how near the tip's path comes to the target, and at what price."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange


class Assessment(NamedTuple):
    """What is told of B throws.

    Attributes
    ----------
    miss_m
        (B,) least distance between the target and the tip's path (segments between samples) [m].
    hit_index
        (B,) the sample after the closest approach.
    fold
        (B,) 1 - cos of the largest bend between neighbouring segments until then.
    outside_m
        (B,) how far hand or string leave the box, at any time in the window [m].
    touch_m
        (B,) how deep the string, the hand's neighbours aside, comes into the arm's bars until the closest
        approach [m].
    hidden_m
        (B,) how deep the string's last third is in the bars around the closest approach [m].
    tip_speed_m_s
        (B,) speed of the tip at the closest approach.
    """

    miss_m: np.ndarray
    hit_index: np.ndarray
    fold: np.ndarray
    outside_m: np.ndarray
    touch_m: np.ndarray
    hidden_m: np.ndarray
    tip_speed_m_s: np.ndarray


# Points this near the hand along the string cannot be far from the last link.
NEIGHBOURS = 2
# The camera must see the tip this long before and after the closest approach.
SEEN_S = 0.02
# No cord is stretched more: a model that is tells nothing of where the string will be.
STRETCHED = 1.1


@njit(cache=True)
def segment_distance(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Distance of point p to the segment from a to b."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    s = 0.0
    if length2 > 0.0:
        s = min(1.0, max(0.0, ((px - ax) * dx + (py - ay) * dy) / length2))
    return np.hypot(px - ax - s * dx, py - ay - s * dy)


@njit(cache=True)
def closest_approach(tip: np.ndarray, last: int, x: float, y: float) -> tuple[float, int]:
    """Least distance of the target to the path of tip (T, 2) up to sample `last`, and the sample after it."""
    best, index = np.inf, 0
    for t in range(1, last + 1):
        d = segment_distance(x, y, tip[t - 1, 0], tip[t - 1, 1], tip[t, 0], tip[t, 1])
        if d < best:
            best, index = d, t
    return best, index


@njit(cache=True)
def largest_fold(points: np.ndarray, last: int) -> float:
    """1 - cos of the largest bend between neighbouring segments of (T, n+1, 2) up to sample `last`."""
    least = 1.0
    for t in range(last + 1):
        for i in range(1, points.shape[1] - 1):
            ax, ay = points[t, i, 0] - points[t, i - 1, 0], points[t, i, 1] - points[t, i - 1, 1]
            bx, by = points[t, i + 1, 0] - points[t, i, 0], points[t, i + 1, 1] - points[t, i, 1]
            lengths = np.sqrt((ax * ax + ay * ay) * (bx * bx + by * by))
            if lengths > 0.0:
                least = min(least, (ax * bx + ay * by) / lengths)
    return 1.0 - least


@njit(cache=True)
def deepest_outside(points: np.ndarray, last: int, box: np.ndarray) -> float:
    """How far the points (T, n+1, 2) leave the box ((x, y), (low, high)) up to sample `last`, 0 if not."""
    worst = 0.0
    for t in range(last + 1):
        for i in range(points.shape[1]):
            for axis in range(2):
                place = points[t, i, axis]
                worst = max(worst, box[axis, 0] - place, place - box[axis, 1])
    return worst


@njit(cache=True)
def deepest_touch(
    points: np.ndarray, bars: np.ndarray, radius_m: np.ndarray, nearest_point: int, first: int, last: int
) -> float:
    """How deep points (T, n+1, 2) from `nearest_point` on are in bars (T, S, 2, 2), `first` to `last`."""
    deepest = 0.0
    for t in range(first, last + 1, 2):
        for i in range(nearest_point, points.shape[1]):
            x, y = points[t, i, 0], points[t, i, 1]
            for j in range(bars.shape[1]):
                one, other = bars[t, j, 0], bars[t, j, 1]
                away = segment_distance(x, y, one[0], one[1], other[0], other[1])
                deepest = max(deepest, radius_m[j] - away)
    return deepest


@njit(cache=True)
def unstretched(points: np.ndarray, spacing_m: float) -> np.ndarray:
    """Points (T, n+1, 2) with the same directions and no segment longer than a cord's can be."""
    laid = points.copy()
    for t in range(points.shape[0]):
        for i in range(1, points.shape[1]):
            dx, dy = points[t, i, 0] - points[t, i - 1, 0], points[t, i, 1] - points[t, i - 1, 1]
            share = min(1.0, STRETCHED * spacing_m / max(np.hypot(dx, dy), 1e-300))
            laid[t, i, 0] = laid[t, i - 1, 0] + share * dx
            laid[t, i, 1] = laid[t, i - 1, 1] + share * dy
    return laid


@njit(cache=True, parallel=True)
def assess(
    points: np.ndarray,
    shift: np.ndarray,
    bars: np.ndarray,
    radius_m: np.ndarray,
    last: np.ndarray,
    target_m: np.ndarray,
    box: np.ndarray,
    spacing_m: float,
    step_s: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Assess B = P * K throws: P motions, each with K strings (motion by motion).

    Parameters
    ----------
    points
        (B, T, n+1, 2) hand and string [m].
    shift
        (B, T, 2) what is added to the tip for the miss [m].
    bars, radius_m
        (P, T, S, 2, 2) ends of the arm's bars and (S,) how near to them the string may come [m].
    last
        (P,) last sample of the miss's window.
    target_m
        (2,).
    box
        (2, 2) low and high of x and y that nothing should leave [m].
    spacing_m
        Rest length of a segment: place and touch are judged of a string that does not stretch.
    step_s
        Time between samples.

    Returns
    -------
    The fields of `Assessment`. A throw that is not finite has miss, outside, touch and hidden of a metre.
    """
    count = points.shape[0]
    strings = count // bars.shape[0]
    miss, fold, outside = np.ones(count), np.zeros(count), np.ones(count)
    touch, hidden, speed = np.ones(count), np.ones(count), np.zeros(count)
    index = np.zeros(count, np.int64)
    around = round(SEEN_S / step_s)
    last_third = points.shape[2] - max(points.shape[2] // 3, 1)
    for b in prange(count):
        p = b // strings
        end = last[p]
        if not np.isfinite(points[b, : end + 1]).all():
            continue
        tip = points[b, :, -1, :] + shift[b]
        miss[b], index[b] = closest_approach(tip, end, target_m[0], target_m[1])
        k = index[b]
        fold[b] = largest_fold(points[b], k)
        laid = unstretched(points[b, : end + 1], spacing_m)
        outside[b] = deepest_outside(laid, end, box)
        touch[b] = deepest_touch(laid, bars[p], radius_m, NEIGHBOURS + 1, 0, k)
        hidden[b] = deepest_touch(
            laid, bars[p], radius_m, last_third, max(k - around, 0), min(k + around, end)
        )
        speed[b] = np.hypot(tip[k, 0] - tip[k - 1, 0], tip[k, 1] - tip[k - 1, 1]) / step_s
    return miss, index, fold, outside, touch, hidden, speed
