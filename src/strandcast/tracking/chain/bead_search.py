"""Beads on the string in one frame: round, of a known grey level, near a known place along the chain."""

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.chain.constraints import Pins
from strandcast.tracking.chain.links import place_on
from strandcast.tracking.chain.search_window import SearchWindow
from strandcast.tracking.pixel_map import from_pixel, to_pixel

# Chosen on the drawn and lab videos of the tracking benchmark.
BEAD_PX = 0.5  # standard deviation of a bead's centre, or of a given place, per axis
BEAD_REACH_PX = 14.0  # from the predicted place to the bead's centre


class Beads(NamedTuple):
    """Beads on the string, the tip's last; one without a radius is a place that is given, not searched."""

    place_m: np.ndarray  # along the string, (B,)
    radius_m: np.ndarray  # (B,)
    level: np.ndarray  # the lowest grey level, (B,)
    highest: np.ndarray  # the highest, (B,)


@njit(cache=True)
def pin_beads(
    window: SearchWindow, nodes: np.ndarray, heading: np.ndarray, beads: Beads, expected_m: np.ndarray
) -> Pins:
    """Return pins at the beads that are found near where they should be, and at given places.

    `expected_m` (B, 2) is where each bead is expected; NaN where the chain gives its place.
    """
    scale = window.plane.metre_per_pixel
    place_m, point_m = np.zeros(len(beads.place_m)), np.zeros((len(beads.place_m), 2))
    count = 0
    for b in range(len(beads.place_m)):
        known = np.isfinite(expected_m[b, 0])
        if beads.radius_m[b] == 0.0 and not known:
            continue
        expected = expected_m[b] if known else place_on(nodes, heading, beads.place_m[b])
        centre = bead_centre(window, expected, beads, b) if beads.radius_m[b] > 0.0 else expected
        if np.hypot(centre[0] - expected[0], centre[1] - expected[1]) < BEAD_REACH_PX * scale:
            place_m[count] = beads.place_m[b]
            point_m[count, 0], point_m[count, 1] = centre[0], centre[1]
            count += 1
    return Pins(place_m[:count], point_m[:count], np.full(count, 1.0 / (BEAD_PX * scale) ** 2))


@njit(cache=True)
def is_tip_given(beads: Beads, length_m: float, expected_m: np.ndarray) -> bool:
    """Return whether the place of the string's end is given."""
    given = False
    for b in range(len(beads.place_m)):
        given |= (
            beads.radius_m[b] == 0.0
            and beads.place_m[b] >= 0.999 * length_m
            and np.isfinite(expected_m[b, 0])
        )
    return given


@njit(cache=True)
def behind_bead(place_m: float, beads: Beads) -> bool:
    """Return whether a bead hides a place along the string."""
    hidden = False
    for b in range(len(beads.place_m)):
        hidden |= abs(place_m - beads.place_m[b]) < beads.radius_m[b]
    return hidden


@njit(cache=True)
def bead_centre(window: SearchWindow, guess: np.ndarray, beads: Beads, b: int) -> np.ndarray:
    """Return the centre (2,) (m) of bead `b` near `guess` by mean shift; NaN if too little of it is visible.

    A pixel's weight grows with its change and its similarity to the bead's greys: the arm has no pull.
    """
    u, v = to_pixel(guess[0], guess[1], window.plane)
    radius = beads.radius_m[b] / window.plane.metre_per_pixel
    reach = radius + BEAD_REACH_PX
    for _ in range(24):
        total, sum_u, sum_v = bead_moments(window, u, v, reach, beads.level[b], beads.highest[b])
        if total < 0.3 * 3.14159 * radius * radius:
            return np.full(2, np.nan)
        new_u, new_v = sum_u / total, sum_v / total
        moved = np.hypot(new_u - u, new_v - v)
        u, v = new_u, new_v
        if reach > radius + 1.5:
            reach = max(radius + 1.5, min(reach - 3.0, radius + 2.0 * moved))
        elif moved < 0.02:
            break
    centre = np.empty(2)
    centre[0], centre[1] = from_pixel(u, v, guess, window.plane)
    return centre


@njit(cache=True)
def bead_moments(
    window: SearchWindow, u: float, v: float, reach: float, lowest: float, highest: float
) -> tuple[float, float, float]:
    """Return the summed weight of the bead's pixels within `reach` of (u, v), and its first moments."""
    image, background, left, top = window.image, window.background, window.left, window.top
    total = sum_u = sum_v = 0.0
    for i in range(max(top, int(v - reach)), min(top + image.shape[0], int(v + reach) + 2)):
        for j in range(max(left, int(u - reach)), min(left + image.shape[1], int(u + reach) + 2)):
            squared = (j - u) ** 2 + (i - v) ** 2
            if squared >= reach * reach:
                continue
            level, was = float(image[i - top, j - left]), float(background[i, j])
            depth = min(abs(lowest - was), abs(highest - was))
            off = 2.0 * max(lowest - level, level - highest, 0.0) / max(depth, 20.0)
            share = max(0.0, min(1.0, abs(level - was) / max(depth, 1.0)) - off)
            if squared > (reach - 1.0) ** 2:
                share *= reach - np.sqrt(squared)
            total += share
            sum_u += share * j
            sum_v += share * i
    return total, sum_u, sum_v
