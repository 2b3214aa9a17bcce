"""One look at the string: see across a chain, fit it to what is seen, and say how well each node is seen."""

from __future__ import annotations

import numpy as np
from numba import njit

from strandcast.tracking.chain import fit_headings, node_normals, place_nodes
from strandcast.tracking.sighting import (
    FLANK_PX,
    GAP_PX,
    STEP_PX,
    best_way,
    centre_of_line,
    inside_box,
    line_score,
    sample_across,
)  # fmt: skip

SIGHTING_PX = 0.45  # standard deviation of a sighting across a clear line
CLEAR = 0.25  # reward under which a sighting is not used
SIGMAS_RAD = np.array([0.2, 1.0, 0.8, 1.0])  # as `fit_headings` takes them
STIFFNESS = 0.012  # of the way across profiles, in clear lines per sample²


@njit(cache=True)
def score_in_clear_lines(score: np.ndarray, half_px: np.ndarray, contrast: float) -> None:
    """Divide line scores by that of a clear line, in place; blur spreads a line over more width."""
    thin = half_px.min()
    for k in range(len(score)):
        score[k] *= half_px[k] / (thin * contrast)


@njit(cache=True)
def look_and_fit(
    image: np.ndarray,
    background: np.ndarray,
    root: np.ndarray,
    clamp_rad: float,
    heading: np.ndarray,
    prior: np.ndarray,
    link_m: float,
    half_px: np.ndarray,
    contrast: float,
    polarity: float,
    box: np.ndarray,
    reach_px: float,
    tip: np.ndarray,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """See across the chain `heading` and fit it to what is seen; returns headings, rewards, fit matrix.

    `tip` says how far (m) the tip should move along and across the last link, with which weight (1/m²), and
    for how many of the last nodes the string itself is not looked at, because a ball hides it: along, weight,
    across, weight, nodes.
    """
    pitch_m = STEP_PX * metre_per_pixel
    middle = np.maximum(1, np.rint(half_px / STEP_PX)).astype(np.int64)
    margin = middle.max() + int((GAP_PX + FLANK_PX) / STEP_PX + 0.5)
    half = int(reach_px / STEP_PX + 0.5) + margin
    nodes = place_nodes(root, heading, link_m)
    normals = node_normals(heading)
    level, difference = sample_across(
        image, background, nodes, normals, pitch_m, half, 1, polarity, origin, step, uv
    )
    score = line_score(level, difference, middle, polarity)
    for k in range(len(nodes)):
        for w in range(score.shape[1]):
            across = (w - half) * pitch_m
            if inside_box(nodes[k, 0] + across * normals[k, 0], nodes[k, 1] + across * normals[k, 1], box):
                score[k, w] = 0.0
    score_in_clear_lines(score, half_px, contrast)
    jump = max(1, int(0.8 * link_m / pitch_m))
    way = best_way(score, STIFFNESS, jump)
    centre = centre_of_line(difference, score, way, middle)
    count = len(nodes)
    target = nodes.copy()
    weight = np.zeros(count)
    reward = np.zeros(count)
    for k in range(1, count):
        reward[k] = min(max(score[k, way[k]], 0.0), 1.0)
        across = (centre[k] - half) * pitch_m
        target[k, 0] += across * normals[k, 0]
        target[k, 1] += across * normals[k, 1]
        if reward[k] >= CLEAR and k < count - tip[4]:
            sigma = SIGHTING_PX * metre_per_pixel * (1.0 + 0.3 * half_px[k])
            weight[k] = (reward[k] / sigma) ** 2
    if tip[3] > 0:
        target[-1] = nodes[-1] + tip[2] * normals[-1]
        weight[-1] = tip[3]
    fitted, hessian = fit_headings(
        root, heading, link_m, target, normals, weight, tip[0], tip[1], prior, clamp_rad, SIGMAS_RAD, 2
    )
    return fitted, reward, hessian


@njit(cache=True)
def rewards_on(
    image: np.ndarray,
    background: np.ndarray,
    nodes: np.ndarray,
    heading: np.ndarray,
    half_px: np.ndarray,
    contrast: float,
    polarity: float,
    box: np.ndarray,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> np.ndarray:
    """Return the reward (K,) of each node where it is, give or take a pixel."""
    pitch_m = STEP_PX * metre_per_pixel
    middle = np.maximum(1, np.rint(half_px / STEP_PX)).astype(np.int64)
    half = 2 + middle.max() + int((GAP_PX + FLANK_PX) / STEP_PX + 0.5)
    level, difference = sample_across(
        image, background, nodes, node_normals(heading), pitch_m, half, 1, polarity, origin, step, uv
    )
    score = line_score(level, difference, middle, polarity)
    score_in_clear_lines(score, half_px, contrast)
    reward = np.empty(len(nodes))
    for k in range(len(nodes)):
        reward[k] = min(max(score[k, half - 2 : half + 3].max(), 0.0), 1.0)
        if inside_box(nodes[k, 0], nodes[k, 1], box):
            reward[k] = 0.0
    return reward


@njit(cache=True)
def seen_once(nodes: np.ndarray, heading: np.ndarray, near_m: float) -> np.ndarray:
    """Return 0 for nodes that lie along an earlier part of the chain, 1 for others (K,).

    A chain folded back onto itself would else count the same piece of string twice.
    """
    once = np.ones(len(nodes))
    for k in range(6, len(nodes)):
        for j in range(1, k - 4):
            close = (nodes[k, 0] - nodes[j, 0]) ** 2 + (nodes[k, 1] - nodes[j, 1]) ** 2 < near_m * near_m
            if close and abs(np.sin(heading[k - 1] - heading[j - 1])) < 0.4:
                once[k] = 0.0
                break
    return once
