"""What a throw may be for: a point, a bar, a shape, a swing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from strandcast.lack import (
    DIRECTION_M_RAD,
    SPEED_S,
    VELOCITY_S,
    point_words,
    shape_words,
    swing_words,
)
from strandcast.motion.objective import Miss, Objective, Places, Throws, closest_approach, segment_distance

WHOLE_STRING = math.inf
BAR_PLACES = 33  # of a bar, looked at for reach


@dataclass(frozen=True)
class Point(Objective):
    """The tip hits a place, the paper's objective; on request from a direction, and not too slowly.

    Attributes
    ----------
    target_m
        The place [m].
    direction_rad, tolerance_rad
        Where to the tip is to move at the hit, counter-clockwise from x, and how far it may be off; None:
        anywhere.
    least_speed_m_s
        The tip's speed at the hit.
    """

    target_m: tuple[float, float]
    direction_rad: float | None = None
    tolerance_rad: float = 0.35
    least_speed_m_s: float = 0.0

    def miss(self, throws: Throws) -> Miss:
        """Return the least distance of the tip's path; what its velocity lacks counts as distance."""
        x, y = self.target_m
        if self.direction_rad is None and self.least_speed_m_s <= 0.0:
            return _nearest_tip(throws.points_m, throws.shift_m, throws.last, x, y)
        anywhere = self.direction_rad is None
        wanted = (0.0, math.pi) if self.direction_rad is None else (self.direction_rad, self.tolerance_rad)
        return _nearest_velocity(
            throws.tip_m(), throws.last, x, y, *wanted, self.least_speed_m_s, throws.step_s, anywhere
        )

    def places(self) -> list[Places]:
        """Return the place, for the tip."""
        return [Places(np.array([self.target_m]), WHOLE_STRING)]

    def __str__(self) -> str:
        return point_words(self.direction_rad, self.tolerance_rad, self.least_speed_m_s)


@dataclass(frozen=True)
class Segment(Objective):
    """The tip hits a bar anywhere between two ends [m]."""

    ends_m: tuple[tuple[float, float], tuple[float, float]]

    def miss(self, throws: Throws) -> Miss:
        """Return the least distance between the tip's path and the bar."""
        return _nearest_bar(throws.tip_m(), throws.last, np.array(self.ends_m, float))

    def places(self) -> list[Places]:
        """Return the bar, any place of it, for the tip."""
        share = np.linspace(0.0, 1.0, BAR_PLACES)[:, None]
        one, other = np.array(self.ends_m, float)
        return [Places((1.0 - share) * one + share * other, WHOLE_STRING)]

    def __str__(self) -> str:
        return "bar from ({:g}, {:g}) to ({:g}, {:g}) m".format(*self.ends_m[0], *self.ends_m[1])


@dataclass(frozen=True)
class Shape(Objective):
    """The string takes a shape for a moment, whenever that is.

    Attributes
    ----------
    along_m
        Where on the string, from the hand [m].
    places_m
        Where each of these is to be [m].
    """

    along_m: tuple[float, ...]
    places_m: tuple[tuple[float, float], ...]

    def miss(self, throws: Throws) -> Miss:
        """Return the least rms distance of the places from where they are to be, over the samples.

        Only the tip has a residual carried over from earlier throws.
        """
        square = sum(
            ((throws.place_m(along) - np.array(place)) ** 2).sum(axis=2)
            for along, place in zip(self.along_m, self.places_m, strict=True)
        )
        return throws.least(np.sqrt(square / len(self.along_m)))

    def places(self) -> list[Places]:
        """Return each place, for what is to be there."""
        return [Places(np.array([p]), along) for along, p in zip(self.along_m, self.places_m, strict=True)]

    def __str__(self) -> str:
        return shape_words(len(self.places_m))


@dataclass(frozen=True)
class Swing(Objective):
    """The tip gets as high, or as fast, as is asked for: asked for too much, it does what it can."""

    height_m: float | None = None
    speed_m_s: float | None = None

    def miss(self, throws: Throws) -> Miss:
        """Return what lacks at the height, or at the greatest speed, as a distance (0.1 m for 1 m/s)."""
        tip = throws.tip_m()
        if self.speed_m_s is not None:
            speed = np.linalg.norm(velocities(tip, throws.step_s), axis=2)
            return throws.least(SPEED_S * np.maximum(self.speed_m_s - speed, 0.0))
        assert self.height_m is not None
        return throws.least(np.maximum(self.height_m - tip[:, :, 1], 0.0))

    def __str__(self) -> str:
        return swing_words(self.height_m, self.speed_m_s)


def velocities(path_m: np.ndarray, step_s: float) -> np.ndarray:
    """Return velocities (B, T, 2) of paths (B, T, 2): over `VELOCITY_S` to each side, less at the ends."""
    at, samples = np.arange(path_m.shape[1]), _velocity_samples(step_s)
    before, after = np.maximum(at - samples, 0), np.minimum(at + samples, at[-1])
    return np.asarray((path_m[:, after] - path_m[:, before]) / ((after - before) * step_s)[:, None])


@njit(cache=True)
def _velocity_samples(step_s: float) -> int:
    return max(1, round(VELOCITY_S / step_s))


@njit(cache=True, parallel=True)
def _nearest_tip(
    points: np.ndarray, shift: np.ndarray, last: np.ndarray, x: float, y: float
) -> tuple[np.ndarray, np.ndarray]:
    miss, index = np.empty(len(points)), np.empty(len(points), np.int64)
    for b in prange(len(points)):
        tip = points[b, :, -1, :] + shift[b]
        miss[b], index[b] = closest_approach(tip, last[b], x, y)
    return miss, index


@njit(cache=True, parallel=True)
def _nearest_velocity(
    tips: np.ndarray,
    last: np.ndarray,
    x: float,
    y: float,
    direction: float,
    tolerance: float,
    least_speed: float,
    step_s: float,
    anywhere: bool,
) -> tuple[np.ndarray, np.ndarray]:
    miss, index = np.full(len(tips), np.inf), np.zeros(len(tips), np.int64)
    samples = _velocity_samples(step_s)
    for b in prange(len(tips)):
        tip = tips[b]
        for t in range(1, last[b] + 1):
            away = segment_distance(x, y, tip[t - 1, 0], tip[t - 1, 1], tip[t, 0], tip[t, 1])
            if away >= miss[b]:
                continue
            before, after = max(t - 1 - samples, 0), min(t + samples, last[b])
            span = (after - before) * step_s
            vx, vy = (tip[after, 0] - tip[before, 0]) / span, (tip[after, 1] - tip[before, 1]) / span
            away += SPEED_S * max(0.0, least_speed - math.sqrt(vx * vx + vy * vy))
            if not anywhere:
                off = abs((math.atan2(vy, vx) - direction + math.pi) % (2.0 * math.pi) - math.pi)
                away += DIRECTION_M_RAD * max(0.0, off - tolerance)
            if away < miss[b]:
                miss[b], index[b] = away, t
    return miss, index


@njit(cache=True, parallel=True)
def _nearest_bar(tips: np.ndarray, last: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    miss, index = np.full(len(tips), np.inf), np.zeros(len(tips), np.int64)
    for b in prange(len(tips)):
        for t in range(1, last[b] + 1):
            away = _bar_distance(tips[b, t - 1], tips[b, t], ends[0], ends[1])
            if away < miss[b]:
                miss[b], index[b] = away, t
    return miss, index


@njit(cache=True)
def _bar_distance(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> float:
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
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
