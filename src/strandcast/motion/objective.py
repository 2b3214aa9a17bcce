"""What a simulated throw is worth: by how much it misses its objective, and at what price.

An objective tells the miss and when it happens (`Objective`); folding, place, touching and hiding are judged
the same for all.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from numba import njit, prange

Miss = tuple[np.ndarray, np.ndarray]  # (B,) by how much each throw misses [m], (B,) at which sample


class Throws(NamedTuple):
    """B simulated throws, as an objective sees them.

    Attributes
    ----------
    points_m
        (B, T, n+1, 2) hand and string [m], NaN from where a simulation failed.
    shift_m
        (B, T, 2) what is carried over to the tip from earlier throws, zero if nothing [m].
    last
        (B,) last sample of each throw's window, which starts with its motion.
    step_s, spacing_m
        Time between samples; rest length of a segment.
    """

    points_m: np.ndarray
    shift_m: np.ndarray
    last: np.ndarray
    step_s: float
    spacing_m: float

    def tip_m(self) -> np.ndarray:
        """Return the tip's path (B, T, 2), what is carried over included [m]."""
        return np.asarray(self.points_m[:, :, -1] + self.shift_m)

    def place_m(self, along_m: float) -> np.ndarray:
        """Return the path (B, T, 2) of a place on the string, from the hand on; at its end, the tip's."""
        count = self.points_m.shape[2] - 1
        if along_m >= (count - 1e-6) * self.spacing_m:
            return self.tip_m()
        before, share = divmod(max(along_m, 0.0) / self.spacing_m, 1.0)
        ends = self.points_m[:, :, int(before)], self.points_m[:, :, int(before) + 1]
        return np.asarray((1.0 - share) * ends[0] + share * ends[1])

    def nearest(self, path_m: np.ndarray, target_m: np.ndarray) -> Miss:
        """Return how near paths (B, T, 2) come to a place (2,), between the samples too, and when."""
        x, y = (float(value) for value in target_m)
        miss, index = closest_approaches(np.ascontiguousarray(path_m), self.last, x, y)
        return miss, index

    def least(self, values: np.ndarray) -> Miss:
        """Return the least of values (B, T) within each throw's window, and its sample."""
        within = np.arange(values.shape[1]) <= self.last[:, None]
        index = np.argmin(np.where(within, values, np.inf), axis=1)
        return np.take_along_axis(values, index[:, None], axis=1)[:, 0], index


class Places(NamedTuple):
    """Places of which one must be reached: alternatives_m (A, 2), by what is `along_m` from the hand [m]."""

    alternatives_m: np.ndarray
    along_m: float


class Objective(ABC):
    """What a throw is for. A new one is a dataclass with a `miss`; docs/planning.md has one in ten lines."""

    @abstractmethod
    def miss(self, throws: Throws) -> Miss:
        """Return by how much each throw misses [m], zero or more, and the sample at which it does."""

    def places(self) -> list[Places]:
        """Return what must be within reach, so that what is not is refused at once; nothing if not given."""
        return []

    def __str__(self) -> str:
        return type(self).__name__.lower()


class Assessment(NamedTuple):
    """What is told of B throws.

    Attributes
    ----------
    miss_m
        (B,) by how much the objective is missed [m].
    hit_index
        (B,) the sample at which it is, or the first after it.
    fold
        (B,) 1 - cos of the largest bend between neighbouring segments until then.
    outside_m
        (B,) how far hand or string leave the box, at any time in the window [m].
    touch_m
        (B,) how deep the string, the hand's neighbours aside, comes into the arm's bars until the hit [m].
    hidden_m
        (B,) how deep the string's last third is in the bars around the hit [m].
    tip_speed_m_s
        (B,) speed of the tip then.
    """

    miss_m: np.ndarray
    hit_index: np.ndarray
    fold: np.ndarray
    outside_m: np.ndarray
    touch_m: np.ndarray
    hidden_m: np.ndarray
    tip_speed_m_s: np.ndarray


def side_by_side(told: list[tuple[Assessment, int]]) -> tuple[Assessment, int]:
    """Return the assessments of P motions with several lots of strings as one, and the strings' number."""
    columns = zip(*([column.reshape(-1, strings) for column in lot] for lot, strings in told), strict=True)
    both = Assessment(*(np.concatenate(column, axis=1).ravel() for column in columns))
    return both, sum(strings for _, strings in told)


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
    x, y = px - ax - s * dx, py - ay - s * dy
    return math.sqrt(x * x + y * y)


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
def watch(
    points: np.ndarray,
    bars: np.ndarray,
    radius_m: np.ndarray,
    box: np.ndarray,
    spacing_m: float,
    hit: int,
    around: int,
    last: int,
    stride: int,
) -> tuple[float, float, float, float]:
    """Return fold, outside, touch, hidden (see `Assessment`) of one throw (T, n+1, 2), nearest at `hit`.

    Place and touch are judged of a cord that does not stretch: the directions are the model's, no segment is
    longer than a cord's can be.
    """
    n = points.shape[1] - 1
    last_third = n + 1 - max((n + 1) // 3, 1)
    least, outside, touch, hidden = 1.0, 0.0, 0.0, 0.0
    for t in range(0, last + 1, stride):
        before_hit, at_hit = t <= hit, hit - around <= t <= hit + around
        x, y = points[t, 0, 0], points[t, 0, 1]
        outside = max(outside, box[0, 0] - x, x - box[0, 1], box[1, 0] - y, y - box[1, 1])
        ux, uy = 0.0, 0.0
        for i in range(1, n + 1):
            dx, dy = points[t, i, 0] - points[t, i - 1, 0], points[t, i, 1] - points[t, i - 1, 1]
            length = max(math.sqrt(dx * dx + dy * dy), 1e-300)
            vx, vy = dx / length, dy / length
            if before_hit and i > 1:
                least = min(least, ux * vx + uy * vy)
            ux, uy = vx, vy
            length = min(length, STRETCHED * spacing_m)
            x, y = x + length * ux, y + length * uy
            outside = max(outside, box[0, 0] - x, x - box[0, 1], box[1, 0] - y, y - box[1, 1])
            if (before_hit and i > NEIGHBOURS) or (at_hit and i >= last_third):
                deep = depth(x, y, bars[t], radius_m)
                if before_hit and i > NEIGHBOURS:
                    touch = max(touch, deep)
                if at_hit and i >= last_third:
                    hidden = max(hidden, deep)
    return 1.0 - least, outside, touch, hidden


@njit(cache=True)
def depth(x: float, y: float, bars: np.ndarray, radius_m: np.ndarray) -> float:
    """How deep a place is in bars (S, 2, 2), 0 if in none."""
    deepest = 0.0
    for j in range(len(bars)):
        ax, ay = bars[j, 0, 0], bars[j, 0, 1]
        dx, dy = bars[j, 1, 0] - ax, bars[j, 1, 1] - ay
        px, py = x - ax, y - ay
        s = min(1.0, max(0.0, (px * dx + py * dy) / max(dx * dx + dy * dy, 1e-300)))
        px, py = px - s * dx, py - s * dy
        within, away2 = radius_m[j] - deepest, px * px + py * py
        # Most places are far away: no root is drawn for them.
        if within > 0.0 and away2 < within * within:
            deepest = radius_m[j] - math.sqrt(away2)
    return deepest


@njit(cache=True)
def all_finite(points: np.ndarray, last: int) -> bool:
    """Tell whether a throw (T, n+1, 2) is finite until sample `last`: what blew up once stays so."""
    for i in range(points.shape[1]):
        if not (math.isfinite(points[last, i, 0]) and math.isfinite(points[last, i, 1])):
            return False
    return True


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
def _watch_all(
    points: np.ndarray,
    shift: np.ndarray,
    bars: np.ndarray,
    radius_m: np.ndarray,
    last: np.ndarray,
    index: np.ndarray,
    box: np.ndarray,
    spacing_m: float,
    step_s: float,
    stride: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (B,) which throws are finite, and (5, B) fold, outside, touch, hidden and tip speed."""
    count = len(points)
    strings = count // len(bars)
    fine = np.zeros(count, np.bool_)
    facts = np.ones((5, count))
    facts[0], facts[4] = 0.0, 0.0
    around = round(SEEN_S / step_s)
    for b in prange(count):
        if not all_finite(points[b], last[b]):
            continue
        fine[b] = True
        k = index[b]
        facts[0, b], facts[1, b], facts[2, b], facts[3, b] = watch(
            points[b], bars[b // strings], radius_m, box, spacing_m, k, around, last[b], stride
        )
        if k > 0:
            dx = points[b, k, -1, 0] + shift[b, k, 0] - points[b, k - 1, -1, 0] - shift[b, k - 1, 0]
            dy = points[b, k, -1, 1] + shift[b, k, 1] - points[b, k - 1, -1, 1] - shift[b, k - 1, 1]
            facts[4, b] = math.sqrt(dx * dx + dy * dy) / step_s
    return fine, facts


def assess(
    objective: Objective,
    throws: Throws,
    bars: np.ndarray,
    radius_m: np.ndarray,
    box: np.ndarray,
    stride: int = 1,
) -> Assessment:
    """Assess B = P * K throws: P motions, each with K strings (motion by motion).

    Parameters
    ----------
    bars, radius_m
        (P, T, S, 2, 2) ends of the arm's bars and (S,) how near to them the string may come [m].
    box
        (2, 2) low and high of x and y that nothing should leave [m].
    stride
        Every how many samples bends and places are looked at; the objective sees all.

    Notes
    -----
    A throw that is not finite has miss, outside, touch and hidden of a metre.
    """
    miss_m, index = objective.miss(throws)
    index = np.clip(np.asarray(index, np.int64), 0, throws.last)
    fine, facts = _watch_all(
        throws.points_m, throws.shift_m, bars, radius_m, throws.last, index, box, throws.spacing_m,
        throws.step_s, stride,
    )  # fmt: skip
    return Assessment(np.where(fine, miss_m, 1.0), np.where(fine, index, 0), *facts)
