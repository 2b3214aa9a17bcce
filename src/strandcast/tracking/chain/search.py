"""Detect the string without a prediction: a beam search from the clamp along thin lines."""

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.profiles import FLANK_PX, changed_by
from strandcast.tracking.chain.search_window import (
    GAP_PX,
    SearchWindow,
    inside_box,
    is_camouflaged,
    is_covered,
    is_outside,
    levels_at,
)
from strandcast.tracking.pixel_map import to_pixel

# All chosen on the drawn and lab videos of the tracking benchmark.
BEAMS = 60  # paths kept at a time
TURN_COST = 0.35  # in clear lines, for a turn of 0.7 rad
FAN = 33  # directions in which the string may leave the clamp
CLAMP_COST = 0.06  # for leaving the clamp one radian off its direction
LEAST_REWARD = -0.3  # of a place without a line
EMPTY_COST = 0.15  # of an open place: paths prefer places where nothing can be visible to empty ones
CELL_PX = 2.5  # paths that meet in one such cell with similar headings are one path
CELL_RAD = 0.4
RETRACE_COST = 1.2  # for a place along the path's own earlier part
TABLE = 1024  # remembered cells, a power of two: many more than beams


class Guide(NamedTuple):
    """Nodes (links + 1, 2) near which the string is expected, and the cost of a squared distance (1/m²)."""

    nodes: np.ndarray
    weight: float


class Stride(NamedTuple):
    """How a path grows at a time: by how many links, and by which turns (rad)."""

    links: int
    turns_rad: np.ndarray


# Short strides follow loops of 3 cm, but also more of what is not the string.
LONG = Stride(2, np.array([0.0, 0.15, -0.15, 0.32, -0.32, 0.55, -0.55, 0.85, -0.85]))
SHORT = Stride(1, np.array([0.0, 0.15, -0.15, 0.32, -0.32, 0.55, -0.55, 0.85, -0.85, 1.2, -1.2]))


class CandidatePaths(NamedTuple):
    """A tree of paths by level and beam (strides + 1, beams): place (m), heading, value, parent's beam."""

    x: np.ndarray
    y: np.ndarray
    angle: np.ndarray
    value: np.ndarray
    parent: np.ndarray


@njit(cache=True, inline="always")
def line_at(
    window: SearchWindow, u: float, v: float, nu: float, nv: float, half_px: float, polarity: float
) -> float:
    """Return the line score (grey levels) at a pixel, for a line with normal (nu, nv)."""
    level = changed = 0.0
    for a in range(-1, 2):
        pu, pv = u + 0.7 * a * half_px * nu, v + 0.7 * a * half_px * nv
        now, was = levels_at(window, pu, pv)
        level += now / 3.0
        changed += changed_by(now - was, polarity) / 3.0
    flank_level = np.zeros(2)
    flank_changed = np.zeros(2)
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for a in range(2):
            d = sign * (half_px + GAP_PX + (0.25 + 0.5 * a) * FLANK_PX)
            now, was = levels_at(window, u + d * nu, v + d * nv)
            flank_level[side] += 0.5 * now
            flank_changed[side] += 0.5 * changed_by(now - was, polarity)
    dark = min(flank_level[0], flank_level[1]) - level
    bright = level - max(flank_level[0], flank_level[1])
    line = bright if polarity > 0 else (dark if polarity < 0 else max(dark, bright))
    in_picture = min(line, changed)
    score: float = max(changed - max(flank_changed[0], flank_changed[1]), in_picture)
    return score


@njit(cache=True, inline="always")
def retraces(paths: CandidatePaths, level: int, beam: int, near_m: float) -> bool:
    """Return whether a path's newest place (level + 1) lies along its own earlier part; it may cross it."""
    x, y = paths.x[level + 1, beam], paths.y[level + 1, beam]
    angle = paths.angle[level + 1, beam]
    b = paths.parent[level + 1, beam]
    for k in range(level, 0, -1):
        near = (paths.x[k, b] - x) ** 2 + (paths.y[k, b] - y) ** 2 < near_m * near_m
        if k < level - 3 and near and abs(np.sin(paths.angle[k, b] - angle)) < 0.5:
            return True
        b = paths.parent[k, b]
    return False


@njit(cache=True, inline="always")
def reward_at(
    window: SearchWindow, x: float, y: float, angle: float, half_px: float, appearance: Appearance
) -> float:
    """Return the reward of a place (m) on a path with this heading, in clear lines; 0 where it is hidden."""
    u, v = to_pixel(x, y, window.plane)
    if is_outside(window, u, v, 1.0):
        return LEAST_REWARD
    if inside_box(x, y, window.hand_box):
        return 0.0
    u2, v2 = to_pixel(x - 1e-3 * np.sin(angle), y + 1e-3 * np.cos(angle), window.plane)
    length = np.hypot(u2 - u, v2 - v)
    nu, nv = (u2 - u) / length, (v2 - v) / length
    score = line_at(window, u, v, nu, nv, half_px, appearance.polarity)
    reward: float = min(max(score / appearance.contrast, LEAST_REWARD), 1.0) - EMPTY_COST
    if reward < 0 and (
        is_camouflaged(window, u, v, appearance)
        or is_covered(window, u, v, nu, nv, half_px, appearance.noise)
    ):
        return 0.0
    return reward


@njit(cache=True)
def is_new(cells: np.ndarray, x: float, y: float, angle: float, cell_m: float) -> bool:
    """Return whether no path has reached this cell of place and heading yet, and note it (a hash table)."""
    turn = angle - 2 * np.pi * np.floor(angle / (2 * np.pi))
    row, column, sector = int(np.floor(y / cell_m)), int(np.floor(x / cell_m)), int(turn / CELL_RAD)
    key = ((row + (1 << 20)) << 30) | ((column + (1 << 20)) << 6) | sector
    slot = (key * 2654435761) & (len(cells) - 1)
    while cells[slot] != -1:
        if cells[slot] == key:
            return False
        slot = (slot + 1) & (len(cells) - 1)
    cells[slot] = key
    return True


@njit(cache=True, nogil=True)
def trace_string(
    window: SearchWindow,
    appearance: Appearance,
    root: np.ndarray,
    clamp_rad: float,
    link_m: float,
    links: int,
    stride: Stride,
    guide: Guide,
) -> tuple[np.ndarray, float]:
    """Trace the string by beam search from the clamp at `root` (2,).

    Returns the headings (links,) of the best path and its mean reward: 1 is a clear line throughout.
    """
    metre_per_pixel = window.plane.metre_per_pixel
    half_px = appearance.half_m / metre_per_pixel
    strides = (links + stride.links - 1) // stride.links
    stride_m = stride.links * link_m
    paths = start_paths(root, clamp_rad, strides)
    kept = min(FAN, BEAMS)
    turns = len(stride.turns_rad)
    cells = np.empty(TABLE, dtype=np.int64)
    candidates = np.empty((BEAMS * turns, 4))
    for k in range(strides):
        guided = guide.nodes[min((k + 1) * stride.links, links)]
        for b in range(kept):
            for t in range(turns):
                angle = paths.angle[k, b] + stride.turns_rad[t]
                x = paths.x[k, b] + stride_m * np.cos(angle)
                y = paths.y[k, b] + stride_m * np.sin(angle)
                reward = reward_at(window, x, y, angle, half_px, appearance)
                off = (x - guided[0]) ** 2 + (y - guided[1]) ** 2
                cost = TURN_COST * (stride.turns_rad[t] / 0.7) ** 2 + min(guide.weight * off, 0.5)
                one = candidates[b * turns + t]
                one[0], one[1], one[2], one[3] = x, y, angle, paths.value[k, b] + reward - cost
        cells[:] = -1
        kept = keep_best(paths, k, candidates[: kept * turns], turns, cells, metre_per_pixel)
    best: tuple[np.ndarray, float] = best_headings(paths, kept, links, stride.links)
    return best


@njit(cache=True)
def start_paths(root: np.ndarray, clamp_rad: float, strides: int) -> CandidatePaths:
    """Return paths that start at the clamp, fanned out in direction."""
    shape = (strides + 1, BEAMS)
    x, y, angle, value = np.empty(shape), np.empty(shape), np.empty(shape), np.full(shape, -1e9)
    paths = CandidatePaths(x, y, angle, value, np.zeros(shape, dtype=np.int64))
    for b in range(min(FAN, BEAMS)):
        turn = (b - FAN // 2) * (np.pi / (FAN // 2))
        paths.x[0, b], paths.y[0, b] = root[0], root[1]
        paths.angle[0, b] = clamp_rad + turn
        paths.value[0, b] = -CLAMP_COST * turn * turn
    return paths


@njit(cache=True, inline="always")
def keep_best(
    paths: CandidatePaths,
    k: int,
    candidates: np.ndarray,
    turns: int,
    cells: np.ndarray,
    metre_per_pixel: float,
) -> int:
    """Keep the best candidates (x, y, angle, value) (C, 4) as level k + 1; returns how many.

    Each beam of level k has `turns` candidates.
    """
    near_m = 3.0 * metre_per_pixel
    kept = 0
    for c in np.argsort(-candidates[:, 3], kind="mergesort"):
        x, y, angle, value = candidates[c]
        if not is_new(cells, x, y, angle, CELL_PX * metre_per_pixel):
            continue
        paths.x[k + 1, kept], paths.y[k + 1, kept], paths.angle[k + 1, kept] = x, y, angle
        paths.value[k + 1, kept] = value
        paths.parent[k + 1, kept] = c // turns
        if retraces(paths, k, kept, near_m):
            paths.value[k + 1, kept] -= RETRACE_COST
        kept += 1
        if kept == BEAMS:
            break
    return kept


@njit(cache=True)
def best_headings(paths: CandidatePaths, kept: int, links: int, stride: int) -> tuple[np.ndarray, float]:
    """Return the headings (links,) of the best of the kept paths, and its mean reward per stride."""
    strides = len(paths.x) - 1
    heading = np.empty(links)
    best = int(np.argmax(paths.value[strides, :kept]))
    b = best
    for k in range(strides, 0, -1):
        for j in range((k - 1) * stride, min(k * stride, links)):
            heading[j] = paths.angle[k, b]
        b = paths.parent[k, b]
    return heading, paths.value[strides, best] / strides
