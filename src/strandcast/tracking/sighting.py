"""Seeing the string: grey levels across a predicted chain, how like a thin line they are, the best way along.

A string is told from the arm by its thinness: the middle must differ from both flanks. It is told from the
background by having changed: the middle must differ from the learned background. Before the background the
first follows from the difference alone; before the moving arm, which has changed too, from the picture.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from strandcast.camera.sampling import bilinear
from strandcast.tracking.pixelmap import to_pixel

STEP_PX = 0.5  # spacing of samples across the string
GAP_PX = 1.0  # between the middle and its flanks: the lens's blur
FLANK_PX = 2.0  # width of a flank
COVER_NOISES = 3.0  # a change of both flanks, in noises, from which something lies before the string
LEAST_COVER = 5.0  # grey levels


@njit(cache=True)
def changed_by(difference: float, polarity: float) -> float:
    """Return how much a place has changed in the string's sense; 0 if in the other."""
    return abs(difference) if polarity == 0 else max(0.0, polarity * difference)


@njit(cache=True)
def sample_across(
    image: np.ndarray,
    background: np.ndarray,
    nodes: np.ndarray,
    normals: np.ndarray,
    pitch_m: float,
    half: int,
    along: int,
    polarity: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Sample grey levels along the normal of each node.

    Parameters
    ----------
    image, background
        Grey pictures (H, W).
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
    origin, step, uv
        The pixel map.

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
        u0, v0 = to_pixel(nodes[k, 0], nodes[k, 1], origin, step, uv)
        if u0 < 0 or v0 < 0:
            continue
        u1, v1 = to_pixel(
            nodes[k, 0] + pitch_m * normals[k, 0], nodes[k, 1] + pitch_m * normals[k, 1], origin, step, uv
        )
        du, dv = u1 - u0, v1 - v0
        for w in range(width):
            u = u0 + (w - half) * du
            v = v0 + (w - half) * dv
            now = was = 0.0
            for a in range(-along, along + 1):
                now += share * bilinear(image, u - a * dv, v + a * du)
                was += share * bilinear(background, u - a * dv, v + a * du)
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
    half = width // 2
    best = np.full(width, -1e9)
    best[half] = 0.0
    origin = np.zeros((count, width), dtype=np.int16)
    for k in range(1, count):
        new = np.full(width, -1e9)
        for w in range(width):
            reward = min(max(score[k, w], -0.2), 1.0)
            for jump in range(-largest_jump, largest_jump + 1):
                before = w + jump
                if before < 0 or before >= width:
                    continue
                value = best[before] - stiffness * jump * jump + reward
                if value > new[w]:
                    new[w] = value
                    origin[k, w] = before
        best = new
    way = np.empty(count, dtype=np.int64)
    way[count - 1] = np.argmax(best)
    for k in range(count - 1, 0, -1):
        way[k - 1] = origin[k, way[k]]
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


@njit(cache=True)
def inside_box(x: float, y: float, box: np.ndarray) -> bool:
    """Tell whether a place (m) lies in a box: x, y and angle of its frame, low x, low y, high x, high y.

    The hand's markers are full of thin lines, and the hand hides the string: what is seen there is none.
    """
    cosine, sine = np.cos(box[2]), np.sin(box[2])
    dx, dy = x - box[0], y - box[1]
    along, left = cosine * dx + sine * dy, -sine * dx + cosine * dy
    return box[3] <= along <= box[5] and box[4] <= left <= box[6]


@njit(cache=True)
def is_covered(
    image: np.ndarray, background: np.ndarray, u: float, v: float, nu: float, nv: float, half_px: float,
    noise: float,
) -> bool:  # fmt: skip
    """Tell whether both flanks of a line at a pixel, with normal (nu, nv), differ from the background."""
    least = max(COVER_NOISES * noise, LEAST_COVER)
    for side in (-1.0, 1.0):
        changed = 0.0
        for a in range(3):
            d = side * (half_px + GAP_PX + 1.0 + a)
            pu, pv = u + d * nu, v + d * nv
            changed += (bilinear(image, pu, pv) - bilinear(background, pu, pv)) / 3.0
        if abs(changed) < least:
            return False
    return True


@njit(cache=True)
def is_blind(background: np.ndarray, u: float, v: float, blind: np.ndarray) -> bool:
    """Tell whether the background at a pixel is so like the string that it would not be seen there."""
    return blind[0] <= bilinear(background, u, v) <= blind[1]
