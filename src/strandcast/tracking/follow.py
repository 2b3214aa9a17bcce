"""The string from one frame to the next: predict, see across, fit, hold the tip, and doubt the result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from strandcast.tracking.chain import fit_headings, node_normals, node_sigmas, place_nodes
from strandcast.tracking.pixelmap import PixelMap
from strandcast.tracking.search import trace_string
from strandcast.tracking.sighting import (
    FLANK_PX, GAP_PX, STEP_PX, best_way, centre_of_line, line_score, sample_across,
)  # fmt: skip

LINK_M = 0.006  # longest link of the tracker's chain
SIGHTING_PX = 0.45  # standard deviation of a sighting across a clear line
CLEAR = 0.25  # reward under which a sighting is not used
SIGMAS_RAD = np.array([0.14, 1.0, 0.6, 0.35])  # as `fit_headings` takes them
WIDE_PX, NARROW_PX = 14.0, 6.0  # how far from the prediction the string is looked for, first and then
STIFFNESS = 0.012  # of the way across profiles, in clear lines per sample²
TIP_REACH_M = 0.018  # how far from the predicted tip the string's end is looked for
TIP_PX = 1.0  # standard deviation of the end's place along the string
GOOD = 0.55  # mean reward with which a fit is taken without trying others
ENOUGH = 0.3  # mean reward under which the string is lost
BEAMS = 160


@dataclass(frozen=True)
class Looks:
    """How the string looks: half width (m), contrast (grey levels), how far its visible end is beyond the tip."""

    half_m: float
    contrast: float
    tip_excess_m: float = 0.0


@dataclass(frozen=True)
class Fit:
    """The string in one frame: headings, reward per node (0 unseen ... 1 clear), fit matrix, end found."""

    heading: np.ndarray
    reward: np.ndarray
    hessian: np.ndarray
    tip_slide_m: float  # NaN where the end was not found
    value: float


@njit(cache=True)
def score_in_clear_lines(score: np.ndarray, half_px: np.ndarray, contrast: float) -> None:
    """Divide line scores by that of a clear line, in place; blur spreads the same darkness over more width."""
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
    reach_px: float,
    tip_slide_m: float,
    tip_weight: float,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """See across the chain `heading` and fit it to what is seen; returns headings, rewards, fit matrix."""
    pitch_m = STEP_PX * metre_per_pixel
    middle = np.maximum(1, np.rint(half_px / STEP_PX)).astype(np.int64)
    margin = middle.max() + int(round((GAP_PX + FLANK_PX) / STEP_PX))
    half = int(round(reach_px / STEP_PX)) + margin
    nodes = place_nodes(root, heading, link_m)
    normals = node_normals(heading)
    level, difference = sample_across(
        image, background, nodes, normals, pitch_m, half, 1, origin, step, uv
    )
    score = line_score(level, difference, middle)
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
        if reward[k] >= CLEAR:
            sigma = SIGHTING_PX * metre_per_pixel * (1.0 + 0.3 * half_px[k])
            weight[k] = (reward[k] / sigma) ** 2
    fitted, hessian = fit_headings(
        root, heading, link_m, target, normals, weight, tip_slide_m, tip_weight, prior, clamp_rad,
        SIGMAS_RAD, 3,
    )  # fmt: skip
    return fitted, reward, hessian


@njit(cache=True)
def rewards_on(
    image: np.ndarray,
    background: np.ndarray,
    nodes: np.ndarray,
    heading: np.ndarray,
    half_px: np.ndarray,
    contrast: float,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> np.ndarray:
    """Return the reward (K,) of each node where it is, give or take a pixel."""
    pitch_m = STEP_PX * metre_per_pixel
    middle = np.maximum(1, np.rint(half_px / STEP_PX)).astype(np.int64)
    half = 2 + middle.max() + int(round((GAP_PX + FLANK_PX) / STEP_PX))
    level, difference = sample_across(
        image, background, nodes, node_normals(heading), pitch_m, half, 1, origin, step, uv
    )
    score = line_score(level, difference, middle)
    score_in_clear_lines(score, half_px, contrast)
    reward = np.empty(len(nodes))
    for k in range(len(nodes)):
        reward[k] = min(max(score[k, half - 2 : half + 3].max(), 0.0), 1.0)
    return reward


@njit(cache=True)
def end_of_string(
    image: np.ndarray,
    background: np.ndarray,
    nodes: np.ndarray,
    heading: np.ndarray,
    contrast: float,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> tuple[float, float]:
    """Return how far beyond the tip (m, negative before it) the string ends, and its half width there (px).

    Walks along the chain's end and straight on, until the picture is the background again; NaN where it is
    not within `TIP_REACH_M`, or not clear.
    """
    links = len(heading)
    back_links = int(np.ceil(TIP_REACH_M / np.hypot(nodes[-1, 0] - nodes[-2, 0], nodes[-1, 1] - nodes[-2, 1])))
    back_links = min(back_links, links - 1)
    link_m = np.hypot(nodes[-1, 0] - nodes[-2, 0], nodes[-1, 1] - nodes[-2, 1])
    pitch_m = 0.5 * metre_per_pixel
    before = int(back_links * link_m / pitch_m)
    count = before + int(TIP_REACH_M / pitch_m)
    places = np.empty((count, 2))
    normals = np.empty((count, 2))
    for i in range(count):
        s = (i - before) * pitch_m
        k = links + int(np.floor(s / link_m)) if s < 0 else links - 1
        k = min(max(k, 0), links - 1)
        along = s - (k - links) * link_m
        places[i, 0] = nodes[k, 0] + along * np.cos(heading[k])
        places[i, 1] = nodes[k, 1] + along * np.sin(heading[k])
        normals[i, 0], normals[i, 1] = -np.sin(heading[k]), np.cos(heading[k])
    half = int(round(8.0 / STEP_PX))
    _, difference = sample_across(
        image, background, places, normals, STEP_PX * metre_per_pixel, half, 0, origin, step, uv
    )
    changed = np.empty(count)
    for i in range(count):
        # The best of a narrow band: the chain may be a pixel beside the line.
        best = 0.0
        for w in range(half - 3, half + 4):
            value = (difference[i, w - 1] + difference[i, w] + difference[i, w + 1]) / 3.0
            best = max(best, value)
        changed[i] = best
    inside = np.median(changed[: max(3, before // 2)])
    if inside < 0.4 * contrast:
        return np.nan, np.nan
    threshold = 0.5 * inside
    last = -1
    for i in range(count - 1, -1, -1):
        if changed[i] >= threshold:
            last = i
            break
    run = 0
    for i in range(count):
        run = run + 1 if changed[i] < threshold else 0
        if run == 4:
            last = i - 4
            break
    if last < 1 or last >= count - 4:
        return np.nan, np.nan
    fraction = (changed[last] - threshold) / max(changed[last] - changed[last + 1], 1e-9)
    slide_m = (last + min(max(fraction, 0.0), 1.0) - before) * pitch_m
    width = 0
    check = max(0, last - int(3.0 * STEP_PX / 0.25))
    for w in range(2 * half + 1):
        if difference[check, w] > threshold:
            width += 1
    return slide_m, 0.5 * width * STEP_PX


@dataclass(frozen=True)
class Picture:
    """What of one frame the string is looked for in: grey picture, background, the plane's pixel map."""

    image: np.ndarray
    background: np.ndarray
    pixels: PixelMap


def map_of(picture: Picture) -> tuple[float, np.ndarray, float, np.ndarray]:
    """Return the pixel map as the kernels take it."""
    pixels = picture.pixels
    return pixels.metre_per_pixel, pixels.origin_m, pixels.step_m, pixels.uv


def fit_string(
    picture: Picture,
    hand: np.ndarray,
    start: np.ndarray,
    prior: np.ndarray,
    link_m: float,
    half_px: np.ndarray,
    looks: Looks,
    wide: bool = True,
    hold_tip: bool = True,
) -> Fit:
    """Fit the chain to one frame, starting from headings `start`.

    Parameters
    ----------
    picture
        The frame.
    hand
        Pose x_m, y_m, angle_rad of the hand.
    start, prior
        Headings (links,) to start from, and those that are expected.
    half_px
        Half the visible width at each node, blur included, (links + 1,).
    looks
        The string's looks.
    wide
        Whether to look far from `start` first.
    hold_tip
        Whether the string's visible end holds the tip.
    """
    image, background = picture.image, picture.background
    pixel_map = map_of(picture)
    root, clamp = hand[:2], nearest_turn(hand[2], start[0])
    heading = start
    reaches = (WIDE_PX, NARROW_PX, NARROW_PX) if wide else (NARROW_PX, NARROW_PX)
    for reach in reaches:
        heading, _, hessian = look_and_fit(
            image, background, root, clamp, heading, prior, link_m, half_px, looks.contrast, reach, 0.0, 0.0,
            *pixel_map,
        )  # fmt: skip
    slide_m = np.nan
    for _ in range(2 if hold_tip else 0):
        nodes = place_nodes(root, heading, link_m)
        end_m, _ = end_of_string(image, background, nodes, heading, looks.contrast, *pixel_map)
        if not np.isfinite(end_m):
            break
        slide_m = end_m - looks.tip_excess_m
        weight = 1.0 / (TIP_PX * pixel_map[0]) ** 2
        heading, _, hessian = look_and_fit(
            image, background, root, clamp, heading, prior, link_m, half_px, looks.contrast, NARROW_PX,
            slide_m, weight, *pixel_map,
        )  # fmt: skip
    nodes = place_nodes(root, heading, link_m)
    reward = rewards_on(image, background, nodes, heading, half_px, looks.contrast, *pixel_map)
    return Fit(heading, reward, hessian, float(slide_m), float(reward[1:].mean()))


def find_string(
    picture: Picture, hand: np.ndarray, guide: np.ndarray | None, links: int, link_m: float, looks: Looks
) -> tuple[np.ndarray, float]:
    """Find the string anew from the clamp; returns headings (links,) and the way's mean reward."""
    scale = picture.pixels.metre_per_pixel
    weight = 0.0 if guide is None else 0.1 / 0.05**2
    nodes = np.zeros((links + 1, 2)) if guide is None else guide
    return trace_string(
        picture.image, picture.background, hand[:2], hand[2], link_m, links, looks.half_m / scale,
        looks.contrast, nodes, weight, BEAMS, *map_of(picture),
    )  # fmt: skip


def nearest_turn(angle_rad: float, reference_rad: float) -> float:
    """Return `angle_rad` plus whole turns, nearest to `reference_rad`."""
    return float(angle_rad + 2 * np.pi * np.round((reference_rad - angle_rad) / (2 * np.pi)))


def point_sigmas(fit: Fit, link_m: float, every: int) -> np.ndarray:
    """Return sigma (m) of every `every`-th node after the root."""
    return np.asarray(node_sigmas(fit.hessian, fit.heading, link_m, every)[1])
