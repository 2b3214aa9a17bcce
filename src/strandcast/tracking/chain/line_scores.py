"""Line scores across a chain: how clearly the string shows at each node and beside it."""

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.profiles import FLANK_PX, STEP_PX, line_score, sample_across
from strandcast.tracking.chain.search_window import GAP_PX, HandBox, SearchWindow, inside_box, near_box


class LineScores(NamedTuple):
    """Line scores across a chain, in samples along the normal of each node."""

    nodes: np.ndarray  # (K, 2)
    normals: np.ndarray  # unit vectors (K, 2)
    score: np.ndarray  # in clear lines, (K, W)
    line_half: np.ndarray  # half width of the line in samples, (K,)
    half: int  # the middle sample
    pitch_m: float  # spacing of samples


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
