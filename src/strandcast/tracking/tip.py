"""Where the string ends: its visible end along the chain, or the ball that hangs there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.picture import Looks, Picture, is_outside, levels_at
from strandcast.tracking.pixelmap import from_pixel, to_pixel
from strandcast.tracking.sighting import STEP_PX, sample_across

TIP_REACH_M = 0.018  # how far from the predicted tip the string's end is looked for
TIP_PX = 1.0  # standard deviation of the end's place along the string
BALL_PX = 0.5  # of a ball's centre, each way
BALL_REACH_PX = 14.0  # from the predicted tip to the ball's centre
ALONG_PX = 0.5  # between places along the string
WIDEST_PX = 14.0  # half width of the widest ball
LEAST_INSIDE = 0.4  # of a clear line, that the string must show before its end
EDGE_PX = 4.0  # from the picture's edge, within which no end is believed
MOST_CHANGED = 1.5  # clear lines; before what is darker than usual, a bright string changes more
END_PX = 5.0  # from the chain's tip to the string's visible end, from which it is not
LEAST_DEPTH = 0.45  # of the usual difference of string and background, under which no end is seen
OUTSIDE_RUN = 4  # places without string that make an end


class Tip(NamedTuple):
    """By how much the tip should move along the last link (m), with a weight (1/m²), 0 for unknown."""

    along_m: float
    weight: float


@njit(cache=True)
def no_tip() -> Tip:
    """Return that nothing is known of the tip."""
    return Tip(0.0, 0.0)


@njit(cache=True)
def locate_tip(picture: Picture, nodes: np.ndarray, heading: np.ndarray, looks: Looks) -> Tip:
    """Return by how much the tip should move to the string's visible end."""
    end_m = end_of_string(picture, nodes, heading, looks, TIP_REACH_M + looks.tip_excess_m)[0]
    if not np.isfinite(end_m):
        return no_tip()
    return Tip(end_m - looks.tip_excess_m, 1.0 / (TIP_PX * picture.plane.metre_per_pixel) ** 2)


@njit(cache=True)
def place_on(nodes: np.ndarray, heading: np.ndarray, place_m: float) -> np.ndarray:
    """Return where a place along the chain (m) is, (2,)."""
    link_m = np.hypot(nodes[1, 0] - nodes[0, 0], nodes[1, 1] - nodes[0, 1])
    j = min(max(int(place_m / link_m), 0), len(heading) - 1)
    beyond_m = place_m - j * link_m
    return nodes[j] + beyond_m * np.array([np.cos(heading[j]), np.sin(heading[j])])


@njit(cache=True)
def pin_balls(
    picture: Picture, nodes: np.ndarray, heading: np.ndarray, balls: np.ndarray, guess: np.ndarray
) -> np.ndarray:
    """Return the pins (P, 4), as `Evidence` takes them, of balls (B, 3) that are seen where they should be.

    A ball is its place along the chain (m), its radius (m) and its grey level. `guess` (B, 2) is where it is
    thought to be (m); NaN where that is the chain's to say.
    """
    scale = picture.plane.metre_per_pixel
    pins = np.zeros((len(balls), 4))
    count = 0
    for b in range(len(balls)):
        ball = balls[b]
        expected = guess[b] if np.isfinite(guess[b, 0]) else place_on(nodes, heading, ball[0])
        centre = ball_centre(picture, expected, ball[1], ball[2])
        if np.hypot(centre[0] - expected[0], centre[1] - expected[1]) < BALL_REACH_PX * scale:
            pins[count, 0], pins[count, 1], pins[count, 2] = ball[0], centre[0], centre[1]
            pins[count, 3] = 1.0 / (BALL_PX * scale) ** 2
            count += 1
    return pins[:count]


@njit(cache=True)
def ends_at_tip(picture: Picture, nodes: np.ndarray, heading: np.ndarray, looks: Looks) -> bool:
    """Tell whether the string, or the ball at its tip, is seen to end where the chain does."""
    end_m = end_of_string(picture, nodes, heading, looks, TIP_REACH_M + looks.tip_excess_m)[0]
    return abs(end_m - looks.tip_excess_m) < END_PX * picture.plane.metre_per_pixel


@njit(cache=True)
def end_of_string(
    picture: Picture, nodes: np.ndarray, heading: np.ndarray, looks: Looks, reach_m: float
) -> tuple[float, float]:
    """Return how far beyond the tip the string ends (m, negative before it), and its half width (px).

    Walks along the chain's end and straight on, until the picture is the background again; NaN where that is
    not within `reach_m` of the tip, or not clear. The width is the largest near the end.
    """
    contrast, scale = looks.contrast, picture.plane.metre_per_pixel
    pitch_m = ALONG_PX * scale
    places, normals, before = walk_past_tip(nodes, heading, reach_m, pitch_m)
    half = int(np.ceil(WIDEST_PX / STEP_PX))
    _, difference = sample_across(picture, places, normals, STEP_PX * scale, half, 0, looks.polarity)
    changed = best_in_band(difference, half)
    seen = scale_to_background(picture, places, changed, looks)
    changed = np.minimum(changed, MOST_CHANGED * contrast)
    inside = np.median(changed[: max(3, before // 2)])
    if inside < LEAST_INSIDE * contrast:
        return np.nan, np.nan
    threshold = 0.5 * inside
    last = last_above(changed, threshold)
    if last < 1 or last >= len(changed) - OUTSIDE_RUN:
        return np.nan, np.nan
    u, v = to_pixel(places[last + 1, 0], places[last + 1, 1], picture.plane)
    if is_outside(picture, u, v, EDGE_PX):
        return np.nan, np.nan  # it leaves the picture, it does not end
    if not seen[last : last + 1 + OUTSIDE_RUN].all():
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
def scale_to_background(
    picture: Picture, places: np.ndarray, changed: np.ndarray, looks: Looks
) -> np.ndarray:
    """Scale changes (K,) to what they would be before the usual background, in place; tell where that can be.

    Before what is nearly as grey as the string, the string changes the picture less.
    """
    seen = np.ones(len(places), dtype=np.bool_)
    if not np.isfinite(looks.level):
        return seen
    depth = np.empty(len(places))
    for i in range(len(places)):
        u, v = to_pixel(places[i, 0], places[i, 1], picture.plane)
        depth[i] = looks.level - levels_at(picture, u, v)[1]
        if looks.polarity != 0:
            depth[i] = max(0.0, looks.polarity * depth[i])
        depth[i] = abs(depth[i])
    usual = np.median(depth)
    for i in range(len(places)):
        seen[i] = depth[i] > LEAST_DEPTH * usual
        if seen[i]:
            changed[i] *= usual / depth[i]
    return seen


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
def ball_centre(picture: Picture, guess: np.ndarray, radius_m: float, ball_level: float) -> np.ndarray:
    """Return the centre (2,) (m) of the ball near `guess` by mean shift; NaN where too little of it is seen.

    A pixel counts as far as it has changed and is as grey as the ball: the arm does not draw it aside.
    """
    u, v = to_pixel(guess[0], guess[1], picture.plane)
    radius = radius_m / picture.plane.metre_per_pixel
    reach = radius + BALL_REACH_PX
    for _ in range(24):
        total, sum_u, sum_v = ball_weight(picture, u, v, reach, ball_level)
        if total < 0.3 * 3.14159 * radius * radius:
            return np.full(2, np.nan)
        new_u, new_v = sum_u / total, sum_v / total
        moved = np.hypot(new_u - u, new_v - v)
        u, v = new_u, new_v
        if reach > radius + 1.5:
            reach = max(radius + 1.5, min(reach - 3.0, radius + 2.0 * moved))
        elif moved < 0.02:
            break
    return from_pixel(u, v, guess, picture.plane)


@njit(cache=True)
def ball_weight(
    picture: Picture, u: float, v: float, reach: float, ball_level: float
) -> tuple[float, float, float]:
    """Return the weight of the ball's pixels within `reach` of (u, v), and its first moments."""
    image, background, left, top = picture.image, picture.background, picture.left, picture.top
    total = sum_u = sum_v = 0.0
    for i in range(max(top, int(v - reach)), min(top + image.shape[0], int(v + reach) + 2)):
        for j in range(max(left, int(u - reach)), min(left + image.shape[1], int(u + reach) + 2)):
            squared = (j - u) ** 2 + (i - v) ** 2
            if squared >= reach * reach:
                continue
            level, was = float(image[i - top, j - left]), float(background[i, j])
            depth = abs(ball_level - was)
            off = 2.0 * abs(level - ball_level) / max(depth, 20.0)
            share = max(0.0, min(1.0, abs(level - was) / max(depth, 1.0)) - off)
            if squared > (reach - 1.0) ** 2:
                share *= reach - np.sqrt(squared)
            total += share
            sum_u += share * j
            sum_v += share * i
    return total, sum_u, sum_v
