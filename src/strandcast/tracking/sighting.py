"""Seeing the string: grey levels across a predicted chain, how like a thin line they are, the best way along.

A string is told from the arm by its thinness: the middle must differ from both flanks. It is told from the
background by having changed: the middle must differ from the learned background. Before the background the
first follows from the difference alone; before the moving arm, which has changed too, from the picture.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from strandcast.tracking.picture import GAP_PX, Picture, levels_at
from strandcast.tracking.pixelmap import to_pixel

STEP_PX = 0.5  # spacing of samples across the string
FLANK_PX = 2.0  # width of a flank


@njit(cache=True)
def changed_by(difference: float, polarity: float) -> float:
    """Return how much a place has changed in the string's sense; 0 if in the other."""
    return abs(difference) if polarity == 0 else max(0.0, polarity * difference)


@njit(cache=True)
def sample_across(
    picture: Picture,
    nodes: np.ndarray,
    normals: np.ndarray,
    pitch_m: float,
    half: int,
    along: int,
    polarity: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Sample grey levels along the normal of each node.

    Parameters
    ----------
    picture
        The frame.
    nodes, normals
        (K, 2), m and unit vectors.
    pitch_m
        Spacing of the samples.
    half
        Samples to each side: the profiles have 2 half + 1.
    along
        Each sample is the mean of 2 along + 1 places one pitch apart along the string.
    polarity
        1 for a string brighter than the background, -1 for a darker one, 0 if either may be.

    Returns
    -------
    level, difference
        Profiles (K, 2 half + 1): the picture (negative for polarity -1), its change from the background.
    """
    count, width = len(nodes), 2 * half + 1
    level = np.zeros((count, width))
    difference = np.zeros((count, width))
    share = 1.0 / (2 * along + 1)
    for k in range(count):
        u0, v0 = to_pixel(nodes[k, 0], nodes[k, 1], picture.plane)
        if u0 < 0 or v0 < 0:
            continue
        u1, v1 = to_pixel(
            nodes[k, 0] + pitch_m * normals[k, 0], nodes[k, 1] + pitch_m * normals[k, 1], picture.plane
        )
        du, dv = u1 - u0, v1 - v0
        for w in range(width):
            u = u0 + (w - half) * du
            v = v0 + (w - half) * dv
            now = was = 0.0
            for a in range(-along, along + 1):
                one, other = levels_at(picture, u - a * dv, v + a * du)
                now += share * one
                was += share * other
            level[k, w] = now if polarity >= 0 else -now
            difference[k, w] = changed_by(now - was, polarity)
    return level, difference


@njit(cache=True)
def line_score(level: np.ndarray, difference: np.ndarray, middle: np.ndarray, polarity: float) -> np.ndarray:
    """Score how much each place of each profile looks like the middle of a thin, changed line.

    Parameters
    ----------
    level, difference
        Profiles (K, W) of `sample_across`.
    middle
        Half width of the line in samples, (K,): half the string's thickness and half its blur.
    polarity
        As in `sample_across`.

    Returns
    -------
    score
        Grey levels, (K, W); negative where it is no line.
    """
    count, width = level.shape
    gap, flank = int(GAP_PX / STEP_PX + 0.5), int(FLANK_PX / STEP_PX + 0.5)
    score = np.full((count, width), -1.0)
    sum_level = np.zeros(width + 1)
    sum_difference = np.zeros(width + 1)
    for k in range(count):
        h = middle[k]
        for w in range(width):
            sum_level[w + 1] = sum_level[w] + level[k, w]
            sum_difference[w + 1] = sum_difference[w] + difference[k, w]
        reach = h + gap + flank
        for w in range(reach, width - reach):
            a, b = w - h, w + h + 1
            inner, outer = a - gap, b + gap
            level_in = (sum_level[b] - sum_level[a]) / (b - a)
            level_left = (sum_level[inner] - sum_level[inner - flank]) / flank
            level_right = (sum_level[outer + flank] - sum_level[outer]) / flank
            changed = (sum_difference[b] - sum_difference[a]) / (b - a)
            changed_left = (sum_difference[inner] - sum_difference[inner - flank]) / flank
            changed_right = (sum_difference[outer + flank] - sum_difference[outer]) / flank
            against_background = changed - max(changed_left, changed_right)
            line = level_in - max(level_left, level_right)
            if polarity == 0:
                line = max(line, min(level_left, level_right) - level_in)
            in_picture = min(line, changed)
            score[k, w] = max(against_background, in_picture)
    return score


@njit(cache=True)
def best_way(score: np.ndarray, stiffness: float, largest_jump: int) -> np.ndarray:
    """Return the sample (K,) of each profile on the best smooth way from the middle of the first (Viterbi).

    Parameters
    ----------
    score
        (K, W) of `line_score` in units of a clear line's; profile 0 is the root, where the way starts at the
        middle sample. Rewards are capped at 1, so that bright spots do not draw the way aside.
    stiffness
        Cost of a jump of one sample squared, in clear lines.
    largest_jump
        Samples per node.
    """
    count, width = score.shape
    spare = largest_jump
    best = np.full(width + 2 * spare, -1e9)
    best[spare + width // 2] = 0.0
    origin = np.zeros((count, width), dtype=np.int64)
    new = np.empty(width)
    for k in range(1, count):
        for w in range(width):
            new[w] = best[w + spare]
            origin[k, w] = 0
        for jump in range(-largest_jump, largest_jump + 1):
            cost = stiffness * jump * jump
            for w in range(width):
                value = best[w + spare + jump] - cost
                if value > new[w]:
                    new[w] = value
                    origin[k, w] = jump
        for w in range(width):
            best[w + spare] = new[w] + min(max(score[k, w], -0.2), 1.0)
    way = np.empty(count, dtype=np.int64)
    way[count - 1] = np.argmax(best[spare : spare + width])
    for k in range(count - 1, 0, -1):
        way[k - 1] = way[k] + origin[k, way[k]]
    return way


@njit(cache=True)
def centre_of_line(
    difference: np.ndarray, score: np.ndarray, way: np.ndarray, middle: np.ndarray
) -> np.ndarray:
    """Return the sub-sample place (K,) of the line near `way`: the centroid of the score around it."""
    count, width = score.shape
    place = np.empty(count)
    for k in range(count):
        reach = middle[k] + 1
        total = moment = 0.0
        for w in range(max(0, way[k] - reach), min(width, way[k] + reach + 1)):
            value = max(score[k, w], 0.0)
            total += value * value
            moment += value * value * w
        place[k] = moment / total if total > 0 else float(way[k])
    return place
