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
OPEN_SHARE = 0.85  # of the most open frame's open share, from which a frame teaches the length
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
        FIRST_REACH_M, *map_of(picture),
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
        half_m=float(np.percentile([s.looks.half_m for s in good], 25)),  # others are blurred
        contrast=float(np.median([s.looks.contrast for s in good])),
        polarity=float(np.sign(sum(s.looks.polarity for s in good))),
        noise=float(np.median([s.looks.noise for s in good])),
    )
    ended = [s for s in good if np.isfinite(s.end_m)]
    openest = max((s.fit.open_share for s in ended), default=0.0)
    clear = [s for s in ended if s.fit.open_share >= OPEN_SHARE * openest]
    if len(clear) < TEACHERS:
        return Lesson(
            replace(looks, tip_excess_m=looks.half_m),
            length_m,
            [f"the string's end is clear in {len(clear)} frames of {len(sightings)}: its length is the file's"],
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


def level_at(picture: Picture, place_m: np.ndarray) -> float:
    """Return the median grey level within two pixels of a place (2,) (m)."""
    _, origin, step, uv = map_of(picture)
    u, v = to_pixel(place_m[0], place_m[1], origin, step, uv)
    around = picture.image[max(0, int(v) - 2) : int(v) + 3, max(0, int(u) - 2) : int(u) + 3]
    return float(np.median(around)) if around.size else float("nan")
