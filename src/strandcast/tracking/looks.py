"""How the string looks in this video, learned from the first frame in which it is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strandcast.tracking.chain import node_normals, place_nodes
from strandcast.tracking.follow import Fit, find_string, fit_string
from strandcast.tracking.picture import Looks, Picture, map_of
from strandcast.tracking.pixelmap import to_pixel
from strandcast.tracking.sighting import STEP_PX, line_score, sample_across
from strandcast.tracking.tip import end_of_string

NOISE_TIMES = 5.0  # a line this many times the noise is taken for the string, before its contrast is known
LEAST_CONTRAST = 5.0  # grey levels
FIRST_REACH_M = 0.045  # from the tip to the visible end: a ball's radius and an error of the length
FOUND = 0.35  # mean reward of a way that is the string


def first_fit(
    picture: Picture,
    hand: np.ndarray,
    links: int,
    link_m: float,
    thickness_m: float | None,
    polarity: float | None,
) -> tuple[Looks, Fit] | None:
    """Find the string in a frame and learn its looks; None where nothing long and thin leaves the clamp.

    Parameters
    ----------
    picture
        The frame.
    hand
        The hand's pose.
    links, link_m
        The chain.
    thickness_m
        The string's thickness, if known.
    polarity
        1 for a string brighter than the background, -1 for a darker one, None to find out.
    """
    scale = picture.pixels.metre_per_pixel
    difference = picture.image[::4, ::4].astype(np.float32) - picture.background[::4, ::4]
    noise = 1.48 * float(np.median(np.abs(difference)))
    half_m = 0.5 * thickness_m if thickness_m else 1.0 * scale
    contrast = max(NOISE_TIMES * noise, LEAST_CONTRAST)
    looks = Looks(max(half_m, 0.6 * scale), contrast, polarity=polarity or 0.0)
    heading, value = find_string(picture, hand, None, links, link_m, looks)
    if value < FOUND:
        return None
    fit = _fit_freely(picture, hand, heading, link_m, looks)
    for _ in range(2):
        looks = _measure(picture, hand, fit, link_m, looks)
        looks = looks if polarity is None else replace(looks, polarity=polarity)
        fit = _fit_freely(picture, hand, fit.heading, link_m, looks)
    return looks, fit


def _fit_freely(picture: Picture, hand: np.ndarray, heading: np.ndarray, link_m: float, looks: Looks) -> Fit:
    half_px = np.full(len(heading) + 1, looks.half_m / picture.pixels.metre_per_pixel)
    return fit_string(picture, hand, heading, heading, link_m, half_px, looks, wide=False, hold_tip=False)


def _measure(picture: Picture, hand: np.ndarray, fit: Fit, link_m: float, looks: Looks) -> Looks:
    """Return the string's half width (half of where its profile is over half its height) and contrast."""
    scale = picture.pixels.metre_per_pixel
    nodes = place_nodes(hand[:2], fit.heading, link_m)[2:]
    half = 24
    _, origin, step, uv = map_of(picture)
    level, difference = sample_across(
        picture.image, picture.background, nodes, node_normals(fit.heading)[2:], STEP_PX * scale, half, 1,
        looks.polarity, origin, step, uv,
    )  # fmt: skip
    good = fit.reward[2:] > 0.5
    if good.sum() < 5:
        return looks
    profile = np.median(difference[good], axis=0)
    profile = profile - np.median(profile)
    peak = profile[half - 2 : half + 3].max()
    wide = 0.5 * STEP_PX * float((profile[half - 8 : half + 9] > 0.5 * peak).sum())
    half_m = float(np.clip(wide, 0.6, 5.0)) * scale
    middle = np.full(len(nodes), max(1, round(half_m / scale / STEP_PX)))
    score = line_score(level, difference, middle, looks.polarity)[good, half - 2 : half + 3].max(axis=1)
    contrast = max(float(np.median(score)), 0.5 * LEAST_CONTRAST)
    return replace(looks, half_m=half_m, contrast=contrast, polarity=_polarity(picture, nodes[good]))


def _polarity(picture: Picture, nodes: np.ndarray) -> float:
    """Return 1 or -1 where nine tenths of the string differ that way from the background, else 0."""
    _, origin, step, uv = map_of(picture)
    pixels = np.array([to_pixel(x, y, origin, step, uv) for x, y in nodes])
    u, v = np.rint(pixels).astype(int).T
    brighter = picture.image[v, u].astype(float) > picture.background[v, u]
    share = float(brighter.mean())
    return 1.0 if share > 0.9 else (-1.0 if share < 0.1 else 0.0)


def visible_end(
    picture: Picture, hand: np.ndarray, fit: Fit, link_m: float, looks: Looks
) -> tuple[float, float]:
    """Return how far beyond the chain's tip the string ends, and its half width there (m); NaN if unclear."""
    nodes = place_nodes(hand[:2], fit.heading, link_m)
    end_m, half_px = end_of_string(
        picture.image,
        picture.background,
        nodes,
        fit.heading,
        looks.contrast,
        looks.polarity,
        FIRST_REACH_M,
        *map_of(picture),
    )
    return end_m, half_px * picture.pixels.metre_per_pixel


def level_at(picture: Picture, place_m: np.ndarray) -> float:
    """Return the median grey level within two pixels of a place (2,) (m)."""
    _, origin, step, uv = map_of(picture)
    u, v = to_pixel(place_m[0], place_m[1], origin, step, uv)
    around = picture.image[max(0, int(v) - 2) : int(v) + 3, max(0, int(u) - 2) : int(u) + 3]
    return float(np.median(around)) if around.size else float("nan")
