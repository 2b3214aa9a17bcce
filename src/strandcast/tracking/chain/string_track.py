"""The string through a video: a first pass, the values learned from all its frames, and a refined pass."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from strandcast.config.track import TrackSettings
from strandcast.errors import StrandcastError
from strandcast.tracking.attachments.detect import Attachments, detect_attachments
from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.bead_search import Beads
from strandcast.tracking.chain.bidirectional import (
    clamp_paths,
    survey,
    take_corrections,
    track_bidirectional,
)
from strandcast.tracking.chain.clamp_fit import ClampFit, fit_clamp
from strandcast.tracking.chain.detection import learn_appearance, length_between, visible_length
from strandcast.tracking.chain.fit import ChainModel, FrameFit
from strandcast.tracking.chain.frames import GivenPlaces, StringFrames
from strandcast.tracking.chain.links import place_on
from strandcast.tracking.chain.measure import level_at
from strandcast.tracking.chain.point_uncertainty import frame_points
from strandcast.tracking.chain.refine import refine
from strandcast.tracking.chain.tip import BEAD_TIMES
from strandcast.tracking.chain.tracker import ChainTracker, links_of
from strandcast.tracking.tracker import StringHint

POLARITIES = {"bright": 1.0, "dark": -1.0, "auto": None}
TIP_BEAD_M = 0.01  # chosen: a weight this close to the tip is the tip's own bead
LEVEL_FRAMES = 15  # chosen; not sensitive: frames whose median gives a bead's grey level


@dataclass(frozen=True, eq=False)
class FirstPass:
    """The string as the first pass finds it."""

    appearance: Appearance
    length_m: float  # from the clamp to the tip; a rough value from single frames
    links: int
    anchor: int  # the frame from which the string was tracked both ways
    fits: list[FrameFit | None]  # per frame; None where the string was not found
    redetections: int  # successful searches where a fit was poor


@dataclass(frozen=True, eq=False)
class StringTrack:
    """The string in a video: the first pass, the values learned from all frames, and the mass points."""

    first: FirstPass
    clamp_fit: ClampFit
    attachments: Attachments
    points: tuple[np.ndarray, np.ndarray, np.ndarray]  # of each frame, see `mass_points`


def track_string(
    frames: StringFrames, hint: StringHint, settings: TrackSettings, exposure_s: float, video: Path
) -> StringTrack:
    """Track the string through a video; SC-T004, naming the file, if none leaves the hand in any frame."""
    first = first_pass(frames, hint, settings, exposure_s, video)
    clamp_fit = fit_clamp(first.length_m, *clamp_paths(frames, first.fits))
    attachments = attachments_of(frames, first).moved(clamp_fit.length_m - first.length_m)
    beads = all_beads(frames, first, attachments, clamp_fit)
    string = ChainModel(clamp_fit.length_m / first.links, first.appearance, beads)
    aligned = replace(frames, lateral_offset_m=clamp_fit.lateral_offset_m)
    fits, corrected = list(first.fits), () if frames.given is None else frames.given.corrected
    given = aligned.with_given(len(beads.place_m), corrected=True)
    take_corrections(given, fits, corrected, ChainTracker(first.links, string, exposure_s))
    fits = refine(aligned, fits, first.anchor, string, exposure_s, corrected)
    points = mass_points(aligned, fits, hint.points, clamp_fit.length_sigma_m)
    return StringTrack(first, clamp_fit, attachments, points)


def mass_points(
    frames: StringFrames, fits: list[FrameFit | None], count: int, length_sigma_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (F, n, 2), sigma and flags (F, n) of the n mass points; NaN where not found."""
    points_m, sigma_m = np.full((len(fits), count, 2), np.nan), np.full((len(fits), count), np.nan)
    flags = np.zeros((len(fits), count), dtype=np.int32)
    for index, fit in enumerate(fits):
        window = frames.window(index)
        if fit is not None and window is not None:
            found = frame_points(fit, count, window, frames.clamp_m(index), length_sigma_m)
            points_m[index], sigma_m[index], flags[index] = found
    return points_m, sigma_m, flags


def first_pass(
    frames: StringFrames, hint: StringHint, settings: TrackSettings, exposure_s: float, video: Path
) -> FirstPass:
    """Learn the string's appearance from single frames, then track it both ways from the clearest one."""
    with_hand = np.flatnonzero(frames.hand.flags == 0)
    detections = survey(frames, with_hand, hint, POLARITIES[settings.polarity])
    if not detections:
        raise StrandcastError("SC-T004", "no string leaves the hand in any frame", file=video)
    appearance = learn_appearance(detections, frames.crops.plane.metre_per_pixel, hint.beyond_m)
    if settings.contrast_grey is not None:
        appearance = appearance._replace(contrast=settings.contrast_grey)
    links = links_of(hint)
    far_m = None if frames.given is None else frames.given.far_m()
    if far_m is None:
        length_m = visible_length(detections, appearance, hint.length_m)
    else:
        appearance = appearance._replace(bead_level=np.nan, tip_excess_m=0.0)  # what holds it is no bead
        length_m = length_between(detections, far_m)
    rows = [*given_rows(frames.given, length_m), *tip_bead(appearance, length_m)]
    string = ChainModel(length_m / links, appearance, beads_of(rows))
    tracker = ChainTracker(links, string, exposure_s)
    anchor, fits = track_bidirectional(frames.with_given(len(rows), corrected=False), detections, tracker)
    return FirstPass(appearance, length_m, links, anchor, fits, tracker.redetections)


def attachments_of(frames: StringFrames, first: FirstPass) -> Attachments:
    """Return the weights and sections on the string, with places along the chain of the first pass."""
    nodes = np.full((len(first.fits), first.links + 1, 2), np.nan)
    quality = np.zeros((len(first.fits), first.links + 1))
    for index, fit in enumerate(first.fits):
        if fit is not None:
            nodes[index], quality[index] = fit.nodes(), fit.reward
    return detect_attachments(
        frames.window, nodes, quality, first.appearance.level, first.appearance.contrast
    )


def given_rows(given: GivenPlaces | None, length_m: float) -> list[tuple[float, float, float, float]]:
    """Return the given places as rows of `beads_of`."""
    return [] if given is None else [(share * length_m, 0.0, 0.0, 0.0) for share in given.share.tolist()]


def tip_bead(appearance: Appearance, length_m: float) -> list[tuple[float, float, float, float]]:
    """Return place, radius and grey levels of the bead at the string's end, if there is one."""
    if not appearance.has_bead:
        return []
    levels = appearance.bead_level, appearance.bead_highest
    return [(length_m - appearance.beyond_m, appearance.bead_m, *levels)]


def beads_of(rows: list[tuple[float, float, float, float]]) -> Beads:
    """Return beads from their places, radii and grey levels."""
    return Beads(*np.array(rows).reshape(-1, 4).T.copy())


def all_beads(frames: StringFrames, first: FirstPass, attachments: Attachments, clamp_fit: ClampFit) -> Beads:
    """Return the beads on the string: detected weights, then the tip's."""
    length_m = clamp_fit.length_m
    at_tip_m = TIP_BEAD_M + first.appearance.beyond_m
    least_m = BEAD_TIMES * first.appearance.half_m  # a smaller weight cannot be tracked as a bead
    weights = [w for w in attachments.weights if w.half_width_m > least_m and w.place_m < length_m - at_tip_m]
    shift_m = length_m - first.length_m
    levels = [bead_level(frames, first.fits, w.place_m - shift_m) for w in weights]
    known = [
        (w.place_m, w.half_width_m, level, level)
        for w, level in zip(weights, levels, strict=True)
        if np.isfinite(level)
    ]
    return beads_of([*given_rows(frames.given, length_m), *known, *tip_bead(first.appearance, length_m)])


def bead_level(frames: StringFrames, fits: list[FrameFit | None], place_m: float) -> float:
    """Return the grey level at a place along the chain: the median over frames spread over the video."""
    levels = []
    for index in np.linspace(0, len(fits) - 1, LEVEL_FRAMES).astype(int).tolist():
        fit, window = fits[index], frames.window(index)
        if fit is not None and window is not None:
            levels.append(level_at(window, place_on(fit.nodes(), fit.heading, place_m)))
    return float(np.median(levels)) if levels else float("nan")
