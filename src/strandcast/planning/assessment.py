"""Assess simulated rollouts: the miss of each, and its other faults.

The miss is the objective's (`planning.simulated_misses`); folding, workspace, contact with the arm and
occlusion of the tip are the same for all.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.planning.capsules import capsule_radii
from strandcast.planning.rollouts import Rollouts
from strandcast.planning.simulated_misses import simulated_miss
from strandcast.planning.task import AnyTask
from strandcast.threads import over_ranges

ROUGH_STRIDE = 4  # samples between those that a search checks for bends and places; chosen
# Points this near the hand along the string cannot be far from the last link.
NEIGHBOURS = 2
FREE_OF_HAND_M = 0.06  # the same in space, where segments are shorter; chosen
# The tip must be visible this long before and after the closest approach. Chosen: ten frames at 500 Hz.
VISIBLE_S = 0.02
# No cord stretches more (chosen): a model that does says nothing about where the string will be.
STRETCHED = 1.1
FAILED_M = 1.0  # miss, outside, touch and hidden of a rollout whose simulation failed


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
    """

    radius_m: np.ndarray
    box: np.ndarray


def assess_rollouts(task: AnyTask, rollouts: Rollouts, clearance_m: float = 0.0) -> Assessment:
    """Assess rollouts by the task's objective; the string may come as near to the links as `clearance_m`."""
    room = Room(capsule_radii(task.arm, clearance_m), task.box())
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
    check = _check_all if rollouts.points_m.shape[3] == 2 else _check_all_in_space
    over_ranges(count, lambda first, last: check(first, last, rollouts, room, index, stride, finite, facts))
    return Assessment(np.where(finite, miss[0], FAILED_M), np.where(finite, index, 0), *facts)


def side_by_side(lots: list[tuple[Assessment, int]]) -> tuple[Assessment, int]:
    """Merge the assessments of P motions, each with its number of strings; return the strings' number too."""
    columns = zip(*([column.reshape(-1, strings) for column in lot] for lot, strings in lots), strict=True)
    merged = Assessment(*(np.concatenate(column, axis=1).ravel() for column in columns))
    return merged, sum(strings for _, strings in lots)


@njit(cache=True)
def _check(
    rollouts: Rollouts, b: int, room: Room, hit: int, stride: int
) -> tuple[float, float, float, float]:
    """Return fold, outside, touch, hidden (see `Assessment`) of rollout `b`, which is nearest at `hit`.

    Place and touch are those of a cord that does not stretch: the directions are the model's, no segment is
    longer than a cord's can be.
    """
    points, last, spacing_m = rollouts.points_m[b], rollouts.last[b], rollouts.spacing_m
    capsules = rollouts.capsules_m[b // (len(rollouts.points_m) // len(rollouts.capsules_m))]
    around = round(VISIBLE_S / rollouts.step_s)
    n = points.shape[1] - 1
    box = room.box
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
                deep = _depth(x, y, capsules[t], room.radius_m)
                if before_hit and i > NEIGHBOURS:
                    touch = max(touch, deep)
                if at_hit and i >= last_third:
                    hidden = max(hidden, deep)
    return 1.0 - least, outside, touch, hidden


@njit(cache=True)
def _depth(x: float, y: float, capsules: np.ndarray, radius_m: np.ndarray) -> float:
    """How deep a place is in capsules (S, 2, 2), 0 if in none."""
    deepest = 0.0
    for j in range(len(capsules)):
        ax, ay = capsules[j, 0, 0], capsules[j, 0, 1]
        dx, dy = capsules[j, 1, 0] - ax, capsules[j, 1, 1] - ay
        px, py = x - ax, y - ay
        s = min(1.0, max(0.0, (px * dx + py * dy) / max(dx * dx + dy * dy, 1e-300)))
        px, py = px - s * dx, py - s * dy
        within, away2 = radius_m[j] - deepest, px * px + py * py
        # Most places are far away: skip the square root for them.
        if within > 0.0 and away2 < within * within:
            deepest = radius_m[j] - math.sqrt(away2)
    return deepest


@njit(cache=True)
def _is_finite(points: np.ndarray, last: int) -> bool:
    """Whether a rollout (T, n+1, 2) is finite until sample `last`: what diverged once stays so."""
    for i in range(points.shape[1]):
        if not (math.isfinite(points[last, i, 0]) and math.isfinite(points[last, i, 1])):
            return False
    return True


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
        if not _is_finite(points[b], rollouts.last[b]):
            continue
        finite[b] = True
        k = index[b]
        facts[0, b], facts[1, b], facts[2, b], facts[3, b] = _check(rollouts, b, room, k, stride)
        if k > 0:
            dx = points[b, k, -1, 0] + bias[b, k, 0] - points[b, k - 1, -1, 0] - bias[b, k - 1, 0]
            dy = points[b, k, -1, 1] + bias[b, k, 1] - points[b, k - 1, -1, 1] - bias[b, k - 1, 1]
            facts[4, b] = math.sqrt(dx * dx + dy * dy) / rollouts.step_s


@njit(cache=True, nogil=True)
def _check_all_in_space(
    first: int,
    last: int,
    rollouts: Rollouts,
    room: Room,
    index: np.ndarray,
    stride: int,
    finite: np.ndarray,
    facts: np.ndarray,
) -> None:
    """Do the same as `_check_all` in space, where no single camera's view hides the tip."""
    points, bias = rollouts.points_m, rollouts.tip_bias_m
    step = np.empty(3)
    for b in range(first, last):
        if not np.isfinite(points[b, rollouts.last[b]]).all():
            continue
        finite[b] = True
        k = index[b]
        facts[0, b], facts[1, b], facts[2, b] = _check_in_space(rollouts, b, room, k, stride)
        facts[3, b] = 0.0
        if k > 0:
            step[:] = points[b, k, -1] + bias[b, k] - points[b, k - 1, -1] - bias[b, k - 1]
            facts[4, b] = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2) / rollouts.step_s


@njit(cache=True)
def _check_in_space(
    rollouts: Rollouts, b: int, room: Room, hit: int, stride: int
) -> tuple[float, float, float]:
    """Return fold, outside and touch; see `_check`."""
    points, spacing_m = rollouts.points_m[b], rollouts.spacing_m
    capsules = rollouts.capsules_m[b // (len(rollouts.points_m) // len(rollouts.capsules_m))]
    near = math.ceil(FREE_OF_HAND_M / spacing_m)
    least, outside, touch = 1.0, 0.0, 0.0
    place, along, before = np.empty(3), np.empty(3), np.empty(3)
    for t in range(0, rollouts.last[b] + 1, stride):
        for axis in range(3):
            place[axis] = points[t, 0, axis]
        outside = max(outside, _outside(place, room.box))
        for i in range(1, points.shape[1]):
            length = min(_direction(points[t, i - 1], points[t, i], along), STRETCHED * spacing_m)
            if t <= hit and i > 1:
                least = min(least, along[0] * before[0] + along[1] * before[1] + along[2] * before[2])
            for axis in range(3):
                before[axis] = along[axis]
                place[axis] += length * along[axis]
            outside = max(outside, _outside(place, room.box))
            if t <= hit and i > near:
                touch = max(touch, _depth_in_space(place, capsules[t], room.radius_m))
    return 1.0 - least, outside, touch


@njit(cache=True)
def _outside(place: np.ndarray, box: np.ndarray) -> float:
    """How far a place (3,) is outside a box (3, 2), below 0 inside."""
    out = -math.inf
    for axis in range(3):
        out = max(out, box[axis, 0] - place[axis], place[axis] - box[axis, 1])
    return out


@njit(cache=True)
def _direction(start: np.ndarray, end: np.ndarray, along: np.ndarray) -> float:
    """Write the unit vector (3,) from start to end, and return their distance."""
    for axis in range(3):
        along[axis] = end[axis] - start[axis]
    length = max(math.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2), 1e-300)
    for axis in range(3):
        along[axis] /= length
    return length


@njit(cache=True)
def _depth_in_space(place: np.ndarray, capsules: np.ndarray, radius_m: np.ndarray) -> float:
    """How deep a place (3,) is in capsules (S, 2, 3), 0 if in none."""
    deepest = 0.0
    for j in range(len(capsules)):
        inside, square = 0.0, 1e-300
        for axis in range(3):
            step = capsules[j, 1, axis] - capsules[j, 0, axis]
            inside += (place[axis] - capsules[j, 0, axis]) * step
            square += step * step
        share, away2 = min(1.0, max(0.0, inside / square)), 0.0
        for axis in range(3):
            start = capsules[j, 0, axis]
            away2 += (place[axis] - start - share * (capsules[j, 1, axis] - start)) ** 2
        within = radius_m[j] - deepest
        if within > 0.0 and away2 < within * within:
            deepest = radius_m[j] - math.sqrt(away2)
    return deepest
