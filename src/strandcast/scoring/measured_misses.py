"""The miss of a tracked throw: one function per kind of objective, registered for its class."""

from functools import singledispatch
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from strandcast.core.closest_approach import GAP_STEPS, closest_approach, gap_message, segment_approaches
from strandcast.core.interpolation import resampled
from strandcast.core.objectives import (
    DIRECTION_M_RAD,
    SPEED_S,
    VELOCITY_S,
    AimedPoint,
    Objective,
    PointInSpace,
    SegmentObjective,
    ShapeObjective,
    SwingObjective,
)
from strandcast.errors import StrandcastError

AROUND_S = 0.0101  # five frames to each side at 500 frames/s
CUBIC = 4  # coefficients
LEAST_SURE = 6  # frames: two more than that; a third of them on each side
FITS = 2.0  # rms in standard errors; chosen
LONGEST_S = 0.035  # of a gap with the frames on both sides; chosen


class TrackedThrow(NamedTuple):
    """The string as it was tracked during a throw.

    Attributes
    ----------
    time_s
        (F,) of the frames, robot time.
    points_m, sigma_m
        (F, n+1, 2 or 3), NaN where a point was not tracked, and (F, n+1).
    length_m
        From the hand to the tip, along the string.
    step_s
        Usual time between frames.
    window_s
        The time that counts, robot time.
    touch_m
        An approach counts only after the tip has been farther from the target than this.
    """

    time_s: np.ndarray
    points_m: np.ndarray
    sigma_m: np.ndarray
    length_m: float
    step_s: float
    window_s: tuple[float, float]
    touch_m: float = 0.0

    def place_m(self, along_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the path (F, 2) of a place on the string, and its sigma's square (F,)."""
        count = self.points_m.shape[1] - 1
        at = np.clip(along_m / self.length_m * count, 0.0, count)
        k = min(int(at), count - 1)
        share = at - k
        path = (1.0 - share) * self.points_m[:, k] + share * self.points_m[:, k + 1]
        path = self.points_m[:, k] if share == 0.0 else self.points_m[:, -1] if at == count else path
        return path, (1 - share) ** 2 * self.sigma_m[:, k] ** 2 + share**2 * self.sigma_m[:, k + 1] ** 2


class Shortfall(NamedTuple):
    """The least miss of a throw, its sigma, the nearest row of the track, and when and where the tip was."""

    miss_m: float
    sigma_m: float
    row: int
    time_s: float
    tip_m: np.ndarray


Measured = tuple[Shortfall | None, str | None]  # the shortfall, or why it is not known
Series = tuple[np.ndarray, np.ndarray]  # (F,) the miss at each frame, NaN where not known; its sigma [m]


@singledispatch
def measured_shortfall(objective: Objective, throw: TrackedThrow) -> Measured:
    """Return the miss of a throw, or why it is not known.

    Register a function for each new kind of objective: ``@measured_shortfall.register``.
    """
    raise StrandcastError(
        "SC-P008",
        f"the scorer has no shortfall for objectives of the kind {objective.kind!r}",
        field="objective",
        fix="register one (scoring.measured_misses.measured_shortfall): docs/extending/objective.md",
    )


@measured_shortfall.register
def _point_shortfall(objective: AimedPoint, throw: TrackedThrow) -> Measured:
    if objective.has_velocity:
        return least(throw, *passage_series(objective, throw))
    return nearest(throw, np.asarray(objective.target_m, float))


@measured_shortfall.register
def _nearest_shortfall(objective: PointInSpace | SegmentObjective, throw: TrackedThrow) -> Measured:
    place_m = objective.ends_m if isinstance(objective, SegmentObjective) else objective.target_m
    return nearest(throw, np.asarray(place_m, float))


@measured_shortfall.register
def _shape_shortfall(objective: ShapeObjective, throw: TrackedThrow) -> Measured:
    """Return the least rms distance of the places."""
    squares, variance = np.zeros(len(throw.time_s)), np.zeros(len(throw.time_s))
    for place in objective.places:
        path_m, sigma2 = throw.place_m(place.along_m)
        squares += ((path_m - np.array(place.at_m)) ** 2).sum(axis=1)
        variance += sigma2
    count = len(objective.places)
    return least(throw, np.sqrt(squares / count), np.sqrt(variance) / count)


@measured_shortfall.register
def _swing_shortfall(objective: SwingObjective, throw: TrackedThrow) -> Measured:
    return least(throw, *swing_series(objective, throw))


def swing_series(objective: SwingObjective, throw: TrackedThrow) -> Series:
    """Return the shortfall of height, or of speed as a distance, in each frame."""
    if objective.speed_m_s is not None:
        velocity, sigma_m_s = tip_velocity(throw)
        return SPEED_S * np.maximum(objective.speed_m_s - np.hypot(*velocity.T), 0.0), SPEED_S * sigma_m_s
    assert objective.height_m is not None
    return np.maximum(objective.height_m - throw.points_m[:, -1, 1], 0.0), throw.sigma_m[:, -1]


def passage_series(objective: AimedPoint, throw: TrackedThrow) -> Series:
    """Return distance and velocity's shortfall on the way from the frame before to each."""
    velocity, sigma_m_s = tip_velocity(throw, from_before=1)
    found = segment_approaches(throw.points_m[:, -1], np.array(objective.target_m))
    missed = np.array([np.nan, *(one.distance_m for one in found)])
    speed = np.hypot(*velocity.T)
    slow = SPEED_S * np.maximum(objective.least_speed_m_s - speed, 0.0)
    missed = missed + slow
    sigma = np.hypot(throw.sigma_m[:, -1], np.where(slow > 0.0, SPEED_S * sigma_m_s, 0.0))
    if objective.direction_and_tolerance_rad is not None:
        direction, tolerance = objective.direction_and_tolerance_rad
        off = np.arctan2(velocity[:, 1], velocity[:, 0]) - direction
        off = np.abs((off + np.pi) % (2.0 * np.pi) - np.pi)
        turned = DIRECTION_M_RAD * np.maximum(off - tolerance, 0.0)
        missed = missed + turned
        beyond = np.where(turned > 0.0, DIRECTION_M_RAD * sigma_m_s / np.maximum(speed, 1e-9), 0.0)
        sigma = np.hypot(sigma, beyond)
    return missed, sigma


def tip_velocity(throw: TrackedThrow, from_before: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return (F, 2) the tip's velocity over `VELOCITY_S` to each side, NaN across gaps, and its sigma.

    With `from_before` = 1 it is the velocity on the way from the frame before: its chord begins `VELOCITY_S`
    before that one.
    """
    there = np.isfinite(throw.points_m[:, -1]).all(axis=1)
    velocity = np.full((len(there), 2), np.nan)
    if there.sum() > 1:
        time_s, tip_m = throw.time_s[there], throw.points_m[there, -1]
        before = np.maximum(np.arange(len(there)) - from_before, 0)
        begin_s = np.maximum(throw.time_s[before] - VELOCITY_S, time_s[0])
        end_s = np.minimum(throw.time_s + VELOCITY_S, time_s[-1])
        ends = [resampled(t, time_s, tip_m) for t in (begin_s, end_s)]
        known = there & ~_across_gaps(throw, time_s, begin_s, end_s) & (end_s > begin_s)
        velocity[known] = ((ends[1] - ends[0]) / (end_s - begin_s)[:, None])[known]
    return velocity, throw.sigma_m[:, -1] / (np.sqrt(2.0) * VELOCITY_S)


def _across_gaps(
    throw: TrackedThrow, time_s: np.ndarray, begin_s: np.ndarray, end_s: np.ndarray
) -> np.ndarray:
    """Return which intervals (F,) reach across a gap between the tracked times (R,)."""
    gaps_s = time_s[:-1][np.diff(time_s) > GAP_STEPS * throw.step_s]
    first = np.maximum(np.searchsorted(time_s, begin_s, "right") - 1, 0)
    last = np.searchsorted(time_s, end_s, "left")
    return np.array(
        [bool(((gaps_s >= time_s[a]) & (gaps_s < time_s[b])).any()) for a, b in zip(first, last, strict=True)]
    )


def nearest(throw: TrackedThrow, target_m: np.ndarray) -> Measured:
    """Return the tip's closest approach to a place (2 or 3,) or bar (2, 2), between the frames too."""
    seen = np.isfinite(throw.points_m[:, -1]).all(axis=1)
    tip_m, sigma_m = throw.points_m[:, -1].copy(), throw.sigma_m[:, -1].copy()
    tip_m[seen], sigma_m[seen] = smoothed(throw.time_s[seen], tip_m[seen], sigma_m[seen])
    tip_m, sigma_m = bridged(throw.time_s, tip_m, sigma_m)
    rows = np.flatnonzero(np.isfinite(tip_m).all(axis=1))
    found, reason = closest_approach(
        throw.time_s[rows], tip_m[rows], target_m, throw.step_s, throw.window_s, throw.touch_m
    )
    if found is None:
        return None, reason
    before, after, share = rows[found.index], rows[found.index + 1], found.share
    parts_m = np.array([1 - share, share]) * sigma_m[[before, after]]
    alike = (sigma_m[[before, after]] != throw.sigma_m[[before, after], -1]).any()
    return Shortfall(
        found.distance_m,
        float(parts_m.sum() if alike else np.hypot(*parts_m)),
        int(before if share < 0.5 else after),
        float((1 - share) * throw.time_s[before] + share * throw.time_s[after]),
        found.place_m,
    ), None


def smoothed(time_s: np.ndarray, path_m: np.ndarray, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a path (F, 2 or 3) and its sigma (F,), a doubtful frame's from surer ones around it.

    A cubic is fitted to the frames within `AROUND_S`, each by its sigma; there must be surer ones on both
    sides, more than a cubic has coefficients, and it must fit them: a path that turns, as at a contact, stays
    as it is, as does one of fewer than 400 frames/s. Errors of neighbours are alike: the sigma returned is
    the most to which they can add up.
    """
    path, sigma = path_m.copy(), sigma_m.copy()
    known = np.isfinite(sigma_m) & (sigma_m > 0.0)
    for k in np.flatnonzero(known):
        near = np.flatnonzero((np.abs(time_s - time_s[k]) <= AROUND_S) & known)
        surer = sigma_m[near] < sigma_m[k]
        if surer.sum() < LEAST_SURE or min(surer[near < k].sum(), surer[near > k].sum()) < LEAST_SURE // 3:
            continue
        powers, shares = _polynomial(time_s[near] - time_s[k], sigma_m[near], CUBIC)
        off = np.linalg.norm(path_m[near] - powers @ (shares @ path_m[near]), axis=1) / sigma_m[near]
        most_m = float(np.abs(shares[0]) @ sigma_m[near])
        if most_m < sigma_m[k] and np.sqrt(np.mean(off[surer] ** 2)) <= FITS:
            path[k], sigma[k] = shares[0] @ path_m[near], most_m
    return path, sigma


def bridged(time_s: np.ndarray, path_m: np.ndarray, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a path (F, 2 or 3) and its sigma (F,), with the frames of gaps of up to `AROUND_S`.

    A cubic is fitted to the frames on both sides. Whether the tip struck what hid it, e.g. the target, is not
    seen: sigma includes how far straight lines through the frames of either side are apart.
    """
    path, sigma = path_m.copy(), sigma_m.copy()
    seen = np.isfinite(path_m).all(axis=1)
    known = seen & (sigma_m > 0.0)
    for k in np.flatnonzero(~seen):
        before, after = np.flatnonzero(known[:k])[-LEAST_SURE:], k + np.flatnonzero(known[k:])[:LEAST_SURE]
        near = np.concatenate([before, after])
        if len(near) < 2 * LEAST_SURE or np.ptp(time_s[near]) > LONGEST_S:
            continue
        if time_s[after[0]] - time_s[before[-1]] > AROUND_S:
            continue
        lines_m = [
            _polynomial(time_s[side] - time_s[k], sigma_m[side], 2)[1][0] @ path_m[side]
            for side in (before, after)
        ]
        _, shares = _polynomial(time_s[near] - time_s[k], sigma_m[near], CUBIC)
        path[k] = shares[0] @ path_m[near]
        sigma[k] = np.hypot(np.abs(shares[0]) @ sigma_m[near], np.linalg.norm(lines_m[1] - lines_m[0]))
    return path, sigma


def _polynomial(away_s: np.ndarray, sigma_m: np.ndarray, coefficients: int) -> tuple[np.ndarray, np.ndarray]:
    """Return powers (F, c) of times, and shares (c, F) of values with these sigmas in the coefficients."""
    powers = (away_s / AROUND_S)[:, None] ** np.arange(coefficients)
    return powers, np.linalg.pinv(powers / sigma_m[:, None]) / sigma_m


def least(throw: TrackedThrow, miss_m: np.ndarray, sigma_m: np.ndarray) -> Measured:
    """Return the least of a miss (F,) per frame; nothing is known between frames, or where it is NaN."""
    known = np.flatnonzero(np.isfinite(miss_m))
    if not len(known):
        return None, "the objective was not tracked in any frame"
    place = int(np.argmin(miss_m[known]))
    best = int(known[place])
    edges_s = np.array([throw.window_s[0], *throw.time_s[known], throw.window_s[1]])[place : place + 3]
    for before_s, after_s in pairwise(edges_s.tolist()):
        if miss_m[best] != 0.0 and after_s - before_s > GAP_STEPS * throw.step_s:
            return None, gap_message("the objective was not tracked at its best moment", before_s, after_s)
    time_s, tip_m = float(throw.time_s[best]), throw.points_m[best, -1]
    return Shortfall(float(miss_m[best]), float(sigma_m[best]), best, time_s, tip_m), None
