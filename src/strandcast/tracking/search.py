"""Finding the string anew: from the clamp along whatever looks like a thin line, many ways at once."""

from __future__ import annotations

import numpy as np
from numba import njit

from strandcast.tracking.picture import (
    GAP_PX,
    Looks,
    Picture,
    inside_box,
    is_blind,
    is_covered,
    is_outside,
    levels_at,
)
from strandcast.tracking.pixelmap import to_pixel
from strandcast.tracking.sighting import FLANK_PX, changed_by

STRIDE = 2  # links that a way goes on at a time
TURNS_RAD = np.array([0.0, 0.15, -0.15, 0.32, -0.32, 0.55, -0.55, 0.85, -0.85])
TURN_COST = 0.35  # in clear lines, for a turn of 0.7 rad
FAN = 33  # directions in which the string may leave the clamp
CLAMP_COST = 0.06  # for leaving the clamp a radian off its direction
LEAST_REWARD = -0.3  # of a place without a line
EMPTY_COST = 0.15  # of a place in the open: ways go rather where nothing can be seen than where nothing is
CELL_PX = 2.5  # ways that meet in one such cell with like headings are one way
CELL_RAD = 0.4
RETRACE_COST = 1.2  # for a place along the way's own earlier part
TABLE = 1024  # cells remembered, a power of two: many more than beams


@njit(cache=True)
def line_at(
    picture: Picture, u: float, v: float, nu: float, nv: float, half_px: float, polarity: float
) -> float:
    """Return the line score (grey levels) at a pixel, for a line with normal (nu, nv) in the picture."""
    level = changed = 0.0
    for a in range(-1, 2):
        pu, pv = u + 0.7 * a * half_px * nu, v + 0.7 * a * half_px * nv
        now, was = levels_at(picture, pu, pv)
        level += now / 3.0
        changed += changed_by(now - was, polarity) / 3.0
    flank_level = np.zeros(2)
    flank_changed = np.zeros(2)
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for a in range(2):
            d = sign * (half_px + GAP_PX + (0.25 + 0.5 * a) * FLANK_PX)
            now, was = levels_at(picture, u + d * nu, v + d * nv)
            flank_level[side] += 0.5 * now
            flank_changed[side] += 0.5 * changed_by(now - was, polarity)
    dark = min(flank_level[0], flank_level[1]) - level
    bright = level - max(flank_level[0], flank_level[1])
    line = bright if polarity > 0 else (dark if polarity < 0 else max(dark, bright))
    in_picture = min(line, changed)
    return max(changed - max(flank_changed[0], flank_changed[1]), in_picture)


@njit(cache=True)
def retraces(
    way_x: np.ndarray, way_y: np.ndarray, way_angle: np.ndarray, parent: np.ndarray, level: int, beam: int,
    near_m: float,
) -> bool:  # fmt: skip
    """Tell whether a way's newest place (level + 1) lies along its own earlier part; crossing is allowed."""
    x, y, angle = way_x[level + 1, beam], way_y[level + 1, beam], way_angle[level + 1, beam]
    b = parent[level + 1, beam]
    for k in range(level, 0, -1):
        near = (way_x[k, b] - x) ** 2 + (way_y[k, b] - y) ** 2 < near_m * near_m
        if k < level - 3 and near and abs(np.sin(way_angle[k, b] - angle)) < 0.5:
            return True
        b = parent[k, b]
    return False


@njit(cache=True)
def reward_at(picture: Picture, x: float, y: float, angle: float, half_px: float, looks: Looks) -> float:
    """Return what a place (m) on a way with this heading is worth, in clear lines; 0 where none is seen."""
    u, v = to_pixel(x, y, picture.plane)
    if is_outside(picture, u, v, 1.0):
        return LEAST_REWARD
    if inside_box(x, y, picture.hand_box):
        return 0.0
    u2, v2 = to_pixel(x - 1e-3 * np.sin(angle), y + 1e-3 * np.cos(angle), picture.plane)
    length = np.hypot(u2 - u, v2 - v)
    nu, nv = (u2 - u) / length, (v2 - v) / length
    score = line_at(picture, u, v, nu, nv, half_px, looks.polarity)
    reward = min(max(score / looks.contrast, LEAST_REWARD), 1.0) - EMPTY_COST
    if reward < 0 and (
        is_blind(picture, u, v, looks) or is_covered(picture, u, v, nu, nv, half_px, looks.noise)
    ):
        return 0.0
    return reward


@njit(cache=True)
def is_new(cells: np.ndarray, x: float, y: float, angle: float, cell_m: float) -> bool:
    """Tell whether no way has ended in this cell of place and heading yet, and note it (a hash table)."""
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
    picture: Picture,
    clamp_rad: float,
    link_m: float,
    links: int,
    looks: Looks,
    root: np.ndarray,
    guide: np.ndarray,
    guide_weight: float,
    beams: int,
) -> tuple[np.ndarray, float]:
    """Follow the string from the clamp by beam search.

    Parameters
    ----------
    picture, looks
        The frame, and what the string looks like.
    clamp_rad, root
        In which direction and where the string leaves the clamp.
    link_m, links
        Length and number of links.
    guide, guide_weight
        Nodes (links + 1, 2) near which the string is expected, and the cost of a squared distance (1/m²).
    beams
        Ways kept at a time.

    Returns
    -------
    heading, value
        Headings (links,), and the mean reward per link of the best way: 1 is a clear line throughout.
    """
    metre_per_pixel = picture.plane.metre_per_pixel
    half_px = looks.half_m / metre_per_pixel
    strides = (links + STRIDE - 1) // STRIDE
    stride_m = STRIDE * link_m
    way_x = np.empty((strides + 1, beams))
    way_y = np.empty((strides + 1, beams))
    way_angle = np.empty((strides + 1, beams))
    way_value = np.full((strides + 1, beams), -1e9)
    parent = np.zeros((strides + 1, beams), dtype=np.int64)
    kept = min(FAN, beams)
    for b in range(kept):
        turn = (b - FAN // 2) * (np.pi / (FAN // 2))
        way_x[0, b], way_y[0, b] = root[0], root[1]
        way_angle[0, b] = clamp_rad + turn
        way_value[0, b] = -CLAMP_COST * turn * turn
    turns = len(TURNS_RAD)
    near_m = 3.0 * metre_per_pixel
    cells = np.empty(TABLE, dtype=np.int64)
    candidates = np.empty((beams * turns, 4))
    for k in range(strides):
        for b in range(kept):
            for t in range(turns):
                angle = way_angle[k, b] + TURNS_RAD[t]
                x = way_x[k, b] + stride_m * np.cos(angle)
                y = way_y[k, b] + stride_m * np.sin(angle)
                reward = reward_at(picture, x, y, angle, half_px, looks)
                guided = guide[min((k + 1) * STRIDE, links)]
                off = (x - guided[0]) ** 2 + (y - guided[1]) ** 2
                cost = TURN_COST * (TURNS_RAD[t] / 0.7) ** 2 + min(guide_weight * off, 0.5)
                one = candidates[b * turns + t]
                one[0], one[1], one[2], one[3] = x, y, angle, way_value[k, b] + reward - cost
        order = np.argsort(-candidates[: kept * turns, 3], kind="mergesort")
        cells[:] = -1
        kept = 0
        for c in order:
            x, y, angle, value = candidates[c]
            if not is_new(cells, x, y, angle, CELL_PX * metre_per_pixel):
                continue
            way_x[k + 1, kept], way_y[k + 1, kept], way_angle[k + 1, kept] = x, y, angle
            way_value[k + 1, kept] = value
            parent[k + 1, kept] = c // turns
            if retraces(way_x, way_y, way_angle, parent, k, kept, near_m):
                way_value[k + 1, kept] -= RETRACE_COST
            kept += 1
            if kept == beams:
                break
    heading = np.empty(links)
    best = int(np.argmax(way_value[strides, :kept]))
    b = best
    for k in range(strides, 0, -1):
        heading[(k - 1) * STRIDE : k * STRIDE] = way_angle[k, b]
        b = parent[k, b]
    return heading, way_value[strides, best] / strides
