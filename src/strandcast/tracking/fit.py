"""The string in one frame: see across the chain, fit it to what is seen, hold the tip, value the result."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.chain import Evidence, Stiffness, fit_headings, node_normals, place_nodes
from strandcast.tracking.picture import GAP_PX, Looks, Picture, hidden_nodes, inside_box, near_box
from strandcast.tracking.sighting import (
    FLANK_PX,
    STEP_PX,
    best_way,
    centre_of_line,
    line_score,
    sample_across,
)
from strandcast.tracking.tip import END_PX, Tip, ends_at_tip, locate_tip, no_tip, pin_balls, place_on

SIGHTING_PX = 0.45  # standard deviation of a sighting across a clear line
CLEAR = 0.25  # reward under which a sighting is not used
STIFFNESS = Stiffness(change=0.2, bend=1.0, unseen=0.2, prior=0.8, clamp=2.0, root_m=0.0025)
WAY_STIFFNESS = 0.012  # of the way across profiles, in clear lines per sample²
WIDE_PX, NARROW_PX = 14.0, 6.0  # how far from the prediction the string is looked for, first and then
MOVED_PX = 0.7  # by which a look moves the chain, from which another is worth it
LOOKS = 3  # at most, after the first
BEND_COST = 0.03  # in mean reward, per squared radian of bend, summed over the joints
LEAST_OPEN = 0.25  # share of the chain that must not be hidden by the hand
END_COST = 0.15  # in mean reward, for a chain whose end is not the string's


class Fit(NamedTuple):
    """The string in one frame.

    Attributes
    ----------
    root, heading, link_m
        Where the chain starts (m), (2,); headings (M,) and length of its links.
    reward
        Of each node, 0 unseen ... 1 clear, (M + 1,).
    covariances
        Of the nodes, as the fit has them (m²), (M + 1, 2, 2).
    tip_slide_m
        From the chain's tip to the string's visible end; NaN where that was not found.
    value
        Mean reward of what can be seen, less costs.
    open_share
        How much of the chain can be seen.
    end_is_off
        The tip should be seen but is not where the string ends.
    ball_seen
        The tip's ball was found.
    doubled
        Nodes that can be seen and lie along an earlier part of the chain: it may be folded onto itself.
    """

    root: np.ndarray
    heading: np.ndarray
    link_m: float
    reward: np.ndarray
    covariances: np.ndarray
    tip_slide_m: float
    value: float
    open_share: float
    end_is_off: bool
    ball_seen: bool
    doubled: int

    def nodes(self) -> np.ndarray:
        """Return the chain's nodes (M + 1, 2) (m)."""
        return np.asarray(place_nodes(self.root, self.heading, self.link_m))


@njit(cache=True, nogil=True)
def fit_frame(
    picture: Picture,
    clamp_m: np.ndarray,
    start: np.ndarray,
    prior: np.ndarray,
    link_m: float,
    half_px: np.ndarray,
    looks: Looks,
    balls: np.ndarray,
    guess: np.ndarray,
    reach_px: float,
    hold_tip: bool,
) -> Fit:
    """Fit the chain to one frame, starting from headings `start`.

    Parameters
    ----------
    picture, looks
        The frame, and what the string looks like.
    clamp_m
        Where the string leaves the clamp, (2,).
    start, prior
        Headings (M,) to start from, and those that are expected.
    link_m
        Length of a link.
    half_px
        Half the visible width at each node, blur included, (M + 1,).
    balls, guess
        Balls on the string, (B, 3): place along it (m), radius (m) and grey level, that of the tip last; and
        where they are thought to be (B, 2) (m), NaN where that is the chain's to say.
    reach_px
        How far from `start` the string is looked for first.
    hold_tip
        Whether the string's visible end holds the tip.
    """
    scale = picture.plane.metre_per_pixel
    tip, pins = no_tip(), np.zeros((0, 4))
    ball_at_tip = np.isfinite(looks.ball_level)
    root, heading, covariances, reward = look_and_fit(
        picture, clamp_m, clamp_m, start, prior, link_m, half_px, looks, balls, reach_px, tip, pins
    )
    moved = moved_m(clamp_m, start, root, heading, link_m)
    for look in range(LOOKS):
        if hold_tip:
            nodes = place_nodes(root, heading, link_m)
            pins = pin_balls(picture, nodes, heading, balls, guess)
            if not ball_at_tip:
                tip = locate_tip(picture, nodes, heading, looks)
        if look > 0 and moved < MOVED_PX * scale:
            break
        before_root, before = root, heading
        root, heading, covariances, reward = look_and_fit(
            picture, clamp_m, root, heading, prior, link_m, half_px, looks, balls, NARROW_PX, tip, pins
        )
        moved = moved_m(before_root, before, root, heading, link_m)
    nodes = place_nodes(root, heading, link_m)
    hidden = hidden_nodes(picture, nodes, node_normals(heading), half_px, looks)
    hidden &= reward < CLEAR
    slide_m = tip.along_m if tip.weight > 0 else np.nan
    ball_seen = ball_at_tip and len(pins) > 0 and pins[-1, 0] == balls[-1, 0]
    if ball_seen:
        off = pins[-1, 1:3] - place_on(nodes, heading, pins[-1, 0])
        slide_m = np.cos(heading[-1]) * off[0] + np.sin(heading[-1]) * off[1]
    slid = not abs(slide_m) < END_PX * scale
    end_is_off = hold_tip and not hidden[-1] and (slid or not ends_at_tip(picture, nodes, heading, looks))
    for k in range(len(reward)):
        hidden[k] |= behind_ball(k * link_m, balls)
    hidden[0] = True
    once = seen_once(nodes, heading, 2.5 * scale)
    total, count, doubled = 0.0, 0, 0
    for k in range(len(reward)):
        if not hidden[k]:
            total += reward[k] * once[k]
            count += 1
            doubled += once[k] == 0.0
    open_share = count / len(reward)
    value = total / count if open_share > LEAST_OPEN else 0.0
    bends = heading[1:] - heading[:-1]
    value -= END_COST * end_is_off + BEND_COST * (bends * bends).sum()
    return Fit(
        root, heading, link_m, reward, covariances, slide_m, value, open_share, end_is_off, ball_seen, doubled
    )


@njit(cache=True)
def nearest_turn(angle_rad: float, reference_rad: float) -> float:
    """Return `angle_rad` plus whole turns, nearest to `reference_rad`."""
    return angle_rad + 2 * np.pi * np.round((reference_rad - angle_rad) / (2 * np.pi))


@njit(cache=True)
def moved_m(
    root_before: np.ndarray, before: np.ndarray, root: np.ndarray, heading: np.ndarray, link_m: float
) -> float:
    """Return the longest way of a node from one chain to another (m)."""
    off = place_nodes(root, heading, link_m) - place_nodes(root_before, before, link_m)
    return np.sqrt((off[:, 0] ** 2 + off[:, 1] ** 2).max())


@njit(cache=True)
def look_and_fit(
    picture: Picture,
    clamp_m: np.ndarray,
    root: np.ndarray,
    heading: np.ndarray,
    prior: np.ndarray,
    link_m: float,
    half_px: np.ndarray,
    looks: Looks,
    balls: np.ndarray,
    reach_px: float,
    tip: Tip,
    pins: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """See across a chain and fit it to what is seen; returns root, headings, covariances, rewards."""
    scale = picture.plane.metre_per_pixel
    pitch_m = STEP_PX * scale
    nodes = place_nodes(root, heading, link_m)
    normals = node_normals(heading)
    difference, score, middle, half = see_across(picture, nodes, normals, half_px, looks, reach_px)
    blank_hand(score, nodes, normals, half, pitch_m, picture.hand_box)
    way = best_way(score, WAY_STIFFNESS, max(1, int(0.8 * link_m / pitch_m)))
    centre = centre_of_line(difference, score, way, middle)
    count = len(nodes)
    target = nodes.copy()
    weight = np.zeros(count)
    for k in range(1, count):
        reward = min(max(score[k, way[k]], 0.0), 1.0)
        across = (centre[k] - half) * pitch_m
        target[k, 0] += across * normals[k, 0]
        target[k, 1] += across * normals[k, 1]
        if reward >= CLEAR and not behind_ball(k * link_m, balls):
            sigma = SIGHTING_PX * scale * (1.0 + 0.3 * half_px[k])
            weight[k] = (reward / sigma) ** 2
    clamp_rad = nearest_turn(picture.hand_box[2], heading[0])
    seen = Evidence(target, normals, weight, tip.along_m, tip.weight, pins, prior, clamp_m, clamp_rad)
    root, heading, covariances = fit_headings(root, heading, link_m, seen, STIFFNESS, 2)
    return (
        root,
        heading,
        covariances,
        rewards_near(score, nodes, normals, root, heading, link_m, half, pitch_m),
    )


@njit(cache=True)
def rewards_near(
    score: np.ndarray,
    nodes: np.ndarray,
    normals: np.ndarray,
    root: np.ndarray,
    heading: np.ndarray,
    link_m: float,
    half: int,
    pitch_m: float,
) -> np.ndarray:
    """Return what was seen (K,) where the fitted chain is, give or take a pixel, in clear lines."""
    fitted = place_nodes(root, heading, link_m)
    reward = np.zeros(len(nodes))
    spare = int(1.0 / STEP_PX)
    for k in range(len(nodes)):
        off_m = (fitted[k, 0] - nodes[k, 0]) * normals[k, 0] + (fitted[k, 1] - nodes[k, 1]) * normals[k, 1]
        w = half + int(np.round(off_m / pitch_m))
        for near in range(max(0, w - spare), min(score.shape[1], w + spare + 1)):
            reward[k] = max(reward[k], min(score[k, near], 1.0))
    return reward


@njit(cache=True)
def blank_hand(
    score: np.ndarray, nodes: np.ndarray, normals: np.ndarray, half: int, pitch_m: float, box: np.ndarray
) -> None:
    """Set the scores of places in the hand's box to 0, in place."""
    for k in range(len(nodes)):
        if not near_box(nodes[k, 0], nodes[k, 1], box, half * pitch_m):
            continue
        for w in range(score.shape[1]):
            across = (w - half) * pitch_m
            if inside_box(nodes[k, 0] + across * normals[k, 0], nodes[k, 1] + across * normals[k, 1], box):
                score[k, w] = 0.0


@njit(cache=True)
def behind_ball(place_m: float, balls: np.ndarray) -> bool:
    """Tell whether a place along the string is within a ball, which hides it."""
    hidden = False
    for ball in balls:
        hidden |= abs(place_m - ball[0]) < ball[1]
    return hidden


@njit(cache=True)
def see_across(
    picture: Picture,
    nodes: np.ndarray,
    normals: np.ndarray,
    half_px: np.ndarray,
    looks: Looks,
    reach_px: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Return profiles of change and of score in clear lines, the line's half widths, the middle sample."""
    middle = np.maximum(1, np.rint(half_px / STEP_PX)).astype(np.int64)
    half = int(reach_px / STEP_PX + 0.5) + middle.max() + int((GAP_PX + FLANK_PX) / STEP_PX + 0.5)
    pitch_m = STEP_PX * picture.plane.metre_per_pixel
    level, difference = sample_across(picture, nodes, normals, pitch_m, half, 0, looks.polarity)
    score = line_score(level, difference, middle, looks.polarity)
    thin = half_px.min()
    for k in range(len(score)):
        score[k] *= half_px[k] / (thin * looks.contrast)  # blur spreads a line over more width
    return difference, score, middle, half


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
