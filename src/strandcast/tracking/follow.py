"""The string from one frame to the next: predict, see across, fit, hold the tip, and doubt the result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.tracking.chain import node_normals, node_sigmas, place_nodes
from strandcast.tracking.one_look import CLEAR, look_and_fit, rewards_on, seen_once
from strandcast.tracking.picture import Looks, Picture, hand_box, hidden_nodes, map_of
from strandcast.tracking.search import trace_string
from strandcast.tracking.tip import TIP_REACH_M, end_of_string, locate_tip

LINK_M = 0.006  # longest link of the tracker's chain
WIDE_PX, NARROW_PX = 14.0, 6.0  # how far from the prediction the string is looked for, first and then
GOOD = 0.55  # mean reward with which a fit is taken without trying others
ENOUGH = 0.3  # mean reward under which the string is lost
BEAMS = 100
BEND_COST = 0.03  # in mean reward, per squared radian of bend, summed over the joints
LEAST_OPEN = 0.25  # share of the chain that must not be hidden by the hand
END_COST = 0.15  # in mean reward, for a chain whose end is not the string's
TIP_ROUNDS = 3
END_PX = 5.0  # from the chain's tip to the string's visible end, from which it is not
STRETCH_M = 0.004  # by which a chain may differ from the string's length: how the clamp holds it


@dataclass(frozen=True)
class Fit:
    """The string in one frame.

    Attributes
    ----------
    heading, link_m
        Headings (M,) and length of the links.
    reward
        Of each node, 0 unseen ... 1 clear, (M + 1,).
    hessian
        The fit's matrix (M, M).
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
    """

    heading: np.ndarray
    link_m: float
    reward: np.ndarray
    hessian: np.ndarray
    tip_slide_m: float
    value: float
    open_share: float
    end_is_off: bool
    ball_seen: bool


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
    reaches = (WIDE_PX, NARROW_PX) if wide else (NARROW_PX, NARROW_PX)
    tip = np.zeros(5)
    for reach in reaches:
        heading, _, hessian = look_and_fit(
            image, background, root, clamp, heading, prior, link_m, half_px, looks.contrast, looks.polarity,
            box, reach, tip, *pixel_map,
        )  # fmt: skip
    for turn in range(TIP_ROUNDS if hold_tip else 0):
        tip = locate_tip(picture, place_nodes(root, heading, link_m), heading, looks)
        if turn == TIP_ROUNDS - 1 and tip[1] > 0:
            # What bends cannot explain is the clamp's: the string slipped, or sits beside its middle.
            link_m += float(np.clip(tip[0], -STRETCH_M, STRETCH_M)) / len(heading)
            tip = locate_tip(picture, place_nodes(root, heading, link_m), heading, looks)
        heading, _, hessian = look_and_fit(
            image, background, root, clamp, heading, prior, link_m, half_px, looks.contrast, looks.polarity,
            box, NARROW_PX, tip, *pixel_map,
        )  # fmt: skip
        if tip[1] == 0.0:
            break
    slide_m = float(tip[0]) if tip[1] > 0 else np.nan
    nodes = place_nodes(root, heading, link_m)
    reward = rewards_on(
        image, background, nodes, heading, half_px, looks.contrast, looks.polarity, box, *pixel_map
    )
    hidden = hidden_nodes(
        image, background, nodes, node_normals(heading), half_px, looks.noise, looks.blind, box, *pixel_map
    )
    hidden &= reward < CLEAR
    end_is_off = hold_tip and not hidden[-1] and not _ends_at_tip(picture, nodes, heading, slide_m, looks)
    hidden[len(reward) - int(tip[4]) :] = True
    hidden[0] = True
    once = reward * seen_once(nodes, heading, 2.5 * pixel_map[0])
    open_share = float((~hidden).mean())
    value = float(once[~hidden].mean()) if open_share > LEAST_OPEN else 0.0
    value -= END_COST * end_is_off + BEND_COST * float((np.diff(heading) ** 2).sum())
    return Fit(heading, link_m, reward, hessian, slide_m, value, open_share, end_is_off, bool(tip[3] > 0))


def _ends_at_tip(
    picture: Picture, nodes: np.ndarray, heading: np.ndarray, slide_m: float, looks: Looks
) -> bool:
    """Tell whether the string is seen to end at the chain's tip, and its ball, if any, is the end."""
    near_m = END_PX * picture.pixels.metre_per_pixel
    if not abs(slide_m) < near_m or not looks.has_ball:
        return bool(abs(slide_m) < near_m)
    end_m, _ = end_of_string(
        picture.image, picture.background, nodes, heading, looks.contrast, looks.polarity, looks.blind,
        TIP_REACH_M + looks.tip_excess_m, *map_of(picture),
    )  # fmt: skip
    return bool(abs(end_m - looks.tip_excess_m) < near_m)


def find_string(
    picture: Picture, hand: np.ndarray, guide: np.ndarray | None, links: int, link_m: float, looks: Looks
) -> tuple[np.ndarray, float]:
    """Find the string anew from the clamp; returns headings (links,) and the way's mean reward."""
    scale = picture.pixels.metre_per_pixel
    weight = 0.0 if guide is None else 0.1 / 0.05**2
    nodes = np.zeros((links + 1, 2)) if guide is None else guide
    return trace_string(
        picture.image, picture.background, hand[:2], hand[2], link_m, links, looks.half_m / scale,
        looks.contrast, looks.polarity, looks.noise, looks.blind, hand_box(hand, picture.hand_box), nodes,
        weight, BEAMS, *map_of(picture),
    )  # fmt: skip


def nearest_turn(angle_rad: float, reference_rad: float) -> float:
    """Return `angle_rad` plus whole turns, nearest to `reference_rad`."""
    return float(angle_rad + 2 * np.pi * np.round((reference_rad - angle_rad) / (2 * np.pi)))


def point_sigmas(fit: Fit, every: int) -> np.ndarray:
    """Return sigma (m) of every `every`-th node after the root."""
    return np.asarray(node_sigmas(fit.hessian, fit.heading, fit.link_m, every)[1])
