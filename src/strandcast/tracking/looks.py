"""How the string looks in this video, learned from many frames: one bad frame teaches nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.tracking.chain import node_normals
from strandcast.tracking.fit import NARROW_PX, Fit, fit_frame
from strandcast.tracking.follower import GOOD, Sight, find_string, still_half_px
from strandcast.tracking.picture import Looks, Picture, is_outside, levels_at
from strandcast.tracking.pixelmap import to_pixel
from strandcast.tracking.sighting import STEP_PX, line_score, sample_across
from strandcast.tracking.tip import end_of_string

NOISE_TIMES = 5.0  # a line this many times the noise is taken for the string, before its contrast is known
LEAST_CONTRAST = 5.0  # grey levels
FIRST_REACH_M = 0.03  # from the tip to the visible end: a ball's radius,
FIRST_REACH_SHARE = 0.15  # and an error of the length, of itself
LENGTH_SPREAD = 0.02  # of the length, within which half of the sightings' ends must agree
FOUND = 0.35  # mean reward of a way that is the string
BALL_TIMES = 1.6  # wider than this, in the string's own widths and a pixel more, is a ball at the tip
BALL_FRAMES, BALL_SHARE = 3, 0.6  # of the frames with a clear end, that show a ball there
OPEN_SHARE = 0.9  # of the most open frame's open share, from which a frame teaches the string's end
NO_BALLS, NO_GUESS = np.zeros((0, 3)), np.zeros((0, 2))
ONE_SENSE = 0.9  # of the string must be brighter than the background to be a bright string


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


def sight(
    frame: int,
    at: Sight,
    links: int,
    link_m: float,
    thickness_m: float | None,
    polarity: float | None,
) -> Sighting | None:
    """Find the string in a frame of its own; None where nothing long and thin leaves the clamp.

    Parameters
    ----------
    frame, at
        The frame.
    links, link_m
        The chain.
    thickness_m
        The string's thickness, if known.
    polarity
        1 for a string brighter than the background, -1 for a darker one, None to find out.
    """
    picture = at.picture
    scale = picture.plane.metre_per_pixel
    noise = noise_of(picture)
    half_m = 0.5 * thickness_m if thickness_m else 1.0 * scale
    contrast = max(NOISE_TIMES * noise, LEAST_CONTRAST)
    looks = Looks(max(half_m, 0.6 * scale), contrast, polarity=polarity or 0.0, noise=noise)
    heading, value = find_string(at, None, links, link_m, looks)
    if value < FOUND:
        return None
    fit = _fit_freely(at, heading, link_m, looks)
    for _ in range(2):
        looks = _measure(picture, fit, looks)
        looks = looks if polarity is None else looks._replace(polarity=polarity)
        looks = looks if thickness_m is None else looks._replace(half_m=max(0.5 * thickness_m, 0.6 * scale))
        fit = _fit_freely(at, fit.heading, link_m, looks)
    nodes = fit.nodes()
    reach_m = FIRST_REACH_M + FIRST_REACH_SHARE * links * link_m
    end_m, half_px = end_of_string(picture, nodes, fit.heading, looks, reach_m)
    half_m = half_px * scale
    along = np.array([np.cos(fit.heading[-1]), np.sin(fit.heading[-1])])
    level = level_at(picture, nodes[-1] + (end_m - half_m) * along) if np.isfinite(end_m) else np.nan
    return Sighting(frame, looks, fit, end_m, half_m, level)


def noise_of(picture: Picture) -> float:
    """Return the standard deviation (grey levels) of what has not changed, from every fourth pixel."""
    rows, columns = picture.image.shape
    behind = picture.background[picture.top : picture.top + rows, picture.left : picture.left + columns]
    change = picture.image[::4, ::4].astype(np.float32) - behind[::4, ::4]
    return 1.48 * float(np.median(np.abs(change)))


def learn_looks(sightings: list[Sighting], pixel_m: float) -> Looks:
    """Learn the string's looks as the medians over the sightings that show them well.

    Parameters
    ----------
    sightings
        At least one.
    pixel_m
        A pixel's size in the string's plane.
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
    if not clear:
        return looks._replace(tip_excess_m=looks.half_m)
    wide = [s for s in clear if s.end_half_m > BALL_TIMES * looks.half_m + pixel_m]
    if len(wide) < max(BALL_FRAMES, BALL_SHARE * len(clear)):
        return looks._replace(tip_excess_m=looks.half_m)
    half_m = float(np.median([s.end_half_m for s in wide]))
    level = float(np.median([s.end_level for s in wide]))
    return looks._replace(tip_excess_m=half_m, ball_level=level)


def seen_length(sightings: list[Sighting], looks: Looks, given_m: float) -> float:
    """Return the string's length as the sightings' ends tell it; as it was given where they do not agree.

    A rough one, for the chain to be of about the right length from the start; all frames tell it better.
    """
    good = [s for s in sightings if s.fit.value >= GOOD and np.isfinite(s.end_m)]
    if len(good) < BALL_FRAMES:
        return given_m
    beyond_m = np.array([s.end_m for s in good]) - looks.tip_excess_m
    middle_m = float(np.median(beyond_m))
    spread_m = float(np.median(np.abs(beyond_m - middle_m)))
    return given_m + middle_m if spread_m < LENGTH_SPREAD * given_m else given_m


def _fit_freely(at: Sight, heading: np.ndarray, link_m: float, looks: Looks) -> Fit:
    half_px = still_half_px(looks, len(heading), at.picture)
    return fit_frame(
        at.picture, at.clamp_m, heading, heading, link_m, half_px, looks, NO_BALLS, NO_GUESS, NARROW_PX, False
    )


def _measure(picture: Picture, fit: Fit, looks: Looks) -> Looks:
    """Return the string's half width (at half its height), contrast and level."""
    scale = picture.plane.metre_per_pixel
    nodes = fit.nodes()[2:]
    half = 24
    level, difference = sample_across(
        picture, nodes, node_normals(fit.heading)[2:], STEP_PX * scale, half, 1, looks.polarity
    )
    good = fit.reward[2:] > 0.5
    if good.sum() < 5:
        return looks
    widths = [width_at_half(profile, half) for profile in difference[good]]
    half_m = float(np.clip(0.5 * STEP_PX * np.median(widths), 0.6, 5.0)) * scale
    middle = np.full(len(nodes), max(1, round(half_m / scale / STEP_PX)))
    score = line_score(level, difference, middle, looks.polarity)[good, half - 2 : half + 3].max(axis=1)
    contrast = max(float(np.median(score)), 0.5 * LEAST_CONTRAST)
    shown, behind = levels_on(picture, nodes[good])
    if len(shown) < 5:
        return looks
    brighter = float((shown > behind).mean())
    sense = 1.0 if brighter > ONE_SENSE else (-1.0 if brighter < 1 - ONE_SENSE else 0.0)
    return looks._replace(half_m=half_m, contrast=contrast, polarity=sense, level=float(np.median(shown)))


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


def levels_on(picture: Picture, places_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the grey levels of picture and background at places (K, 2) (m), those outside left out."""
    pixels = [to_pixel(x, y, picture.plane) for x, y in places_m]
    both = [levels_at(picture, u, v) for u, v in pixels if not is_outside(picture, u, v, 0.0)]
    now, was = np.array(both).reshape(-1, 2).T
    return now, was


def level_at(picture: Picture, place_m: np.ndarray) -> float:
    """Return the median grey level within two pixels of a place (2,) (m)."""
    u, v = to_pixel(place_m[0], place_m[1], picture.plane)
    i, j = int(v) - picture.top, int(u) - picture.left
    around = picture.image[max(0, i - 2) : max(0, i + 3), max(0, j - 2) : max(0, j + 3)]
    return float(np.median(around)) if around.size else float("nan")
