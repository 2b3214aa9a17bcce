"""Grey-level profiles across a predicted chain: their line score, and the best path along the chain.

The string differs from the arm by being thin: the core must differ from both flanks. It differs from the
background by having changed: the core must differ from the learned background. In front of the background,
the difference alone shows both; in front of the moving arm, which has changed too, the image must show it.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.search_window import (
    GAP_PX,
    HandBox,
    SearchWindow,
    add_levels,
    corner_levels,
    inside_box,
    near_box,
)
from strandcast.tracking.pixel_map import to_pixel

STEP_PX = 0.5  # chosen: spacing of samples across the string
FLANK_PX = 2.0  # chosen: width of a flank


class LineScores(NamedTuple):
    """Line scores across a chain, in samples along the normal of each node."""

    nodes: np.ndarray  # (K, 2)
    normals: np.ndarray  # unit vectors (K, 2)
    score: np.ndarray  # in clear lines, (K, W)
    line_half: np.ndarray  # half width of the line in samples, (K,)
    half: int  # the middle sample
    pitch_m: float  # spacing of samples


@njit(cache=True)
def changed_by(difference: float, polarity: float) -> float:
    """Return the change of a place in the direction of the polarity; 0 if in the other."""
    return abs(difference) if polarity == 0 else max(0.0, polarity * difference)


@njit(cache=True)
def sample_across(
    window: SearchWindow,
    nodes: np.ndarray,
    normals: np.ndarray,
    pitch_m: float,
    half: int,
    along: int,
    polarity: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return grey levels along the normal of each node (K, 2), `half` samples to each side, `pitch_m` apart.

    Each sample is the mean of 2 along + 1 places one pitch apart along the string. Polarity as in
    `Appearance`. The two profiles (K, 2 half + 1) are the image (negative for polarity -1) and its change
    from the background.
    """
    count, width = len(nodes), 2 * half + 1
    level = np.zeros((count, width))
    difference = np.zeros((count, width))
    share = 1.0 / (2 * along + 1)
    u, v = np.empty(width), np.empty(width)
    corners = corner_levels(window, width)
    for k in range(count):
        u0, v0 = to_pixel(nodes[k, 0], nodes[k, 1], window.plane)
        if u0 < 0 or v0 < 0:
            continue
        u1, v1 = to_pixel(
            nodes[k, 0] + pitch_m * normals[k, 0], nodes[k, 1] + pitch_m * normals[k, 1], window.plane
        )
        du, dv = u1 - u0, v1 - v0
        for a in range(-along, along + 1):
            for w in range(width):
                u[w] = u0 + (w - half) * du - a * dv
                v[w] = v0 + (w - half) * dv + a * du
            add_levels(window, u, v, share, level[k], difference[k], corners)
        for w in range(width):
            now, was = level[k, w], difference[k, w]
            level[k, w] = now if polarity >= 0 else -now
            difference[k, w] = changed_by(now - was, polarity)
    return level, difference


@njit(cache=True)
def line_score(level: np.ndarray, difference: np.ndarray, middle: np.ndarray, polarity: float) -> np.ndarray:
    """Return how well each place of each profile matches a thin, changed line: (K, W) grey levels.

    Negative where there is no line. `middle` (K,) is the line's half width in samples: half the string's
    thickness and half its blur.
    """
    count, width = level.shape
    gap, flank = int(GAP_PX / STEP_PX + 0.5), int(FLANK_PX / STEP_PX + 0.5)
    score = np.full((count, width), -1.0)
    either = polarity == 0
    sums = np.zeros((2, width + 1))
    for k in range(count):
        core = 2 * middle[k] + 1
        reach = middle[k] + gap + flank
        for w in range(width):
            sums[0, w + 1] = sums[0, w] + level[k, w]
            sums[1, w + 1] = sums[1, w] + difference[k, w]
        # Sums up to the edges of left flank, core and right flank, for one place after the other: as views,
        # so that many places are scored at a time.
        inner, outer = flank + gap, reach + middle[k] + 1 + gap
        a, b, c, d, e, f = (
            sums[:, 0:],
            sums[:, flank:],
            sums[:, inner:],
            sums[:, inner + core :],
            sums[:, outer:],
            sums[:, outer + flank :],
        )
        place = score[k, reach:]
        for w in range(width - 2 * reach):
            level_left, changed_left = (b[0, w] - a[0, w]) / flank, (b[1, w] - a[1, w]) / flank
            level_in, changed = (d[0, w] - c[0, w]) / core, (d[1, w] - c[1, w]) / core
            level_right, changed_right = (f[0, w] - e[0, w]) / flank, (f[1, w] - e[1, w]) / flank
            against_background = changed - max(changed_left, changed_right)
            line = level_in - max(level_left, level_right)
            opposite = min(level_left, level_right) - level_in
            line = max(line, opposite) if either else line
            in_picture = min(line, changed)
            place[w] = max(against_background, in_picture)
    return score


@njit(cache=True)
def best_path(score: np.ndarray, stiffness: float, largest_jump: int) -> np.ndarray:
    """Return the sample (K,) of each profile on the best smooth path from the middle of the first (Viterbi).

    `score` (K, W) is in clear lines and counts up to 1, so that bright spots do not attract the path.
    `stiffness` is the cost of a jump of one sample squared, `largest_jump` in samples per node.
    """
    count, width = score.shape
    spare = largest_jump
    best = np.full(width + 2 * spare, -1e9)
    best[spare + width // 2] = 0.0
    origin = np.zeros((count, width), dtype=np.int64)
    new, jumped = np.empty(width), np.empty(width)
    for k in range(1, count):
        for w in range(width):
            new[w], jumped[w] = best[w + spare], 0.0
        for jump in range(-largest_jump, largest_jump + 1):
            cost, size = stiffness * jump * jump, float(jump)
            before = best[spare + jump : spare + jump + width]
            for w in range(width):  # without branches, and in one type: many places at a time
                value = before[w] - cost
                better = value > new[w]
                new[w] = value if better else new[w]
                jumped[w] = size if better else jumped[w]
        for w in range(width):
            best[w + spare] = new[w] + min(max(score[k, w], -0.2), 1.0)
            origin[k, w] = int(jumped[w])
    path = np.empty(count, dtype=np.int64)
    path[count - 1] = np.argmax(best[spare : spare + width])
    for k in range(count - 1, 0, -1):
        path[k - 1] = path[k] + origin[k, path[k]]
    return path


@njit(cache=True)
def line_centre(score: np.ndarray, path: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return the sub-sample place (K,) of the line near `path`: the centroid of the score around it."""
    count, width = score.shape
    place = np.empty(count)
    for k in range(count):
        reach = middle[k] + 1
        total = moment = 0.0
        for w in range(max(0, path[k] - reach), min(width, path[k] + reach + 1)):
            value = max(score[k, w], 0.0)
            total += value * value
            moment += value * value * w
        place[k] = moment / total if total > 0 else float(path[k])
    return place


@njit(cache=True, inline="always")
def score_across(
    window: SearchWindow,
    nodes: np.ndarray,
    normals: np.ndarray,
    half_px: np.ndarray,
    appearance: Appearance,
    reach_px: float,
) -> LineScores:
    """Return the line scores across a chain's nodes (K, 2)."""
    line_half = np.maximum(1, np.rint(half_px / STEP_PX)).astype(np.int64)
    half = int(reach_px / STEP_PX + 0.5) + line_half.max() + int((GAP_PX + FLANK_PX) / STEP_PX + 0.5)
    pitch_m = STEP_PX * window.plane.metre_per_pixel
    level, difference = sample_across(window, nodes, normals, pitch_m, half, 0, appearance.polarity)
    score = line_score(level, difference, line_half, appearance.polarity)
    thin = half_px.min()
    for k in range(len(score)):
        # Blur spreads a line over more width. By number: numba takes 3 s to compile it for a whole row.
        clearer = half_px[k] / (thin * appearance.contrast)
        for w in range(score.shape[1]):
            score[k, w] *= clearer
    return LineScores(nodes, normals, score, line_half, half, pitch_m)


@njit(cache=True)
def rewards_near(lines: LineScores, fitted: np.ndarray) -> np.ndarray:
    """Return the score (K,) at the fitted nodes (K, 2), within one pixel, in clear lines."""
    nodes, normals, score = lines.nodes, lines.normals, lines.score
    reward = np.zeros(len(nodes))
    spare = int(1.0 / STEP_PX)
    for k in range(len(nodes)):
        off_m = (fitted[k, 0] - nodes[k, 0]) * normals[k, 0] + (fitted[k, 1] - nodes[k, 1]) * normals[k, 1]
        w = lines.half + int(np.round(off_m / lines.pitch_m))
        for near in range(max(0, w - spare), min(score.shape[1], w + spare + 1)):
            reward[k] = max(reward[k], min(score[k, near], 1.0))
    return reward


@njit(cache=True)
def blank_hand(lines: LineScores, box: HandBox) -> None:
    """Set the scores of places in the hand's box to 0, in place."""
    nodes, normals = lines.nodes, lines.normals
    for k in range(len(nodes)):
        if not near_box(nodes[k, 0], nodes[k, 1], box, lines.half * lines.pitch_m):
            continue
        for w in range(lines.score.shape[1]):
            across = (w - lines.half) * lines.pitch_m
            if inside_box(nodes[k, 0] + across * normals[k, 0], nodes[k, 1] + across * normals[k, 1], box):
                lines.score[k, w] = 0.0
