"""The miss of simulated throws: one function per kind of objective, registered for its class."""

import math
from functools import singledispatch
from typing import NamedTuple

import numpy as np
from numba import njit

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
from strandcast.planning.approach import approaches, bar_approaches, segment_distance
from strandcast.planning.rollouts import Miss, Rollouts


@singledispatch
def simulated_miss(objective: Objective, rollouts: Rollouts) -> Miss:
    """Return the miss of each rollout (B,) [m], zero or more, and its sample (B,).

    Register a function for each new kind of objective: ``@simulated_miss.register``.
    """
    raise StrandcastError(
        "SC-P008",
        f"the planner has no miss for objectives of the kind {objective.kind!r}",
        field="objective",
        fix="register one (planning.simulated_misses.simulated_miss): docs/extending/objective.md",
    )


@simulated_miss.register
def _point_miss(objective: AimedPoint | PointInSpace, rollouts: Rollouts) -> Miss:
    """Return the least distance of the tip's path; in a plane, a wrong velocity counts as distance."""
    tips = rollouts.tip_m()
    if isinstance(objective, PointInSpace) or not objective.has_velocity:
        return rollouts.nearest(tips, objective.target_m)
    given = tips, rollouts.last, _passage(objective), rollouts.step_s
    return approaches(_velocity_approaches, len(tips), *given)


@simulated_miss.register
def _segment_miss(objective: SegmentObjective, rollouts: Rollouts) -> Miss:
    """Return the least distance between the tip's path and the bar."""
    return bar_approaches(rollouts.tip_m(), rollouts.last, np.array(objective.ends_m, float))


@simulated_miss.register
def _shape_miss(objective: ShapeObjective, rollouts: Rollouts) -> Miss:
    """Return the least rms distance of the places from their targets; only the tip is bias-corrected."""
    square = sum(
        ((rollouts.place_m(place.along_m) - np.array(place.at_m)) ** 2).sum(axis=2)
        for place in objective.places
    )
    return rollouts.least(np.sqrt(square / len(objective.places)))


@simulated_miss.register
def _swing_miss(objective: SwingObjective, rollouts: Rollouts) -> Miss:
    """Return the shortfall of the height, or of the greatest speed as a distance."""
    tip = rollouts.tip_m()
    if objective.speed_m_s is not None:
        speed = np.linalg.norm(velocities(tip, rollouts.step_s), axis=2)
        return rollouts.least(SPEED_S * np.maximum(objective.speed_m_s - speed, 0.0))
    assert objective.height_m is not None
    return rollouts.least(np.maximum(objective.height_m - tip[:, :, 1], 0.0))


def velocities(path_m: np.ndarray, step_s: float) -> np.ndarray:
    """Return velocities (B, T, 2) of paths (B, T, 2): over `VELOCITY_S` to each side, less at the ends."""
    at, samples = np.arange(path_m.shape[1]), _velocity_samples(step_s)
    before, after = np.maximum(at - samples, 0), np.minimum(at + samples, at[-1])
    return np.asarray((path_m[:, after] - path_m[:, before]) / ((after - before) * step_s)[:, None])


class _Passage(NamedTuple):
    """The wanted velocity of the tip at a place (x, y): its direction, if any, and its least speed."""

    x: float
    y: float
    any_direction: bool
    direction: float
    tolerance: float
    least_speed: float


def _passage(objective: AimedPoint) -> _Passage:
    wanted = objective.direction_and_tolerance_rad
    direction, tolerance = wanted or (0.0, math.pi)
    return _Passage(*objective.target_m, wanted is None, direction, tolerance, objective.least_speed_m_s)


@njit(cache=True)
def _velocity_samples(step_s: float) -> int:
    return max(1, round(VELOCITY_S / step_s))


@njit(cache=True, nogil=True)
def _velocity_approaches(
    first: int,
    end: int,
    tips: np.ndarray,
    last: np.ndarray,
    passage: _Passage,
    step_s: float,
    miss: np.ndarray,
    index: np.ndarray,
) -> None:
    """Find the least distances of tips (B, T, 2), with a price on the velocity, and the samples after."""
    samples = _velocity_samples(step_s)
    x, y, direction, tolerance = passage.x, passage.y, passage.direction, passage.tolerance
    for b in range(first, end):
        tip = tips[b]
        for t in range(1, last[b] + 1):
            away = segment_distance(x, y, tip[t - 1, 0], tip[t - 1, 1], tip[t, 0], tip[t, 1])
            if away >= miss[b]:
                continue
            before, after = max(t - 1 - samples, 0), min(t + samples, last[b])
            span = (after - before) * step_s
            vx, vy = (tip[after, 0] - tip[before, 0]) / span, (tip[after, 1] - tip[before, 1]) / span
            away += SPEED_S * max(0.0, passage.least_speed - math.sqrt(vx * vx + vy * vy))
            if not passage.any_direction:
                off = abs((math.atan2(vy, vx) - direction + math.pi) % (2.0 * math.pi) - math.pi)
                away += DIRECTION_M_RAD * max(0.0, off - tolerance)
            if away < miss[b]:
                miss[b], index[b] = away, t
