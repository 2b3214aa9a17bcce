"""The string through a video: both ways from the frame that shows it best, and again where that is weak."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from strandcast.progress import Progress
from strandcast.tracking.balls import follow_balls
from strandcast.tracking.fit import NARROW_PX, Fit, fit_frame
from strandcast.tracking.follower import (
    BETTER,
    GOOD,
    LINK_M,
    WORSE,
    Follower,
    Moment,
    Sight,
    blurred_half_px,
)
from strandcast.tracking.looks import Sighting, sight
from strandcast.tracking.picture import Looks
from strandcast.tracking.result import StringHint

SURVEYED = (
    6,
    24,
)  # frames that are searched for the string on their own; the more where the fewer show it ill
SHOWN = 4  # good ones among the fewer that show the string's end are enough
CLEAR_WAY = 0.5  # reward of the first node of a string that is seen
ANCHORS = 4  # of the best of them are tried as the start

Look = Callable[[int], Sight | None]


def chain_of(string: StringHint) -> tuple[int, int]:
    """Return the links of the tracker's chain, and how many of them there are per mass point."""
    every = max(1, round(string.length_m / string.points / LINK_M))
    return every * string.points, every


def survey(look: Look, frames: np.ndarray, string: StringHint, polarity: float | None) -> list[Sighting]:
    """Return the sightings of the string in frames spread over those given (F,)."""
    links, _ = chain_of(string)
    found: dict[int, Sighting | None] = {}
    for count in SURVEYED:
        spread = np.unique(np.linspace(0, len(frames) - 1, count).astype(int))
        for index in frames[spread].tolist():
            at = look(index) if index not in found else None
            if at is not None:
                found[index] = sight(index, at, links, string.length_m / links, string.thickness_m, polarity)
        sightings = [found[index] for index in sorted(found)]
        kept = [one for one in sightings if one is not None]
        good = [one for one in kept if one.fit.value >= GOOD]
        if len(good) >= SHOWN and sum(np.isfinite(one.end_m) for one in good) >= SHOWN:
            break
    return kept


def follow(look: Look, count: int, sightings: list[Sighting], follower: Follower) -> list[Fit | None]:
    """Follow the string through `count` frames; returns the fit per frame, None where it is not found.

    Parameters
    ----------
    look
        Returns a frame; None where there is no hand to start from.
    count
        Of the video's frames.
    sightings
        Where the string was found on its own, at least one.
    follower
        Knows the string's looks and length.
    """
    tell = Progress("track: string", total=count)
    anchor, fit = best_anchor(look, sightings, follower)
    fits: list[Fit | None] = [None] * count
    fits[anchor] = fit
    done = itertools.count(2)

    def go(frames: range) -> int:
        mover = follower.twin()
        mover.restart(moments_at(look, fits, [anchor]))
        for index in frames:
            at = look(index)
            fits[index] = mover.step(at) if at is not None else None
            tell(next(done))
        return mover.found_anew

    # The kernels let go of Python's lock: the two ways run at the same time, and do not meet.
    with ThreadPoolExecutor(2) as pool:
        follower.found_anew += sum(pool.map(go, (range(anchor + 1, count), range(anchor - 1, -1, -1))))
    look_again(look, fits, anchor, follower)
    return fits


def best_anchor(look: Look, sightings: list[Sighting], follower: Follower) -> tuple[int, Fit]:
    """Return the frame that shows the string best, and the string there."""
    ranked = sorted(sightings, key=lambda s: s.fit.value * s.fit.open_share, reverse=True)[:ANCHORS]
    tried = []
    for sighting in ranked:
        at = look(sighting.frame)
        assert at is not None
        tried.append((sighting.frame, follower.fit(at, sighting.fit.heading)))
    return max(tried, key=lambda one: one[1].value * one[1].open_share)


def look_again(look: Look, fits: list[Fit | None], anchor: int, follower: Follower) -> None:
    """Follow the string the other way through weak stretches, in place, and keep what is better."""
    values = np.array([np.nan if fit is None else fit.value for fit in fits])
    bar = max(GOOD, float(np.nanmedian(values)) - WORSE)
    weak = np.array([fit is None or fit.value < bar or fit.end_is_off for fit in fits])
    for first, last in runs(weak):
        after = first > anchor
        known = last + 1 if after else first - 1
        beyond = known + 1 if after else known - 1
        if not (0 <= known < len(fits)):
            continue
        follower.restart(moments_at(look, fits, [beyond, known]))
        for index in range(last, first - 1, -1) if after else range(first, last + 1):
            at = look(index)
            fit = follower.step(at) if at is not None else None
            old = fits[index]
            if fit is not None and (old is None or fit.value > old.value + BETTER):
                fits[index] = fit


def moments_at(look: Look, fits: list[Fit | None], frames: list[int]) -> list[Moment]:
    """Return the string as it was found in frames, those left out in which it was not."""
    moments = []
    for index in frames:
        fit = fits[index] if 0 <= index < len(fits) else None
        at = None if fit is None else look(index)
        if fit is not None and at is not None:
            moments.append(Moment(at.time_s, fit.root, fit.heading))
    return moments


def ways_of(look: Look, fits: list[Fit | None]) -> tuple[np.ndarray, np.ndarray]:
    """Return ways and directions (K,) as `learn_grasp` takes them, of frames that show the string's end."""
    ways = []
    for index, fit in enumerate(fits):
        at = look(index)
        if fit is None or at is None or fit.end_is_off or fit.value < GOOD:
            continue
        clear = np.flatnonzero(fit.reward[:-1] >= CLEAR_WAY)
        if len(clear) and np.isfinite(fit.tip_slide_m):
            first = clear[0]
            hidden_m = float(np.hypot(*(fit.nodes()[first] - at.clamp_m)))
            along_m = fit.link_m * (len(fit.heading) - first) + fit.tip_slide_m
            ways.append((hidden_m + along_m, fit.heading[first] - at.hand[2]))
    both = np.array(ways).reshape(-1, 2)
    return both[:, 0], both[:, 1]


def refine(
    look: Look, fits: list[Fit | None], link_m: float, looks: Looks, balls: np.ndarray, exposure_s: float
) -> list[Fit | None]:
    """Fit every frame again from its fit, with what all have taught of the string's length and grasp."""
    centres = follow_balls(look, fits, balls)

    def once_more(index: int) -> Fit | None:
        fit, at = fits[index], look(index)
        if fit is None or at is None:
            return fit
        beside = fits[index - 1] if index and fits[index - 1] is not None else None
        before = look(index - 1) if beside is not None else None
        half_px = np.full(len(fit.heading) + 1, looks.half_m / at.picture.plane.metre_per_pixel)
        if beside is not None and before is not None:
            share = min(1.0, exposure_s / max(at.time_s - before.time_s, 1e-9))
            half_px = blurred_half_px(
                looks, link_m, at.clamp_m, at.picture.plane.metre_per_pixel, before.clamp_m, beside.heading,
                fit.heading, share,
            )  # fmt: skip
        again = fit_frame(
            at.picture,
            at.clamp_m,
            fit.heading,
            fit.heading,
            link_m,
            half_px,
            looks,
            balls,
            centres[index],
            NARROW_PX,
            True,
        )
        return again if again.value > fit.value - WORSE else fit

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(once_more, range(len(fits))))


def runs(mask: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield first and last index of each run of true values (F,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    for first, end in edges.reshape(-1, 2).tolist():
        yield first, end - 1
