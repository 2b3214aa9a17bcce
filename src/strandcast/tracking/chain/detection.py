"""Detect the string in single frames, and learn its appearance as medians, robust to single bad frames."""

import math
from dataclasses import dataclass

import numpy as np

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.bead_search import Beads
from strandcast.tracking.chain.fit import NARROW_PX, ChainModel, FrameFit, PredictedChain, fit_frame
from strandcast.tracking.chain.frames import FrameInput
from strandcast.tracking.chain.measure import LEAST_CONTRAST, level_at, measure_appearance, noise_of
from strandcast.tracking.chain.motion import still_half_px
from strandcast.tracking.chain.search_window import levels_at
from strandcast.tracking.chain.tip import BEAD_TIMES, end_of_string
from strandcast.tracking.chain.tracker import GOOD, find_string, links_of
from strandcast.tracking.pixel_map import to_pixel
from strandcast.tracking.tracker import StringHint

# All chosen on the drawn and lab videos of the tracking benchmark.
NOISE_TIMES = 5.0  # a line this many times the noise is taken for the string while its contrast is unknown
LEAST_HALF_PX = 0.6  # of the string's visible half width
FIRST_REACH_M = 0.03  # from the tip to the visible end: a bead's radius,
FIRST_REACH_SHARE = 0.15  # and an error of the length, relative
ENDS_AGREE_M = 0.003  # ends within about this agree
ALONE = 1.5  # an end alone counts as 1, two in the same place as 2
LENGTH_SHARE = 0.04  # ends farther off than this share of the given length, which may be wrong, count less
FOUND = 0.35  # mean reward of a path that is the string
HIDES = 2.0  # radii: a weight declared farther from the end than this is not the one seen there
UNEVEN = 0.3  # of the string's contrast, by which the sides of a bead differ that has no one grey level
BEAD_FRAMES, BEAD_SHARE = 3, 0.6  # frames, and share of those with a clear end, that must show a bead there
# From the string's end to its last visible pixel, in half its visible width. Measured on two renderers' films
# (docs/explanation/sure-misses.md): 0.1 to 0.3 where it is cut, 0.7 to 1.1 where round, 1.8 where frayed.
END_WIDTHS = 0.6
OPEN_SHARE = 0.9  # of the largest open share, from which a frame shows the string's end well
NO_BEADS, NO_PLACES = Beads(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0)), np.zeros((0, 2))


@dataclass(frozen=True, eq=False)
class Detection:
    """The string as one frame alone shows it."""

    frame: int
    appearance: Appearance
    fit: FrameFit
    end_m: float  # how far beyond the chain's tip the string ends; NaN if that is not clear
    end_half_m: float  # half its width near that end
    end_level: float  # grey level half that width before the end
    end_levels: tuple[float, float]  # the least and the largest there and halfway to that width around it


def detect_string(
    frame: int, given: FrameInput, string: StringHint, polarity: float | None
) -> Detection | None:
    """Detect the string in a single frame; None where nothing long and thin leaves the clamp.

    A known thickness and polarity (as in `Appearance`) are kept; those given as None are measured.
    """
    window, thickness_m, links = given.window, string.thickness_m, links_of(string)
    scale, link_m = window.plane.metre_per_pixel, string.length_m / links
    noise = noise_of(window)
    half_m = 0.5 * thickness_m if thickness_m else 1.0 * scale
    contrast = max(NOISE_TIMES * noise, LEAST_CONTRAST)
    appearance = Appearance(
        max(half_m, LEAST_HALF_PX * scale), contrast, polarity=polarity or 0.0, noise=noise
    )
    heading, value = find_string(given, None, links, link_m, appearance)
    if value < FOUND:
        return None
    fit = _fit_free(given, heading, link_m, appearance)
    for _ in range(2):
        appearance = measure_appearance(window, fit, appearance)
        if polarity is not None:
            appearance = appearance._replace(polarity=polarity)
        if thickness_m is not None:
            appearance = appearance._replace(half_m=max(0.5 * thickness_m, LEAST_HALF_PX * scale))
        fit = _fit_free(given, fit.heading, link_m, appearance)
    reach_m = FIRST_REACH_M + FIRST_REACH_SHARE * links * link_m
    return _with_end(frame, given, appearance, fit, reach_m)


def _fit_free(given: FrameInput, heading: np.ndarray, link_m: float, appearance: Appearance) -> FrameFit:
    """Fit the chain without holding its tip."""
    half_px = still_half_px(appearance, len(heading), given.window)
    expected = PredictedChain(given.clamp_m, heading, heading, half_px, NO_PLACES)
    fit: FrameFit = fit_frame(
        given.window, ChainModel(link_m, appearance, NO_BEADS), expected, NARROW_PX, False
    )
    return fit


def _with_end(
    frame: int, given: FrameInput, appearance: Appearance, fit: FrameFit, reach_m: float
) -> Detection:
    """Return the detection with the string's end, searched within `reach_m` of the chain's tip."""
    nodes = fit.nodes()
    end_m, half_px = end_of_string(given.window, nodes, fit.heading, appearance, reach_m)
    half_m = half_px * given.window.plane.metre_per_pixel
    along = np.array([np.cos(fit.heading[-1]), np.sin(fit.heading[-1])])
    level, least, most = np.nan, np.nan, np.nan
    if np.isfinite(end_m):
        middle = nodes[-1] + (end_m - half_m) * along
        level = level_at(given.window, middle)
        across = np.array([-along[1], along[0]])
        places = middle + 0.5 * half_m * np.array([0 * along, along, -along, across, -across])
        levels = [levels_at(given.window, *to_pixel(x, y, given.window.plane))[0] for x, y in places]
        least, most = min(levels), max(levels)
    return Detection(frame, appearance, fit, end_m, half_m, level, (least, most))


def learn_appearance(detections: list[Detection], pixel_m: float, beyond_m: float = math.inf) -> Appearance:
    """Return the string's appearance: the medians over the detections (at least one) that show it well.

    `beyond_m` is the length of string beyond the centre of the last weight, as declared: if that weight hides
    the string's end, this says where it is.
    """
    good = [one for one in detections if one.fit.value >= GOOD] or detections
    appearance = Appearance(
        half_m=float(np.median([one.appearance.half_m for one in good])),
        contrast=float(np.median([one.appearance.contrast for one in good])),
        polarity=float(np.sign(sum(one.appearance.polarity for one in good))),
        noise=float(np.median([one.appearance.noise for one in good])),
        level=float(np.median([one.appearance.level for one in good])),
    )
    ended = sorted((one for one in good if np.isfinite(one.end_m)), key=lambda one: -one.fit.open_share)
    least = OPEN_SHARE * (ended[0].fit.open_share if ended else 0.0)
    # At least as many as must show a bead: a survey may end with few frames.
    clear = ended[: max(BEAD_FRAMES, sum(one.fit.open_share >= least for one in ended))]
    wide = [one for one in clear if one.end_half_m > BEAD_TIMES * appearance.half_m + pixel_m]
    if len(wide) < max(BEAD_FRAMES, BEAD_SHARE * len(clear)):
        half_m = float(np.median([one.end_half_m for one in clear])) if clear else appearance.half_m
        return appearance._replace(tip_excess_m=END_WIDTHS * half_m)
    half_m = float(np.median([one.end_half_m for one in wide]))
    level = float(np.median([one.end_level for one in wide]))
    levels = np.median([one.end_levels for one in wide], axis=0)
    if levels[1] - levels[0] < UNEVEN * appearance.contrast:
        levels[:] = level
    if beyond_m >= HIDES * half_m:
        beyond_m = 0.0
    return appearance._replace(
        tip_excess_m=max(half_m - beyond_m, 0.0),
        bead_level=float(levels[0]),
        bead_highest=float(levels[1]),
        bead_m=half_m,
        beyond_m=beyond_m,
    )


def visible_length(detections: list[Detection], appearance: Appearance, given_m: float) -> float:
    """Return the string's length from the detections' ends.

    A rough value, so that the chain has about the right length from the start; all frames together show it
    better. Where the background resembles the string, ends disagree: then the length with which most of them
    agree, nearer to the given one rather than farther, or the given one if no two agree.
    """
    good = [one for one in detections if one.fit.value >= GOOD and np.isfinite(one.end_m)]
    if len(good) < BEAD_FRAMES:
        return given_m
    lengths_m = np.array([given_m + one.end_m - appearance.tip_excess_m for one in good])
    middle_m = float(np.median(lengths_m))
    if np.median(np.abs(lengths_m - middle_m)) < ENDS_AGREE_M:
        return middle_m
    alike = np.exp(-0.5 * ((lengths_m[:, None] - lengths_m) / ENDS_AGREE_M) ** 2)
    likely = 1.0 / np.hypot(1.0, (lengths_m - given_m) / (LENGTH_SHARE * given_m))
    best = int(np.argmax(alike.sum(axis=1) * likely))
    return float(np.average(lengths_m, weights=alike[best])) if alike[best].sum() > ALONE else given_m


def length_between(detections: list[Detection], far_m: np.ndarray) -> float:
    """Return the string's length up to its other held end, which is at `far_m` (F, 2) in each frame."""
    lengths_m = []
    for one in detections:
        away_m = np.linalg.norm(one.fit.nodes() - far_m[one.frame], axis=1)
        nearest = int(np.argmin(away_m))
        beyond_m = away_m[-1] if nearest == len(away_m) - 1 else 0.0
        lengths_m.append(nearest * one.fit.link_m + beyond_m)
    return float(np.median(lengths_m))
