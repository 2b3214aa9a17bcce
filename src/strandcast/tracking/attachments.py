"""Weights and pipes on the string, found from its width along its length in many frames.

A weight is a short bump of the width, a pipe a long step. Both are looked for in the median over frames, so
that what passes before the string, or behind it, in some of them is not taken for its own. What the frames do
not agree about is not told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_closing, grey_opening, label, maximum_filter1d, median_filter

from strandcast.records.track import SeenSection, SeenWeight
from strandcast.tracking.picture import Picture
from strandcast.tracking.widths import choose_frames, places_along, widths_along

LEAST_FRAMES = 24
BLOCKS = 8  # stretches of the throw that each tell a place of their own; they part by its standard error
LEAST_SEEN = 0.4  # of the frames, in which a place must be in the open
AGREE = 0.25  # half of the frames must lie within this share of the local width, or of the string's
SLIDE_M = 0.012  # within which the largest width counts for that
SHORTEST_SECTION_M = 0.036  # a bump that is shorter is a weight, a longer one is a section
SHORTEST_SECTION_PX = 16.0
BUMP_TIMES, BUMP_PX = 0.6, 1.0  # least height of a bump, in the string's own widths and in pixels beyond them
STEP_TIMES, STEP_PX = 0.2, 0.25  # and of a section's step
SIGNIFICANT = 6.0  # standard errors
STEEP_M, STEEP_PX = 0.006, 4.0  # a section's edge rises from a quarter to three quarters within this
FLOOR_PX = 0.7  # least standard deviation: of the chain's length, of the clamp's place
# A square end, spread by blur, is where the width has changed by half, a round one where it begins to change.
END_LEVEL = 0.7  # of the change of width, at which a section is said to end
END_SHAPE = 0.2  # of its width, one standard deviation: which of both it is does not show
TIP_PX = 3.0  # a section that ends this near to the tip goes to the tip
STRAIGHT = 0.4  # of the other joints' bending, under which a section is stiff
BENDING = 0.8  # over which it is not
LEAST_BEND_RAD_M = 2.0  # rms curvature of the rest, without which nothing can be told


@dataclass(frozen=True)
class Attachments:
    """What is on the string, from the hand on; `seen_from_m` is where it comes out of the hand's shadow."""

    weights: tuple[SeenWeight, ...]
    sections: tuple[SeenSection, ...]
    width_m: float
    seen_from_m: float
    frames: int

    def moved(self, by_m: float) -> Attachments:
        """Return the same with all places `by_m` further from the clamp."""
        weights = [w.model_copy(update={"place_m": w.place_m + by_m}) for w in self.weights]
        sections = [
            s.model_copy(update={"from_m": s.from_m + by_m, "to_m": s.to_m + by_m}) for s in self.sections
        ]
        return replace(self, weights=tuple(weights), sections=tuple(sections))


NOTHING = Attachments((), (), float("nan"), float("nan"), 0)


@dataclass(frozen=True)
class Profile:
    """The median width along the string, and its standard error, (K,) [m]; NaN where it is not told."""

    places_m: np.ndarray
    width_m: np.ndarray
    error_m: np.ndarray


def see_attachments(
    picture: Callable[[int], Picture | None],
    nodes_m: np.ndarray,
    quality: np.ndarray,
    level: float,
    contrast: float,
) -> Attachments:
    """See what is on the string, in frames of a tracked throw.

    Parameters
    ----------
    picture
        Returns the part of a frame around the string; None where it was not kept.
    nodes_m
        The tracked chain (F, M + 1, 2) [m], of equal links; NaN where the string was not found.
    quality
        How well each node is seen (F, M + 1), 0 to 1.
    level, contrast
        The string's grey level, and its usual difference from the background.
    """
    found = np.flatnonzero(np.isfinite(nodes_m).all(axis=(1, 2)))
    first = next((seen for seen in map(picture, found[:1].tolist()) if seen is not None), None)
    if first is None:
        return NOTHING
    scale = first.plane.metre_per_pixel
    length_m = float(np.median(np.linalg.norm(np.diff(nodes_m[found], axis=1), axis=2).sum(axis=1)))
    places_m = places_along(length_m, scale)
    rows, read = [], []
    for frame in choose_frames(nodes_m, quality, scale):
        seen = picture(int(frame))
        if seen is not None:
            rows.append(widths_along(seen, nodes_m[frame], places_m, level, contrast))
            read.append(frame)
    if len(rows) < LEAST_FRAMES:
        return NOTHING
    return find_attachments(places_m, np.stack(rows), length_m, scale, nodes_m[read])


def find_attachments(
    places_m: np.ndarray, widths_m: np.ndarray, length_m: float, metre_per_pixel: float, nodes_m: np.ndarray
) -> Attachments:
    """Find what is on the string.

    Parameters
    ----------
    places_m
        Places (K,) along the string, evenly spaced, beyond its tip too.
    widths_m
        Its equivalent width in F frames (F, K), in the order of time; NaN where it was not in the open.
    length_m
        Of the string.
    metre_per_pixel
        Scale of the picture.
    nodes_m
        The tracked chain in the same frames, (F, M + 1, 2) [m].
    """
    profile = median_profile(places_m, widths_m)
    own_m = own_width(profile, length_m)
    if not np.isfinite(own_m):
        return NOTHING
    base = without_bumps(profile, metre_per_pixel)
    bumps = find_bumps(profile, base, own_m, length_m, metre_per_pixel)
    steps = find_steps(profile, base, own_m, length_m, metre_per_pixel)
    # A few frames agree less than all; how the blocks part is in the standard deviations.
    blocks = [median_profile(places_m, part, 3 * AGREE) for part in np.array_split(widths_m, BLOCKS)]
    weights = [_weight(profile, blocks, base, bump, metre_per_pixel) for bump in bumps]
    sections = [_section(profile, blocks, base, own_m, step, length_m, metre_per_pixel) for step in steps]
    told = [_with_stiffness(section, nodes_m, length_m) for section in sections if section is not None]
    seen = places_m[np.isfinite(profile.width_m)]
    shown = [weight for weight in weights if weight is not None]
    return Attachments(tuple(shown), tuple(told), own_m, float(seen[0]), len(widths_m))


def median_profile(places_m: np.ndarray, widths_m: np.ndarray, agree: float = AGREE) -> Profile:
    """Return the median over frames (F, K), where enough of them show the place and agree about it."""
    seen = np.isfinite(widths_m)
    count = seen.sum(axis=0)
    told = (count >= 3) & (count >= LEAST_SEEN * count.max(initial=0))
    width, error = np.full(len(places_m), np.nan), np.full(len(places_m), np.nan)
    if told.any():
        low, width[told], high = _quartiles(widths_m[:, told], count[told])
        error[told] = 0.93 * (high - low) / np.sqrt(count[told])
        # On a ball's steep flanks frames part by what the chain slides; beyond the tip there is only noise.
        near = int(SLIDE_M / (places_m[1] - places_m[0])) | 1
        usual = maximum_filter1d(np.fmax(width, np.nanmedian(width)), near, mode="nearest")
        width[told] = np.where(high - low > 2 * agree * usual[told], np.nan, width[told])
    return Profile(places_m, _longest_part(width), error)


def _quartiles(widths_m: np.ndarray, count: np.ndarray) -> list[np.ndarray]:
    """Return the quartiles (3 of K) of columns with `count` numbers; numpy's own for NaN is far slower."""
    ranked = np.sort(widths_m, axis=0)  # NaN come last
    columns = np.arange(len(count))
    found = []
    for share in (0.25, 0.5, 0.75):
        place = share * (count - 1)
        low = place.astype(int)
        high = np.minimum(low + 1, count - 1)
        found.append(ranked[low, columns] + (place - low) * (ranked[high, columns] - ranked[low, columns]))
    return found


def _longest_part(width: np.ndarray) -> np.ndarray:
    """Keep the longest stretch without larger holes: near the hand, a few places may agree by chance."""
    parts, count = label(closed(np.isfinite(width), 7))
    if count < 2:
        return width
    longest = 1 + int(np.argmax([(parts == 1 + part).sum() for part in range(count)]))
    return np.where(parts == longest, width, np.nan)


def closed(mask: np.ndarray, places: int) -> np.ndarray:
    """Return a mask (K,) with its holes of fewer than so many places closed."""
    padded = np.pad(mask, places)
    return np.asarray(binary_closing(padded, np.ones(places, dtype=bool))[places:-places])


def own_width(profile: Profile, length_m: float) -> float:
    """Return the string's own width [m]: the middle of the half of all places that lie closest together."""
    on_it = np.isfinite(profile.width_m) & (profile.places_m < length_m)
    widths = np.sort(profile.width_m[on_it])
    if len(widths) < 20:
        return float("nan")
    half = len(widths) // 2
    spans = widths[half:] - widths[: len(widths) - half]
    first = int(np.argmin(spans))
    return float(np.median(widths[first : first + half + 1]))


def without_bumps(profile: Profile, metre_per_pixel: float) -> np.ndarray:
    """Return the width (K,) without what is shorter than a section, unknown places bridged."""
    step_m = profile.places_m[1] - profile.places_m[0]
    longest = max(SHORTEST_SECTION_M, SHORTEST_SECTION_PX * metre_per_pixel)
    smooth = median_filter(_bridged(profile), 5, mode="nearest")
    return np.asarray(grey_opening(smooth, (int(longest / step_m) | 1,), mode="nearest"))


def _bridged(profile: Profile) -> np.ndarray:
    known = np.isfinite(profile.width_m)
    return np.interp(profile.places_m, profile.places_m[known], profile.width_m[known])


def find_bumps(
    profile: Profile, base: np.ndarray, own_m: float, length_m: float, metre_per_pixel: float
) -> list[tuple[int, int]]:
    """Return first and last place of each bump at half its height, those left out that could be chance."""
    over = np.nan_to_num(profile.width_m - base, nan=0.0)
    height_m = np.maximum(BUMP_TIMES * own_m + BUMP_PX * metre_per_pixel, SIGNIFICANT * _error(profile))
    found = []
    for first, last in _runs(over > height_m):
        peak = first + int(np.argmax(over[first : last + 1]))
        if profile.places_m[peak] < length_m + 2 * metre_per_pixel:
            found.append(_half_height(over, peak))
    return found


def find_steps(
    profile: Profile, base: np.ndarray, own_m: float, length_m: float, metre_per_pixel: float
) -> list[tuple[int, int]]:
    """Return first and last place of each stretch whose width is not the string's own."""
    least_m = np.maximum(STEP_TIMES * own_m + STEP_PX * metre_per_pixel, SIGNIFICANT * _error(profile))
    inside = np.isfinite(profile.width_m) & (profile.places_m < length_m - 2 * metre_per_pixel)
    other = closed((np.abs(base - own_m) > least_m) & inside, 9)
    shortest = max(SHORTEST_SECTION_M, SHORTEST_SECTION_PX * metre_per_pixel)
    return [
        (first, last)
        for first, last in _runs(other)
        if profile.places_m[last] - profile.places_m[first] >= 0.8 * shortest
    ]


def _error(profile: Profile) -> np.ndarray:
    return np.nan_to_num(profile.error_m, nan=np.inf)


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    parts, count = label(mask)
    return [(int(np.argmax(parts == k)), int(np.flatnonzero(parts == k)[-1])) for k in range(1, count + 1)]


def _half_height(over: np.ndarray, peak: int) -> tuple[int, int]:
    above = over > 0.5 * over[peak]
    first, last = peak, peak
    while first > 0 and above[first - 1]:
        first -= 1
    while last < len(over) - 1 and above[last + 1]:
        last += 1
    return first, last


def _weight(
    profile: Profile, blocks: list[Profile], base: np.ndarray, bump: tuple[int, int], metre_per_pixel: float
) -> SeenWeight | None:
    """Return the weight at a bump; None where the parts of the throw do not show it alike."""
    middle = (bump[0] + bump[1]) // 2
    # The chord of a ball that is a share c of its middle's lies at sqrt(1 - c²) of its radius.
    share = 0.5 * (1.0 + base[middle] / max(profile.width_m[middle], base[middle], 1e-9))
    length_m = profile.places_m[bump[1]] - profile.places_m[bump[0]]
    half_width_m = 0.5 * length_m / np.sqrt(max(1.0 - share**2, 0.1))
    places = np.array([_centre(block, base, bump) for block in blocks])
    place = _centre(profile, base, bump)
    if np.isfinite(places).sum() < BLOCKS // 2 or not np.isfinite(place):
        return None
    return SeenWeight(
        place_m=place, sigma_m=_sigma(places, metre_per_pixel), half_width_m=float(half_width_m)
    )


def _centre(profile: Profile, base: np.ndarray, bump: tuple[int, int]) -> float:
    """Return the centroid [m] of a bump in a profile, over the places where it is higher than half."""
    spare = (bump[1] - bump[0]) // 2 + 2
    part = slice(max(0, bump[0] - spare), bump[1] + spare + 1)
    over = profile.width_m[part] - base[part]
    if not np.isfinite(over).all():
        return float("nan")
    # From a quarter of the height on: there both flanks are steep, and noise at the foot does not count.
    weight = np.maximum(over - 0.25 * over.max(), 0.0)
    return float((weight * profile.places_m[part]).sum() / weight.sum()) if weight.sum() > 0 else float("nan")


def _section(
    profile: Profile, blocks: list[Profile], base: np.ndarray, own_m: float, step: tuple[int, int],
    length_m: float, metre_per_pixel: float,
) -> SeenSection | None:  # fmt: skip
    """Return the section at a step; None where neither of its ends is a clear edge."""
    width_m = float(np.median(base[step[0] : step[1] + 1]))
    level = own_m + END_LEVEL * (width_m - own_m)
    ends, sigmas, clear = [], [], []
    for place, outwards in ((step[0], -1), (step[1], 1)):
        edge, steep = _edge(profile, place, outwards, width_m, own_m, metre_per_pixel)
        at_end = outwards > 0 and profile.places_m[place] > length_m - TIP_PX * metre_per_pixel
        ends.append(length_m if at_end else edge)
        seen = np.array([_crossing(block, edge, level, width_m > own_m, outwards) for block in blocks])
        sigmas.append(float(np.hypot(_sigma(seen, metre_per_pixel), END_SHAPE * width_m)))
        clear.append(at_end or (steep and np.isfinite(seen).sum() >= BLOCKS // 2))
    if not all(clear):
        return None
    return SeenSection(
        from_m=ends[0], from_sigma_m=sigmas[0], to_m=ends[1], to_sigma_m=sigmas[1], width_m=width_m
    )


def _edge(
    profile: Profile, place: int, outwards: int, width_m: float, own_m: float, metre_per_pixel: float
) -> tuple[float, bool]:
    """Return where [m], near a place, a section ends, and whether the width changes steeply there."""
    near_m, up = profile.places_m[place], width_m > own_m
    marks = [
        _crossing(profile, near_m, own_m + share * (width_m - own_m), up, outwards)
        for share in (0.25, END_LEVEL, 0.75)
    ]
    steep_m = max(STEEP_M, STEEP_PX * metre_per_pixel)
    return marks[1], bool(abs(marks[2] - marks[0]) < steep_m)


def _crossing(profile: Profile, near_m: float, level_m: float, up: bool, outwards: int) -> float:
    """Return where [m], nearest to a place, the width crosses a level on the way out of a section."""
    inside = profile.width_m > level_m if up else profile.width_m < level_m
    width, places = profile.width_m, profile.places_m
    after = np.flatnonzero(inside[:-1] & ~inside[1:] if outwards > 0 else ~inside[:-1] & inside[1:])
    after = after[np.isfinite(width[after] + width[after + 1])]
    if not len(after):
        return float("nan")
    share = (level_m - width[after]) / (width[after + 1] - width[after])
    crossings = places[after] + share * (places[after + 1] - places[after])
    nearest = crossings[np.argmin(np.abs(crossings - near_m))]
    return float(nearest) if abs(nearest - near_m) < 0.5 * SHORTEST_SECTION_M else float("nan")


def _sigma(places: np.ndarray, metre_per_pixel: float) -> float:
    """Return the standard error [m] of the mean of what the parts of a throw tell, with a floor."""
    seen = places[np.isfinite(places)]
    error = float(np.std(seen, ddof=1) / np.sqrt(len(seen))) if len(seen) > 1 else 0.0
    return float(np.hypot(error, FLOOR_PX * metre_per_pixel))


def _with_stiffness(section: SeenSection, nodes_m: np.ndarray, length_m: float) -> SeenSection:
    """Tell by the bends of the tracked chain (F, M + 1, 2) whether a section stays straight."""
    way = np.diff(nodes_m, axis=1)
    headings = np.arctan2(way[..., 1], way[..., 0])
    links = headings.shape[1]
    joints_m = np.arange(1, links) * length_m / links
    bends = np.angle(np.exp(1j * np.diff(headings, axis=1))) * links / length_m
    curvature = np.sqrt(np.nanmean(bends**2, axis=0))
    margin = 0.15 * (section.to_m - section.from_m)
    inside = (joints_m > section.from_m + margin) & (joints_m < section.to_m - margin)
    outside = (joints_m < section.from_m - margin) | (joints_m > section.to_m + margin)
    outside &= joints_m > 0.1 * length_m
    if inside.sum() < 2 or outside.sum() < 4:
        return section
    rest = float(np.median(curvature[outside]))
    ratio = float(np.median(curvature[inside])) / max(rest, 1e-9)
    if rest < LEAST_BEND_RAD_M or STRAIGHT <= ratio <= BENDING:
        return section
    return section.model_copy(update={"stiff": ratio < STRAIGHT})
