"""Where the string ends: its visible end along the chain, or the ball that hangs there."""

from __future__ import annotations

import numpy as np
from numba import njit

from strandcast.tracking.picture import Looks, Picture, map_of
from strandcast.tracking.pixelmap import from_pixel, to_pixel
from strandcast.tracking.sighting import STEP_PX, is_blind, sample_across

TIP_REACH_M = 0.018  # how far from the predicted tip the string's end is looked for
TIP_PX = 1.0  # standard deviation of the end's place along the string
BALL_REACH_PX = 14.0  # from the predicted tip to the ball's centre
ALONG_PX = 0.5  # between places along the string
WIDEST_PX = 14.0  # half width of the widest ball
LEAST_INSIDE = 0.4  # of a clear line, that the string must show before its end
EDGE_PX = 4.0  # from the picture's edge, within which no end is believed
MOST_CHANGED = 1.5  # clear lines; before what is darker than usual, a bright string changes more
OUTSIDE_RUN = 4  # places without string that make an end


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
        return np.array([off @ along, 4 * weight, off @ across, 4 * weight, hidden])
    end_m, _ = end_of_string(
        picture.image,
        picture.background,
        nodes,
        heading,
        looks.contrast,
        looks.polarity,
        looks.blind,
        TIP_REACH_M + looks.tip_excess_m,
        *pixel_map,
    )
    return (
        np.array([end_m - looks.tip_excess_m, weight, 0.0, 0.0, 0.0]) if np.isfinite(end_m) else np.zeros(5)
    )


@njit(cache=True)
def end_of_string(
    image: np.ndarray,
    background: np.ndarray,
    nodes: np.ndarray,
    heading: np.ndarray,
    contrast: float,
    polarity: float,
    blind: np.ndarray,
    reach_m: float,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> tuple[float, float]:
    """Return how far beyond the tip the string ends (m, negative before it), and its half width (px).

    Walks along the chain's end and straight on, until the picture is the background again; NaN where that is
    not within `reach_m` of the tip, or not clear. The width is the largest near the end.
    """
    pitch_m = ALONG_PX * metre_per_pixel
    places, normals, before = walk_past_tip(nodes, heading, reach_m, pitch_m)
    half = int(np.ceil(WIDEST_PX / STEP_PX))
    _, difference = sample_across(
        image, background, places, normals, STEP_PX * metre_per_pixel, half, 0, polarity, origin, step, uv
    )
    changed = np.minimum(best_in_band(difference, half), MOST_CHANGED * contrast)
    inside = np.median(changed[: max(3, before // 2)])
    if inside < LEAST_INSIDE * contrast:
        return np.nan, np.nan
    threshold = 0.5 * inside
    last = last_above(changed, threshold)
    if last < 1 or last >= len(changed) - OUTSIDE_RUN:
        return np.nan, np.nan
    u, v = to_pixel(places[last + 1, 0], places[last + 1, 1], origin, step, uv)
    if not (EDGE_PX < u < image.shape[1] - EDGE_PX and EDGE_PX < v < image.shape[0] - EDGE_PX):
        return np.nan, np.nan  # it leaves the picture, it does not end
    for i in range(last + 1, last + 1 + OUTSIDE_RUN):
        u, v = to_pixel(places[i, 0], places[i, 1], origin, step, uv)
        if is_blind(background, u, v, blind):
            return np.nan, np.nan
    fraction = (changed[last] - threshold) / max(changed[last] - changed[last + 1], 1e-9)
    slide_m = (last + min(max(fraction, 0.0), 1.0) - before) * pitch_m
    widest = 0
    for i in range(max(0, last - int(2 * WIDEST_PX / ALONG_PX)), last + 1):
        widest = max(widest, (difference[i] > threshold).sum())
    return slide_m, 0.5 * widest * STEP_PX


@njit(cache=True)
def walk_past_tip(
    nodes: np.ndarray, heading: np.ndarray, reach_m: float, pitch_m: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return places (K, 2) along the chain's end and straight on, normals, and which place is the tip."""
    links = len(heading)
    link_m = np.hypot(nodes[-1, 0] - nodes[-2, 0], nodes[-1, 1] - nodes[-2, 1])
    before = int(min(np.ceil(reach_m / link_m), links - 1) * link_m / pitch_m)
    count = before + int(reach_m / pitch_m)
    places = np.empty((count, 2))
    normals = np.empty((count, 2))
    for i in range(count):
        beyond_m = (i - before) * pitch_m
        k = min(max(links + int(np.floor(beyond_m / link_m)), 0), links - 1)
        along_m = beyond_m - (k - links) * link_m
        places[i, 0] = nodes[k, 0] + along_m * np.cos(heading[k])
        places[i, 1] = nodes[k, 1] + along_m * np.sin(heading[k])
        normals[i, 0], normals[i, 1] = -np.sin(heading[k]), np.cos(heading[k])
    return places, normals, before


@njit(cache=True)
def best_in_band(difference: np.ndarray, half: int) -> np.ndarray:
    """Return each profile's largest mean of three neighbours near its middle: the chain may lie beside it."""
    best = np.zeros(len(difference))
    for i in range(len(difference)):
        for w in range(half - 3, half + 4):
            value = (difference[i, w - 1] + difference[i, w] + difference[i, w + 1]) / 3.0
            best[i] = max(best[i], value)
    return best


@njit(cache=True)
def last_above(values: np.ndarray, threshold: float) -> int:
    """Return the last place at or over the threshold before the first `OUTSIDE_RUN` under it; or -1."""
    last, run = -1, 0
    for i in range(len(values)):
        if values[i] >= threshold:
            last, run = i, 0
        else:
            run += 1
            if run == OUTSIDE_RUN:
                break
    return last


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

    A pixel counts as far as it has changed and is as grey as the ball: the arm does not draw it aside.
    """
    u, v = to_pixel(guess[0], guess[1], origin, step, uv)
    radius = radius_m / metre_per_pixel
    reach = radius + BALL_REACH_PX
    for turn in range(24):
        total, sum_u, sum_v = ball_weight(image, background, u, v, reach, ball_level)
        if total < 0.3 * 3.14159 * radius * radius:
            return np.full(2, np.nan)
        new_u, new_v = sum_u / total, sum_v / total
        moved = np.hypot(new_u - u, new_v - v)
        u, v = new_u, new_v
        if turn >= 3 and reach > radius + 1.5:
            reach = max(radius + 1.5, reach - 3.0)
        elif moved < 0.02 and turn > 3:
            break
    return from_pixel(u, v, guess, origin, step, uv)


@njit(cache=True)
def ball_weight(
    image: np.ndarray, background: np.ndarray, u: float, v: float, reach: float, ball_level: float
) -> tuple[float, float, float]:
    """Return the weight of the ball's pixels within `reach` of (u, v), and its first moments."""
    total = sum_u = sum_v = 0.0
    for i in range(max(0, int(v - reach)), min(image.shape[0], int(v + reach) + 2)):
        for j in range(max(0, int(u - reach)), min(image.shape[1], int(u + reach) + 2)):
            distance = np.hypot(j - u, i - v)
            level, was = float(image[i, j]), float(background[i, j])
            depth = abs(ball_level - was)
            off = 2.0 * abs(level - ball_level) / max(depth, 20.0)
            share = max(0.0, min(1.0, abs(level - was) / max(depth, 1.0)) - off)
            share *= min(1.0, max(0.0, reach - distance))
            total += share
            sum_u += share * j
            sum_v += share * i
    return total, sum_u, sum_v
