"""Weights and stiff sections on the string, detected from its width along its length in many frames.

A weight is a short bump of the width, a section a long step. Both are detected in the median over frames, so
that an object that passes in front of or behind the string in some of them has no effect. Places about which
the frames disagree are unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from strandcast.records.track import DetectedSection, DetectedWeight
from strandcast.tracking.attachments.width_profile import (
    AGREE,
    SHORTEST_SECTION_M,
    Profile,
    closed,
    median_profile,
    own_width,
    shortest_section_m,
    without_bumps,
)
from strandcast.tracking.attachments.widths import choose_frames, places_along, widths_along
from strandcast.tracking.chain.search_window import SearchWindow

LEAST_FRAMES = 24
BLOCKS = 8  # parts of the throw, each with its own estimate; their scatter gives the standard error
BUMP_TIMES, BUMP_PX = 0.6, 1.0  # least height of a bump, in the string's own widths plus pixels
STEP_TIMES, STEP_PX = 0.2, 0.25  # and of a section's step
SIGNIFICANT = 6.0  # standard errors
STEEP_M, STEEP_PX = 0.006, 4.0  # a section's edge rises from a quarter to three quarters within this
FLOOR_PX = 0.7  # least standard deviation, for the chain's length and the clamp's place
# A square end, blurred, is where the width has changed by half; a round one where it begins to change.
END_LEVEL = 0.7  # share of the change of width at which a section ends
END_SHAPE = 0.2  # of its width, one standard deviation: square and round ends look alike
TIP_PX = 3.0  # a section that ends this close to the tip reaches the tip
STRAIGHT = 0.4  # of the other joints' bending; below it a section is stiff
BENDING = 0.8  # above it, it is not
LEAST_BEND_RAD_M = 2.0  # least rms curvature of the rest of the string, to decide


@dataclass(frozen=True)
class Attachments:
    """Weights and sections from the hand to the tip, the string's own width, and the frames used."""

    weights: tuple[DetectedWeight, ...]
    sections: tuple[DetectedSection, ...]
    width_m: float
    visible_from_m: float  # nearer to the clamp the hand hides the string
    frames: int

    def moved(self, by_m: float) -> Attachments:
        """Return the same with all places `by_m` farther from the clamp."""
        weights = [w.model_copy(update={"place_m": w.place_m + by_m}) for w in self.weights]
        sections = [
            s.model_copy(update={"from_m": s.from_m + by_m, "to_m": s.to_m + by_m}) for s in self.sections
        ]
        return replace(self, weights=tuple(weights), sections=tuple(sections))


NOTHING = Attachments((), (), float("nan"), float("nan"), 0)


@dataclass(frozen=True, eq=False)
class WidthScan:
    """The string's width along its length, over all frames and in each block of the throw."""

    profile: Profile
    blocks: list[Profile]
    base_m: np.ndarray  # width without bumps, (K,)
    own_m: float  # the bare string's width
    length_m: float
    pixel_m: float

    def least_change_m(self, times: float, pixels: float) -> np.ndarray:
        """Return the change of width (K,) [m] that is larger than chance and than the given minimum."""
        error_m = np.nan_to_num(self.profile.error_m, nan=np.inf)
        return np.asarray(np.maximum(times * self.own_m + pixels * self.pixel_m, SIGNIFICANT * error_m))

    def sigma_m(self, places: np.ndarray) -> float:
        """Return the standard error [m] of the mean of the blocks' places, with a floor."""
        known = places[np.isfinite(places)]
        error = float(np.std(known, ddof=1) / np.sqrt(len(known))) if len(known) > 1 else 0.0
        return float(np.hypot(error, FLOOR_PX * self.pixel_m))


def detect_attachments(
    window_of: Callable[[int], SearchWindow | None],
    nodes_m: np.ndarray,
    quality: np.ndarray,
    level: float,
    contrast: float,
) -> Attachments:
    """Detect weights and sections in the frames of a tracked throw.

    Parameters
    ----------
    window_of
        Returns a frame's search window, or None.
    nodes_m
        The tracked chain (F, M + 1, 2) [m], of equal links; NaN where the string was not found.
    quality
        How clearly each node is visible (F, M + 1), 0 to 1.
    level, contrast
        The string's grey level, and its usual difference from the background.
    """
    tracked = np.flatnonzero(np.isfinite(nodes_m).all(axis=(1, 2)))
    first = window_of(int(tracked[0])) if len(tracked) else None
    if first is None:
        return NOTHING
    scale = first.plane.metre_per_pixel
    length_m = float(np.median(np.linalg.norm(np.diff(nodes_m[tracked], axis=1), axis=2).sum(axis=1)))
    places_m = places_along(length_m, scale)
    rows, read = [], []
    for frame in choose_frames(nodes_m, quality, scale):
        window = window_of(int(frame))
        if window is not None:
            rows.append(widths_along(window, nodes_m[frame], places_m, level, contrast))
            read.append(frame)
    if len(rows) < LEAST_FRAMES:
        return NOTHING
    return attachments_from_widths(places_m, np.stack(rows), length_m, scale, nodes_m[read])


def attachments_from_widths(
    places_m: np.ndarray, widths_m: np.ndarray, length_m: float, metre_per_pixel: float, nodes_m: np.ndarray
) -> Attachments:
    """Detect weights and sections from the string's width in F frames, in the order of time.

    `places_m` (K,) are evenly spaced along the string and beyond its tip, `widths_m` (F, K) the equivalent
    widths there, NaN where hidden; `nodes_m` (F, M + 1, 2) is the tracked chain.
    """
    profile = median_profile(places_m, widths_m)
    own_m = own_width(profile, length_m)
    if not np.isfinite(own_m):
        return NOTHING
    # A few frames agree less than all of them; the scatter of the blocks is in the standard deviations.
    blocks = [median_profile(places_m, part, 3 * AGREE) for part in np.array_split(widths_m, BLOCKS)]
    base_m = without_bumps(profile, metre_per_pixel)
    scan = WidthScan(profile, blocks, base_m, own_m, length_m, metre_per_pixel)
    weights = [weight for bump in find_bumps(scan) if (weight := _weight(scan, bump)) is not None]
    sections = [
        _with_stiffness(section, nodes_m, length_m)
        for step in find_steps(scan)
        if (section := _section(scan, step)) is not None
    ]
    visible = places_m[np.isfinite(profile.width_m)]
    return Attachments(tuple(weights), tuple(sections), own_m, float(visible[0]), len(widths_m))


def find_bumps(scan: WidthScan) -> list[tuple[int, int]]:
    """Return first and last place of each significant bump, at half its height."""
    over = np.nan_to_num(scan.profile.width_m - scan.base_m, nan=0.0)
    found = []
    for first, last in _runs(over > scan.least_change_m(BUMP_TIMES, BUMP_PX)):
        peak = first + int(np.argmax(over[first : last + 1]))
        if scan.profile.places_m[peak] < scan.length_m + 2 * scan.pixel_m:
            runs = _runs(over > 0.5 * over[peak])
            found += [(start, end) for start, end in runs if start <= peak <= end]
    return found


def find_steps(scan: WidthScan) -> list[tuple[int, int]]:
    """Return first and last place of each long stretch with a width other than the string's own."""
    places_m = scan.profile.places_m
    inside = np.isfinite(scan.profile.width_m) & (places_m < scan.length_m - 2 * scan.pixel_m)
    other = closed((np.abs(scan.base_m - scan.own_m) > scan.least_change_m(STEP_TIMES, STEP_PX)) & inside, 9)
    least_m = 0.8 * shortest_section_m(scan.pixel_m)
    return [(first, last) for first, last in _runs(other) if places_m[last] - places_m[first] >= least_m]


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    return [
        (part.start, part.stop - 1) for (part,) in scipy.ndimage.find_objects(scipy.ndimage.label(mask)[0])
    ]


def _weight(scan: WidthScan, bump: tuple[int, int]) -> DetectedWeight | None:
    """Return the weight at a bump; None where too few blocks of the throw show it."""
    profile, base_m = scan.profile, scan.base_m
    middle = (bump[0] + bump[1]) // 2
    # A ball's chord of a share c of its diameter lies sqrt(1 - c²) of its radius off the middle.
    share = 0.5 * (1.0 + base_m[middle] / max(profile.width_m[middle], base_m[middle], 1e-9))
    length_m = profile.places_m[bump[1]] - profile.places_m[bump[0]]
    half_width_m = float(0.5 * length_m / np.sqrt(max(1.0 - share**2, 0.1)))
    places = np.array([_centre(block, base_m, bump) for block in scan.blocks])
    place_m = _centre(profile, base_m, bump)
    if np.isfinite(places).sum() < BLOCKS // 2 or not np.isfinite(place_m):
        return None
    return DetectedWeight(place_m=place_m, sigma_m=scan.sigma_m(places), half_width_m=half_width_m)


def _centre(profile: Profile, base_m: np.ndarray, bump: tuple[int, int]) -> float:
    """Return the centroid [m] of a bump in a profile; NaN where it is not fully known."""
    spare = (bump[1] - bump[0]) // 2 + 2
    part = slice(max(0, bump[0] - spare), bump[1] + spare + 1)
    over = profile.width_m[part] - base_m[part]
    if not np.isfinite(over).all():
        return float("nan")
    # From a quarter of the height on: there both flanks are steep, and noise at the foot does not count.
    weight = np.maximum(over - 0.25 * over.max(), 0.0)
    return float((weight * profile.places_m[part]).sum() / weight.sum()) if weight.sum() > 0 else float("nan")


def _section(scan: WidthScan, step: tuple[int, int]) -> DetectedSection | None:
    """Return the section at a step; None where one of its ends is not a clear edge."""
    width_m = float(np.median(scan.base_m[step[0] : step[1] + 1]))
    ends, sigmas = [], []
    for place, outwards in ((step[0], -1), (step[1], 1)):
        near_m = scan.profile.places_m[place]
        quarter, edge, three_quarters = (
            _crossing(scan, scan.profile, near_m, width_m, share, outwards)
            for share in (0.25, END_LEVEL, 0.75)
        )
        steep = abs(three_quarters - quarter) < max(STEEP_M, STEEP_PX * scan.pixel_m)
        at_tip = outwards > 0 and near_m > scan.length_m - TIP_PX * scan.pixel_m
        places = np.array(
            [_crossing(scan, block, edge, width_m, END_LEVEL, outwards) for block in scan.blocks]
        )
        if not (at_tip or (steep and np.isfinite(places).sum() >= BLOCKS // 2)):
            return None
        ends.append(scan.length_m if at_tip else edge)
        sigmas.append(float(np.hypot(scan.sigma_m(places), END_SHAPE * width_m)))
    return DetectedSection(
        from_m=ends[0], from_sigma_m=sigmas[0], to_m=ends[1], to_sigma_m=sigmas[1], width_m=width_m
    )


def _crossing(
    scan: WidthScan, profile: Profile, near_m: float, width_m: float, share: float, outwards: int
) -> float:
    """Return where [m], nearest to `near_m`, a section's width has changed by a share on the way out."""
    level_m, width, places = scan.own_m + share * (width_m - scan.own_m), profile.width_m, profile.places_m
    inside = width > level_m if width_m > scan.own_m else width < level_m
    after = np.flatnonzero(inside[:-1] & ~inside[1:] if outwards > 0 else ~inside[:-1] & inside[1:])
    after = after[np.isfinite(width[after] + width[after + 1])]
    if not len(after):
        return float("nan")
    part = (level_m - width[after]) / (width[after + 1] - width[after])
    crossings = places[after] + part * (places[after + 1] - places[after])
    nearest = crossings[np.argmin(np.abs(crossings - near_m))]
    return float(nearest) if abs(nearest - near_m) < 0.5 * SHORTEST_SECTION_M else float("nan")


def _with_stiffness(section: DetectedSection, nodes_m: np.ndarray, length_m: float) -> DetectedSection:
    """Return the section with `stiff`, decided by the bends of the tracked chain (F, M + 1, 2)."""
    steps = np.diff(nodes_m, axis=1)
    headings = np.arctan2(steps[..., 1], steps[..., 0])
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
