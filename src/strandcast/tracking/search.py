"""Finding the string anew: from the clamp along whatever looks like a thin line, many ways at once."""

from __future__ import annotations

import numpy as np
from numba import njit

from strandcast.camera.sampling import bilinear
from strandcast.tracking.pixelmap import to_pixel
from strandcast.tracking.sighting import FLANK_PX, GAP_PX, changed_by, inside_box, is_blind, is_covered

TURNS_RAD = np.array([0.0, 0.12, -0.12, 0.25, -0.25, 0.4, -0.4, 0.6, -0.6])
TURN_COST = 0.35  # in clear lines, for a turn of half a radian
FAN = 33  # directions in which the string may leave the clamp
CLAMP_COST = 0.06  # for leaving the clamp a radian off its direction
LEAST_REWARD = -0.3  # of a place without a line
EMPTY_COST = 0.15  # of a place in the open: ways go rather where nothing can be seen than where nothing is
CELL_PX = 2.5  # ways that meet in one such cell with like headings are one way
CELL_RAD = 0.4


@njit(cache=True)
def line_at(
    image: np.ndarray, background: np.ndarray, u: float, v: float, nu: float, nv: float, half_px: float,
    polarity: float,
) -> float:  # fmt: skip
    """Return the line score (grey levels) at a pixel, for a line with normal (nu, nv) in the picture."""
    level = changed = 0.0
    for a in range(-1, 2):
        pu, pv = u + 0.7 * a * half_px * nu, v + 0.7 * a * half_px * nv
        now = bilinear(image, pu, pv)
        level += now / 3.0
        changed += changed_by(now - bilinear(background, pu, pv), polarity) / 3.0
    flank_level = np.zeros(2)
    flank_changed = np.zeros(2)
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for a in range(2):
            d = sign * (half_px + GAP_PX + (0.25 + 0.5 * a) * FLANK_PX)
            now = bilinear(image, u + d * nu, v + d * nv)
            flank_level[side] += 0.5 * now
            was = bilinear(background, u + d * nu, v + d * nv)
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
def reward_at(
    image: np.ndarray, background: np.ndarray, x: float, y: float, angle: float, half_px: float,
    contrast: float, polarity: float, noise: float, blind: np.ndarray, hand: np.ndarray,
    origin: np.ndarray, step: float, uv: np.ndarray,
) -> float:  # fmt: skip
    """Return what a place (m) on a way with this heading is worth, in clear lines; 0 where none is seen."""
    u, v = to_pixel(x, y, origin, step, uv)
    if not (0 < u < image.shape[1] - 1 and 0 < v < image.shape[0] - 1):
        return LEAST_REWARD
    if inside_box(x, y, hand):
        return 0.0
    u2, v2 = to_pixel(x - 1e-3 * np.sin(angle), y + 1e-3 * np.cos(angle), origin, step, uv)
    length = np.hypot(u2 - u, v2 - v)
    nu, nv = (u2 - u) / length, (v2 - v) / length
    score = line_at(image, background, u, v, nu, nv, half_px, polarity)
    reward = min(max(score / contrast, LEAST_REWARD), 1.0) - EMPTY_COST
    if reward < 0 and (
        is_blind(background, u, v, blind) or is_covered(image, background, u, v, nu, nv, half_px, noise)
    ):
        return 0.0
    return reward


@njit(cache=True)
def is_known(
    x: np.ndarray, y: np.ndarray, angle: np.ndarray, kept: int, new_x: float, new_y: float, new_angle: float,
    cell_m: float,
) -> bool:  # fmt: skip
    """Tell whether a way that ends so is among the first `kept` already."""
    for b in range(kept):
        near = abs(x[b] - new_x) < cell_m and abs(y[b] - new_y) < cell_m
        if near and abs(angle[b] - new_angle) < CELL_RAD:
            return True
    return False


@njit(cache=True)
def trace_string(
    image: np.ndarray,
    background: np.ndarray,
    root: np.ndarray,
    clamp_rad: float,
    link_m: float,
    links: int,
    half_px: float,
    contrast: float,
    polarity: float,
    noise: float,
    blind: np.ndarray,
    hand: np.ndarray,
    guide: np.ndarray,
    guide_weight: float,
    beams: int,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Follow the string from the clamp by beam search.

    Parameters
    ----------
    image, background
        Grey pictures.
    root, clamp_rad
        Where and in which direction the string leaves the clamp.
    link_m, links
        Length and number of links.
    half_px
        Half the string's visible width.
    contrast
        Line score of a clear line, grey levels.
    polarity
        As in `strandcast.tracking.sighting.sample_across`.
    noise
        Of what has not changed, grey levels.
    blind
        Lowest and highest grey level of a background before which the string is not seen.
    hand
        The box in which the hand hides the string, as in `inside_box`.
    guide, guide_weight
        Nodes (links + 1, 2) near which the string is expected, and the cost of a squared distance (1/m²).
    beams
        Ways kept at a time.

    Returns
    -------
    heading, value
        Headings (links,), and the mean reward per link of the best way: 1 is a clear line throughout.
    """
    way_x = np.empty((links + 1, beams))
    way_y = np.empty((links + 1, beams))
    way_angle = np.empty((links + 1, beams))
    way_value = np.full((links + 1, beams), -1e9)
    parent = np.zeros((links + 1, beams), dtype=np.int64)
    kept = min(FAN, beams)
    for b in range(kept):
        turn = (b - FAN // 2) * (np.pi / (FAN // 2))
        way_x[0, b], way_y[0, b] = root[0], root[1]
        way_angle[0, b] = clamp_rad + turn
        way_value[0, b] = -CLAMP_COST * turn * turn
    turns = len(TURNS_RAD)
    near_m = 3.0 * metre_per_pixel
    cand_x = np.empty(beams * turns)
    cand_y = np.empty(beams * turns)
    cand_angle = np.empty(beams * turns)
    cand_value = np.empty(beams * turns)
    cand_parent = np.empty(beams * turns, dtype=np.int64)
    for k in range(links):
        total = 0
        for b in range(kept):
            for turn in TURNS_RAD:
                angle = way_angle[k, b] + turn
                x = way_x[k, b] + link_m * np.cos(angle)
                y = way_y[k, b] + link_m * np.sin(angle)
                reward = reward_at(
                    image,
                    background,
                    x,
                    y,
                    angle,
                    half_px,
                    contrast,
                    polarity,
                    noise,
                    blind,
                    hand,
                    origin,
                    step,
                    uv,
                )
                off = (x - guide[k + 1, 0]) ** 2 + (y - guide[k + 1, 1]) ** 2
                cost = TURN_COST * (turn / 0.5) ** 2 + min(guide_weight * off, 0.5)
                cand_x[total], cand_y[total], cand_angle[total] = x, y, angle
                cand_value[total], cand_parent[total] = way_value[k, b] + reward - cost, b
                total += 1
        order = np.argsort(-cand_value[:total], kind="mergesort")
        cell_m = CELL_PX * metre_per_pixel
        kept = 0
        for c in order:
            if is_known(
                way_x[k + 1],
                way_y[k + 1],
                way_angle[k + 1],
                kept,
                cand_x[c],
                cand_y[c],
                cand_angle[c],
                cell_m,
            ):
                continue
            way_x[k + 1, kept], way_y[k + 1, kept] = cand_x[c], cand_y[c]
            way_angle[k + 1, kept], way_value[k + 1, kept] = cand_angle[c], cand_value[c]
            parent[k + 1, kept] = cand_parent[c]
            if retraces(way_x, way_y, way_angle, parent, k, kept, near_m):
                way_value[k + 1, kept] -= 1.2
            kept += 1
            if kept == beams:
                break
    heading = np.empty(links)
    b = int(np.argmax(way_value[links, :kept]))
    best = b
    for k in range(links, 0, -1):
        heading[k - 1] = way_angle[k, b]
        b = parent[k, b]
    return heading, way_value[links, best] / links
