"""How the string looks in this video, learned from many frames: one bad frame teaches nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.tracking.chain import node_normals, place_nodes
from strandcast.tracking.follow import GOOD, Fit, find_string, fit_string
from strandcast.tracking.picture import Looks, Picture, map_of
from strandcast.tracking.pixelmap import to_pixel
from strandcast.tracking.sighting import STEP_PX, line_score, sample_across
from strandcast.tracking.tip import end_of_string

NOISE_TIMES = 5.0  # a line this many times the noise is taken for the string, before its contrast is known
LEAST_CONTRAST = 5.0  # grey levels
FIRST_REACH_M = 0.045  # from the tip to the visible end: a ball's radius and an error of the length
FOUND = 0.35  # mean reward of a way that is the string
BALL_TIMES = 1.6  # wider than this, in the string's own widths and a pixel more, is a ball at the tip
LARGEST_CORRECTION = 0.03  # of the length, by the string's visible end
OPEN_SHARE = 0.9  # of the most open frame's open share, from which a frame teaches the length
ONE_SENSE = 0.9  # of the string must be brighter than the background to be a bright string
TEACHERS = 3  # frames with a clear end that a length is taken from, at least


@dataclass(frozen=True)
class Sighting:
    """The string as one frame alone shows it.

    Attributes
    ----------
    frame
        Its index.
    looks, fit
        Found without knowing anything of other frames.
    end_m
        How far beyond the chain's tip the string ends; NaN where that is not clear.
    end_half_m, end_level
        Half its width near that end, and the grey level half that width before it.
    """

    frame: int
    looks: Looks
    fit: Fit
    end_m: float
    end_half_m: float
    end_level: float


@dataclass(frozen=True)
class Lesson:
    """What all sightings teach together: looks, length (m), what to warn of, frames with a clear end."""

    looks: Looks
    length_m: float
    warnings: list[str]
    teachers: int


def sight(
    frame: int,
    picture: Picture,
    hand: np.ndarray,
    links: int,
    link_m: float,
    thickness_m: float | None,
    polarity: float | None,
) -> Sighting | None:
    """Find the string in a frame of its own; None where nothing long and thin leaves the clamp.

    Parameters
    ----------
    frame, picture
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
    looks = Looks(max(half_m, 0.6 * scale), contrast, polarity=polarity or 0.0, noise=noise)
    heading, value = find_string(picture, hand, None, links, link_m, looks)
    if value < FOUND:
        return None
    fit = _fit_freely(picture, hand, heading, link_m, looks)
    for _ in range(2):
        looks = _measure(picture, hand, fit, link_m, looks)
        looks = looks if polarity is None else replace(looks, polarity=polarity)
        fit = _fit_freely(picture, hand, fit.heading, link_m, looks)
    nodes = place_nodes(hand[:2], fit.heading, link_m)
    end_m, half_px = end_of_string(
        picture.image, picture.background, nodes, fit.heading, looks.contrast, looks.polarity,
        looks.blind, FIRST_REACH_M, *map_of(picture),
    )  # fmt: skip
    half_m = half_px * scale
    along = np.array([np.cos(fit.heading[-1]), np.sin(fit.heading[-1])])
    level = level_at(picture, nodes[-1] + (end_m - half_m) * along) if np.isfinite(end_m) else np.nan
    return Sighting(frame, looks, fit, end_m, half_m, level)


def learn_looks(sightings: list[Sighting], length_m: float, pixel_m: float) -> Lesson:
    """Learn the string's looks and length as the medians over the sightings that show them well.

    Parameters
    ----------
    sightings
        At least one.
    length_m
        The length that the chain had in the sightings.
    pixel_m
        A pixel's size in the string's plane.

    Notes
    -----
    Where the hand or the arm hides part of the string, its way there is a guess, and so is the chain's tip:
    the length is taken from the frames in which most of the string is open.
    """
    good = [s for s in sightings if s.fit.value >= GOOD] or sightings
    looks = Looks(
        half_m=float(np.median([s.looks.half_m for s in good])),
        contrast=float(np.median([s.looks.contrast for s in good])),
        polarity=float(np.sign(sum(s.looks.polarity for s in good))),
        noise=float(np.median([s.looks.noise for s in good])),
        level=float(np.median([s.looks.level for s in good])),
    )
    ended = [s for s in good if np.isfinite(s.end_m)]
    openest = max((s.fit.open_share for s in ended), default=0.0)
    clear = [s for s in ended if s.fit.open_share >= OPEN_SHARE * openest]
    if len(clear) < TEACHERS:
        return Lesson(
            replace(looks, tip_excess_m=looks.half_m),
            length_m,
            [f"the string's end is clear in {len(clear)} of {len(sightings)} frames: its length is as given"],
            len(clear),
        )  # fmt: skip
    half_m = float(np.median([s.end_half_m for s in clear]))
    ball = half_m > BALL_TIMES * looks.half_m + pixel_m
    excess_m = half_m if ball else looks.half_m
    level = float(np.median([s.end_level for s in clear])) if ball else np.nan
    looks = replace(looks, tip_excess_m=excess_m, ball_level=level)
    correction_m = float(np.median([s.end_m for s in clear])) - excess_m
    if abs(correction_m) > LARGEST_CORRECTION * length_m:
        text = f"the string's visible end does not fit its length: it is {1e3 * correction_m:+.1f} mm off"
        return Lesson(looks, length_m, [text], len(clear))
    return Lesson(looks, length_m + correction_m, [], len(clear))


def _fit_freely(picture: Picture, hand: np.ndarray, heading: np.ndarray, link_m: float, looks: Looks) -> Fit:
    half_px = np.full(len(heading) + 1, looks.half_m / picture.pixels.metre_per_pixel)
    return fit_string(picture, hand, heading, heading, link_m, half_px, looks, wide=False, hold_tip=False)


def _measure(picture: Picture, hand: np.ndarray, fit: Fit, link_m: float, looks: Looks) -> Looks:
    """Return the string's half width (at half its height), contrast and level."""
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
    widths = [width_at_half(profile, half) for profile in difference[good]]
    half_m = float(np.clip(0.5 * STEP_PX * np.median(widths), 0.6, 5.0)) * scale
    middle = np.full(len(nodes), max(1, round(half_m / scale / STEP_PX)))
    score = line_score(level, difference, middle, looks.polarity)[good, half - 2 : half + 3].max(axis=1)
    contrast = max(float(np.median(score)), 0.5 * LEAST_CONTRAST)
    shown, behind = levels_at(picture, nodes[good])
    if len(shown) < 5:
        return looks
    brighter = float((shown > behind).mean())
    sense = 1.0 if brighter > ONE_SENSE else (-1.0 if brighter < 1 - ONE_SENSE else 0.0)
    return replace(looks, half_m=half_m, contrast=contrast, polarity=sense, level=float(np.median(shown)))


def width_at_half(profile: np.ndarray, middle: int) -> float:
    """Return how wide (in samples) the peak near `middle` is at half its height over the profile's median."""
    above = profile - np.median(profile)
    peak = middle - 2 + int(np.argmax(above[middle - 2 : middle + 3]))
    level = 0.5 * above[peak]
    width = 0.0
    for way in (above[peak::-1], above[peak:]):
        under = int(np.argmax(way < level))
        width += under - (level - way[under]) / max(way[under - 1] - way[under], 1e-9) if under else 0.0
    return float(width)


def levels_at(picture: Picture, places_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the grey levels of picture and background at places (K, 2) (m), those outside left out."""
    _, origin, step, uv = map_of(picture)
    pixels = np.array([to_pixel(x, y, origin, step, uv) for x, y in places_m])
    u, v = np.rint(pixels).astype(int).T
    rows, columns = picture.image.shape
    shown = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
    u, v = u[shown], v[shown]
    return picture.image[v, u].astype(float), picture.background[v, u].astype(float)


def level_at(picture: Picture, place_m: np.ndarray) -> float:
    """Return the median grey level within two pixels of a place (2,) (m)."""
    _, origin, step, uv = map_of(picture)
    u, v = to_pixel(place_m[0], place_m[1], origin, step, uv)
    rows, columns = (
        slice(max(0, int(v) - 2), max(0, int(v) + 3)),
        slice(max(0, int(u) - 2), max(0, int(u) + 3)),
    )
    around = picture.image[rows, columns]
    return float(np.median(around)) if around.size else float("nan")
