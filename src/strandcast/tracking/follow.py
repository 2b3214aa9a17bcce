"""The string from one frame to the next: predict, see across, fit, hold the tip, and doubt the result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from strandcast.tracking.chain import fit_headings, node_normals, node_sigmas, place_nodes
from strandcast.tracking.pixelmap import PixelMap, from_pixel, to_pixel
from strandcast.tracking.search import trace_string
from strandcast.tracking.sighting import (
    FLANK_PX, GAP_PX, STEP_PX, best_way, centre_of_line, inside_box, line_score, sample_across,
)  # fmt: skip

LINK_M = 0.006  # longest link of the tracker's chain
SIGHTING_PX = 0.45  # standard deviation of a sighting across a clear line
CLEAR = 0.25  # reward under which a sighting is not used
SIGMAS_RAD = np.array([0.14, 1.0, 0.6, 0.35])  # as `fit_headings` takes them
WIDE_PX, NARROW_PX = 14.0, 6.0  # how far from the prediction the string is looked for, first and then
STIFFNESS = 0.012  # of the way across profiles, in clear lines per sample²
TIP_REACH_M = 0.018  # how far from the predicted tip the string's end is looked for
BALL_REACH_PX = 14.0  # from the predicted tip to the ball's centre
TIP_PX = 1.0  # standard deviation of the end's place along the string
GOOD = 0.55  # mean reward with which a fit is taken without trying others
ENOUGH = 0.3  # mean reward under which the string is lost
BEAMS = 100
BEND_COST = 0.03  # in mean reward, per squared radian of bend, summed over the joints
LEAST_OPEN = 0.25  # share of the chain that must not be hidden by the hand
END_COST = 0.15  # in mean reward, for a chain whose end is not the string's


@dataclass(frozen=True)
class Looks:
    """How the string looks.

    Attributes
    ----------
    half_m
        Half its visible width, the lens's blur included.
    contrast
        Line score of a clear piece of it, grey levels.
    tip_excess_m
        How far its visible end is beyond the tip's mass point: half its width, or the radius of a ball.
    ball_level
        Grey level of the ball at its tip; NaN where there is none.
    polarity
        1 if it is brighter than the background, -1 if darker, 0 if either.
    """

    half_m: float
    contrast: float
    tip_excess_m: float = 0.0
    ball_level: float = np.nan
    polarity: float = 0.0

    @property
    def has_ball(self) -> bool:
        """Tell whether a ball hangs at the tip."""
        return bool(np.isfinite(self.ball_level))


@dataclass(frozen=True)
class Fit:
    """The string in one frame: headings, reward per node (0 unseen ... 1 clear), fit matrix, end found."""

    heading: np.ndarray
    reward: np.ndarray
    hessian: np.ndarray
    tip_slide_m: float  # NaN where the end was not found
    value: float
    ball_seen: bool


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
    margin = middle.max() + int(round((GAP_PX + FLANK_PX) / STEP_PX))
    half = int(round(reach_px / STEP_PX)) + margin
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
    half = 2 + middle.max() + int(round((GAP_PX + FLANK_PX) / STEP_PX))
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


@njit(cache=True)
def end_of_string(
    image: np.ndarray,
    background: np.ndarray,
    nodes: np.ndarray,
    heading: np.ndarray,
    contrast: float,
    polarity: float,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> tuple[float, float]:
    """Return how far beyond the tip (m, negative before it) the string ends, and its largest half width near there (px).

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
    half = int(round(14.0 / STEP_PX))
    _, difference = sample_across(
        image, background, places, normals, STEP_PX * metre_per_pixel, half, 0, polarity, origin, step, uv
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
    widest = 0
    for i in range(last + 1):
        width = 0
        for w in range(2 * half + 1):
            if difference[i, w] > threshold:
                width += 1
        widest = max(widest, width)
    return slide_m, 0.5 * widest * STEP_PX


@dataclass(frozen=True)
class Picture:
    """What of one frame the string is looked for in: grey picture, background, the plane's pixel map.

    `hand_box` (low x, low y, high x, high y), in the hand's frame, is where nothing that is seen is string.
    """

    image: np.ndarray
    background: np.ndarray
    pixels: PixelMap
    hand_box: np.ndarray


def hand_box(hand: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return the hand's box where the hand is, as `inside_box` takes it, (7,)."""
    return np.concatenate([hand, box])


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
    box = hand_box(hand, picture.hand_box)
    root, clamp = hand[:2], nearest_turn(hand[2], start[0])
    heading = start
    reaches = (WIDE_PX, NARROW_PX, NARROW_PX) if wide else (NARROW_PX, NARROW_PX)
    tip = np.zeros(5)
    for reach in reaches:
        heading, _, hessian = look_and_fit(
            image, background, root, clamp, heading, prior, link_m, half_px, looks.contrast, looks.polarity,
            box, reach, tip, *pixel_map,
        )  # fmt: skip
    for _ in range(3 if hold_tip else 0):
        tip = locate_tip(picture, place_nodes(root, heading, link_m), heading, looks)
        heading, _, hessian = look_and_fit(
            image, background, root, clamp, heading, prior, link_m, half_px, looks.contrast, looks.polarity,
            box, NARROW_PX, tip, *pixel_map,
        )  # fmt: skip
        if tip[1] == 0.0:
            break
    slide_m = float(tip[0]) if tip[1] > 0 else np.nan
    nodes = place_nodes(root, heading, link_m)
    reward = rewards_on(image, background, nodes, heading, half_px, looks.contrast, looks.polarity, box, *pixel_map)
    once = reward * seen_once(nodes, heading, 2.5 * pixel_map[0])
    end_is_off = hold_tip and not abs(slide_m) < 5 * pixel_map[0]
    if looks.has_ball and not end_is_off:
        end_m, _ = end_of_string(
            image, background, nodes, heading, looks.contrast, looks.polarity, *pixel_map
        )
        end_is_off = not abs(end_m - looks.tip_excess_m) < 5 * pixel_map[0]
    hidden = hidden_nodes(picture, nodes, box)
    hidden[len(reward) - int(tip[4]) :] = True
    hidden[0] = True
    open_share = float((~hidden).mean())
    value = float(once[~hidden].mean()) if open_share > LEAST_OPEN else 0.0
    value -= END_COST * end_is_off + BEND_COST * float((np.diff(heading) ** 2).sum())
    return Fit(heading, reward, hessian, slide_m, value, bool(tip[3] > 0))


def locate_tip(picture: Picture, nodes: np.ndarray, heading: np.ndarray, looks: Looks) -> np.ndarray:
    """Return where the tip should go, as `look_and_fit` takes it; weights of 0 where its end is not seen."""
    scale, *_ = pixel_map = map_of(picture)
    weight = 1.0 / (TIP_PX * scale) ** 2
    if looks.has_ball:
        centre = ball_centre(
            picture.image, picture.background, nodes[-1], looks.tip_excess_m, looks.ball_level, *pixel_map
        )
        along = np.array([np.cos(heading[-1]), np.sin(heading[-1])])
        off = centre - nodes[-1]
        across = np.array([-along[1], along[0]])
        if not np.hypot(*off) < BALL_REACH_PX * scale:
            return np.zeros(5)
        hidden = np.ceil(looks.tip_excess_m / np.linalg.norm(nodes[-1] - nodes[-2]))
        return np.array([off @ along, 2 * weight, off @ across, 2 * weight, hidden])
    end_m, _ = end_of_string(
        picture.image, picture.background, nodes, heading, looks.contrast, looks.polarity, *pixel_map
    )
    return np.array([end_m - looks.tip_excess_m, weight, 0.0, 0.0, 0.0]) if np.isfinite(end_m) else np.zeros(5)


@njit(cache=True)
def ball_centre(
    image: np.ndarray,
    background: np.ndarray,
    guess: np.ndarray,
    radius_m: float,
    ball_level: float,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> np.ndarray:
    """Return the centre (2,) (m) of the ball near `guess` by mean shift; NaN where too little of it is seen.

    A pixel counts as far as it has changed and is as grey as the ball, so that the arm does not draw it aside.
    """
    u, v = to_pixel(guess[0], guess[1], origin, step, uv)
    centre = np.full(2, np.nan)
    radius = radius_m / metre_per_pixel
    reach = radius + BALL_REACH_PX
    for turn in range(24):
        total = sum_u = sum_v = 0.0
        for i in range(max(0, int(v - reach)), min(image.shape[0], int(v + reach) + 2)):
            for j in range(max(0, int(u - reach)), min(image.shape[1], int(u + reach) + 2)):
                distance = np.hypot(j - u, i - v)
                if distance > reach:
                    continue
                level, was = float(image[i, j]), float(background[i, j])
                depth = abs(ball_level - was)
                share = min(1.0, abs(level - was) / max(depth, 1.0)) - 2.0 * abs(level - ball_level) / max(depth, 20.0)
                share = max(0.0, share) * min(1.0, reach - distance)
                total += share
                sum_u += share * j
                sum_v += share * i
        if total < 0.3 * 3.14159 * radius * radius:
            return centre
        new_u, new_v = sum_u / total, sum_v / total
        moved = np.hypot(new_u - u, new_v - v)
        u, v = new_u, new_v
        if turn >= 3 and reach > radius + 1.5:
            reach = max(radius + 1.5, reach - 3.0)
        elif moved < 0.02 and turn > 3:
            break
    return from_pixel(u, v, guess, origin, step, uv)


def hidden_nodes(picture: Picture, nodes: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Tell which nodes (K,) cannot be seen: behind the hand, or outside the picture."""
    _, origin, step, uv = map_of(picture)
    rows, columns = picture.image.shape
    hidden = np.zeros(len(nodes), dtype=bool)
    for k, (x, y) in enumerate(nodes):
        u, v = to_pixel(x, y, origin, step, uv)
        hidden[k] = inside_box(x, y, box) or not (1 <= u < columns - 2 and 1 <= v < rows - 2)
    return hidden


def find_string(
    picture: Picture, hand: np.ndarray, guide: np.ndarray | None, links: int, link_m: float, looks: Looks
) -> tuple[np.ndarray, float]:
    """Find the string anew from the clamp; returns headings (links,) and the way's mean reward."""
    scale = picture.pixels.metre_per_pixel
    weight = 0.0 if guide is None else 0.1 / 0.05**2
    nodes = np.zeros((links + 1, 2)) if guide is None else guide
    return trace_string(
        picture.image, picture.background, hand[:2], hand[2], link_m, links, looks.half_m / scale,
        looks.contrast, looks.polarity, hand_box(hand, picture.hand_box), nodes, weight, BEAMS, *map_of(picture),
    )  # fmt: skip


def nearest_turn(angle_rad: float, reference_rad: float) -> float:
    """Return `angle_rad` plus whole turns, nearest to `reference_rad`."""
    return float(angle_rad + 2 * np.pi * np.round((reference_rad - angle_rad) / (2 * np.pi)))


def point_sigmas(fit: Fit, link_m: float, every: int) -> np.ndarray:
    """Return sigma (m) of every `every`-th node after the root."""
    return np.asarray(node_sigmas(fit.hessian, fit.heading, link_m, every)[1])
