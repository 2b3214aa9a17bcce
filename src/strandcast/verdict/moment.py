"""What a throw misses by at each moment, where it is for more than to come near a place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from strandcast.lack import (
    DIRECTION_M_RAD,
    SPEED_S,
    VELOCITY_S,
    point_words,
    shape_words,
    swing_words,
)
from strandcast.verdict.approach import GAP_STEPS, gap_words, segment_approaches


class Seen(NamedTuple):
    """The string as it was tracked during a throw.

    Attributes
    ----------
    time_s
        (F,) of the frames, robot time.
    points_m, sigma_m
        (F, n+1, 2), NaN where a point was not seen, and (F, n+1).
    length_m
        From the hand to the tip, along the string.
    step_s
        Between frames, usually.
    """

    time_s: np.ndarray
    points_m: np.ndarray
    sigma_m: np.ndarray
    length_m: float
    step_s: float


Lack = tuple[
    np.ndarray, np.ndarray
]  # (F,) what is missed by at each frame, NaN where not known; its sigma [m]


@dataclass(frozen=True)
class Velocity:
    """The tip passes a place with a direction, a speed, or both."""

    target_m: tuple[float, float]
    direction_rad: float | None
    tolerance_rad: float
    least_speed_m_s: float

    def lack(self, seen: Seen) -> Lack:
        """Return what lacks on the way from the frame before to each."""
        velocity, sigma_m_s = tip_velocity(seen, from_before=1)
        found = segment_approaches(seen.points_m[:, -1], np.array(self.target_m))
        missed = np.array([np.nan, *(one.distance_m for one in found)])
        speed = np.hypot(*velocity.T)
        slow = SPEED_S * np.maximum(self.least_speed_m_s - speed, 0.0)
        missed = missed + slow
        sigma = np.hypot(seen.sigma_m[:, -1], np.where(slow > 0.0, SPEED_S * sigma_m_s, 0.0))
        if self.direction_rad is not None:
            off = np.arctan2(velocity[:, 1], velocity[:, 0]) - self.direction_rad
            off = np.abs((off + np.pi) % (2.0 * np.pi) - np.pi)
            turned = DIRECTION_M_RAD * np.maximum(off - self.tolerance_rad, 0.0)
            missed = missed + turned
            beyond = np.where(turned > 0.0, DIRECTION_M_RAD * sigma_m_s / np.maximum(speed, 1e-9), 0.0)
            sigma = np.hypot(sigma, beyond)
        return missed, sigma

    def __str__(self) -> str:
        return point_words(self.direction_rad, self.tolerance_rad, self.least_speed_m_s)


@dataclass(frozen=True)
class Shape:
    """Places on the string, metres from the hand, are each at a place at one moment."""

    along_m: tuple[float, ...]
    places_m: tuple[tuple[float, float], ...]

    def lack(self, seen: Seen) -> Lack:
        """Return the rms distance of the places in each frame."""
        count = seen.points_m.shape[1] - 1
        squares, variance = np.zeros(len(seen.time_s)), np.zeros(len(seen.time_s))
        for along, place in zip(self.along_m, self.places_m, strict=True):
            at = np.clip(along / seen.length_m * count, 0.0, count)
            k = min(int(at), count - 1)
            share = at - k
            there = (1.0 - share) * seen.points_m[:, k] + share * seen.points_m[:, k + 1]
            there = seen.points_m[:, k] if share == 0.0 else seen.points_m[:, -1] if at == count else there
            squares += ((there - np.array(place)) ** 2).sum(axis=1)
            variance += (1 - share) ** 2 * seen.sigma_m[:, k] ** 2 + share**2 * seen.sigma_m[:, k + 1] ** 2
        return np.sqrt(squares / len(self.along_m)), np.sqrt(variance) / len(self.along_m)

    def __str__(self) -> str:
        return shape_words(len(self.places_m))


@dataclass(frozen=True)
class Swing:
    """The tip gets as high, or as fast, as told."""

    height_m: float | None
    speed_m_s: float | None

    def lack(self, seen: Seen) -> Lack:
        """Return what lacks in each frame."""
        if self.speed_m_s is not None:
            velocity, sigma_m_s = tip_velocity(seen)
            return SPEED_S * np.maximum(self.speed_m_s - np.hypot(*velocity.T), 0.0), SPEED_S * sigma_m_s
        assert self.height_m is not None
        return np.maximum(self.height_m - seen.points_m[:, -1, 1], 0.0), seen.sigma_m[:, -1]

    def __str__(self) -> str:
        return swing_words(self.height_m, self.speed_m_s)


def tip_velocity(seen: Seen, from_before: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return (F, 2) the tip's velocity over `VELOCITY_S` to each side, NaN across gaps, and its sigma.

    Told of the way to a frame from the one before, it begins so much before that one.
    """
    there = np.isfinite(seen.points_m[:, -1]).all(axis=1)
    velocity = np.full((len(there), 2), np.nan)
    if there.sum() > 1:
        time_s, tip_m = seen.time_s[there], seen.points_m[there, -1]
        before = np.maximum(np.arange(len(there)) - from_before, 0)
        begin_s = np.maximum(seen.time_s[before] - VELOCITY_S, time_s[0])
        end_s = np.minimum(seen.time_s + VELOCITY_S, time_s[-1])
        ends = [np.stack([np.interp(t, time_s, x) for x in tip_m.T], axis=1) for t in (begin_s, end_s)]
        gaps_s = time_s[:-1][np.diff(time_s) > GAP_STEPS * seen.step_s]
        first = np.maximum(np.searchsorted(time_s, begin_s, "right") - 1, 0)
        last = np.searchsorted(time_s, end_s, "left")
        across = [
            bool(((gaps_s >= time_s[a]) & (gaps_s < time_s[b])).any())
            for a, b in zip(first, last, strict=True)
        ]
        known = there & ~np.array(across) & (end_s > begin_s)
        velocity[known] = ((ends[1] - ends[0]) / (end_s - begin_s)[:, None])[known]
    return velocity, seen.sigma_m[:, -1] / (np.sqrt(2.0) * VELOCITY_S)


def least(
    lack_m: np.ndarray, time_s: np.ndarray, step_s: float, window_s: tuple[float, float]
) -> tuple[int | None, str | None]:
    """Return the frame with the least lack, or why it is not told: nothing is known of what was beside it."""
    known = np.flatnonzero(np.isfinite(lack_m))
    if not len(known):
        return None, "what the throw is for was not tracked in any frame"
    best = int(known[np.argmin(lack_m[known])])
    if lack_m[best] == 0.0:
        return best, None
    edges = np.array([window_s[0], *time_s[known], window_s[1]])
    place = int(np.searchsorted(known, best)) + 1
    for before in (place - 1, place):
        if edges[before + 1] - edges[before] > GAP_STEPS * step_s:
            what = "what the throw is for was not tracked at its best moment"
            return None, gap_words(what, float(edges[before]), float(edges[before + 1]))
    return best, None
