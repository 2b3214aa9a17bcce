"""Assess simulated rollouts: the miss of each, and its other faults.

The miss is the objective's (`planning.simulated_misses`); folding, workspace, contact with the arm and
occlusion of the tip are the same for all.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.planning.miss_calibration import FAILED_M
from strandcast.planning.rollouts import Rollouts
from strandcast.planning.simulated_misses import simulated_miss
from strandcast.planning.task import PlanningTask
from strandcast.threads import over_ranges

ROUGH_STRIDE = 4  # samples between those that a search checks for bends and places; chosen
# Points this near the hand along the string cannot be far from the last link.
NEIGHBOURS = 2
FREE_OF_HAND_M = 0.06  # the same in space, where segments are shorter; chosen
# How near the string may come to the middle of the arm's links, and at the start to a hit; chosen.
CLEARANCE_M = 0.035
# The tip must be visible this long before and after the closest approach. Chosen: ten frames at 500 Hz.
VISIBLE_S = 0.02
# No cord stretches more (chosen): a model that does says nothing about where the string will be.
STRETCHED = 1.1


class Assessment(NamedTuple):
    """Assessment of B rollouts.

    Attributes
    ----------
    miss_m
        (B,) miss of the objective [m].
    hit_index
        (B,) the sample of the hit, or the first after it.
    fold
        (B,) 1 - cos of the largest bend between neighbouring segments until then.
    outside_m
        (B,) how far hand or string leave the box, at any time in the window [m].
    touch_m
        (B,) how deep the string, except next to the hand, comes into the arm's capsules until the hit [m].
    hidden_m
        (B,) how deep the string's last third is in the capsules around the hit [m].
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


class Room(NamedTuple):
    """Where a string may be.

    Attributes
    ----------
    radius_m
        (S,) how near to the arm's capsules it may come [m].
    box
        (2 or 3, 2) low and high of each coordinate that nothing should leave [m].
    axes
        Numbers of the coordinates: the length of a tuple is known when the kernels are compiled, so that
        their loops over coordinates cost nothing.
    """

    radius_m: np.ndarray
    box: np.ndarray
    axes: tuple[int, ...]


def assess_rollouts(task: PlanningTask, rollouts: Rollouts) -> Assessment:
    """Assess rollouts by the task's objective; the string may come as near to the links as `CLEARANCE_M`."""
    room = Room(task.arm.capsule_radii(CLEARANCE_M), task.box(), tuple(range(len(task.target_m))))
    stride = ROUGH_STRIDE if task.model.precision == "f32" else 1
    return assess(rollouts, simulated_miss(task.aim, rollouts), room, stride)


def assess(
    rollouts: Rollouts, miss: tuple[np.ndarray, np.ndarray], room: Room, stride: int = 1
) -> Assessment:
    """Assess rollouts whose misses (B,), at samples (B,), are known.

    Bends and places are checked every `stride` samples. A rollout that is not finite has miss, outside, touch
    and hidden of a metre.
    """
    index = np.clip(np.asarray(miss[1], np.int64), 0, rollouts.last)
    count = len(rollouts.points_m)
    finite, facts = np.zeros(count, np.bool_), np.ones((5, count))
    facts[0], facts[4] = 0.0, 0.0
    over_ranges(
        count, lambda first, last: _check_all(first, last, rollouts, room, index, stride, finite, facts)
    )
    return Assessment(np.where(finite, miss[0], FAILED_M), np.where(finite, index, 0), *facts)


@njit(cache=True)
def _check(
    rollouts: Rollouts, b: int, room: Room, hit: int, stride: int
) -> tuple[float, float, float, float]:
    """Return fold, outside, touch, hidden (see `Assessment`) of rollout `b`, which is nearest at `hit`.

    Place and touch are those of a cord that does not stretch: the directions are the model's, no segment is
    longer than a cord's can be. In space nothing is hidden: there is no single camera.
    """
    points, last, spacing_m = rollouts.points_m[b], rollouts.last[b], rollouts.spacing_m
    capsules = rollouts.capsules_m[b // (len(rollouts.points_m) // len(rollouts.capsules_m))]
    around = round(VISIBLE_S / rollouts.step_s)
    n, dimensions = points.shape[1] - 1, len(room.axes)
    near = NEIGHBOURS if dimensions == 2 else math.ceil(FREE_OF_HAND_M / spacing_m)
    last_third = n + 1 - max((n + 1) // 3, 1) if dimensions == 2 else n + 1
    least, outside, touch, hidden = 1.0, 0.0, 0.0, 0.0
    place, along, before = np.empty(dimensions), np.empty(dimensions), np.empty(dimensions)
    for t in range(0, last + 1, stride):
        before_hit, at_hit = t <= hit, hit - around <= t <= hit + around
        for axis in range(dimensions):
            place[axis] = points[t, 0, axis]
        outside = max(outside, _outside(place, room))
        for i in range(1, n + 1):
            length, cosine = 0.0, 0.0
            for axis in range(dimensions):
                along[axis] = points[t, i, axis] - points[t, i - 1, axis]
                length += along[axis] * along[axis]
            length = max(math.sqrt(length), 1e-300)
            step = min(length, STRETCHED * spacing_m)
            for axis in range(dimensions):
                along[axis] /= length
                cosine += along[axis] * before[axis]
                before[axis] = along[axis]
                place[axis] += step * along[axis]
            if before_hit and i > 1:
                least = min(least, cosine)
            outside = max(outside, _outside(place, room))
            if (before_hit and i > near) or (at_hit and i >= last_third):
                deep = _depth(place, capsules[t], room)
                if before_hit and i > near:
                    touch = max(touch, deep)
                if at_hit and i >= last_third:
                    hidden = max(hidden, deep)
    return 1.0 - least, outside, touch, hidden


@njit(cache=True)
def _outside(place: np.ndarray, room: Room) -> float:
    """How far a place (2 or 3,) is outside the box, below 0 inside."""
    out = -math.inf
    for axis in range(len(room.axes)):
        out = max(out, room.box[axis, 0] - place[axis], place[axis] - room.box[axis, 1])
    return out


@njit(cache=True)
def _depth(place: np.ndarray, capsules: np.ndarray, room: Room) -> float:
    """How deep a place (2 or 3,) is in capsules (S, 2, 2 or 3), 0 if in none."""
    deepest = 0.0
    for j in range(len(capsules)):
        inside, square = 0.0, 0.0
        for axis in range(len(room.axes)):
            way = capsules[j, 1, axis] - capsules[j, 0, axis]
            inside += (place[axis] - capsules[j, 0, axis]) * way
            square += way * way
        share, away2 = min(1.0, max(0.0, inside / max(square, 1e-300))), 0.0
        for axis in range(len(room.axes)):
            start = capsules[j, 0, axis]
            away2 += (place[axis] - start - share * (capsules[j, 1, axis] - start)) ** 2
        # Most places are far away: skip the square root for them.
        within = room.radius_m[j] - deepest
        if within > 0.0 and away2 < within * within:
            deepest = room.radius_m[j] - math.sqrt(away2)
    return deepest


@njit(cache=True, nogil=True)
def _check_all(
    first: int,
    last: int,
    rollouts: Rollouts,
    room: Room,
    index: np.ndarray,
    stride: int,
    finite: np.ndarray,
    facts: np.ndarray,
) -> None:
    """Find (B,) which rollouts are finite, and (5, B) fold, outside, touch, hidden and tip speed."""
    points, bias = rollouts.points_m, rollouts.tip_bias_m
    for b in range(first, last):
        # What diverged once stays so.
        if not np.isfinite(points[b, rollouts.last[b]]).all():
            continue
        finite[b] = True
        k = index[b]
        facts[0, b], facts[1, b], facts[2, b], facts[3, b] = _check(rollouts, b, room, k, stride)
        if k > 0:
            square = 0.0
            for axis in range(len(room.axes)):
                way = points[b, k, -1, axis] + bias[b, k, axis]
                way = way - points[b, k - 1, -1, axis] - bias[b, k - 1, axis]
                square += way * way
            facts[4, b] = math.sqrt(square) / rollouts.step_s
