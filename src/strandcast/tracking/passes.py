"""The string through a video: both ways from the frame that shows it best, and again where that is weak."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from strandcast.progress import Progress
from strandcast.tracking.follow import GOOD, LINK_M, Fit
from strandcast.tracking.follower import WORSE, Follower, Moment, Sight
from strandcast.tracking.looks import Sighting, sight
from strandcast.tracking.result import StringHint

SURVEYED = 24  # frames that are searched for the string on their own
ANCHORS = 4  # of the best of them are tried as the start
BETTER = 0.02  # a second look's fit must be, to be taken

Look = Callable[[int], Sight | None]


def chain_of(string: StringHint) -> tuple[int, int]:
    """Return the links of the tracker's chain, and how many of them there are per mass point."""
    every = max(1, round(string.length_m / string.points / LINK_M))
    return every * string.points, every


def survey(look: Look, frames: np.ndarray, string: StringHint, polarity: float | None) -> list[Sighting]:
    """Return the sightings of the string in frames spread over those given (F,)."""
    links, _ = chain_of(string)
    spread = np.unique(np.linspace(0, len(frames) - 1, SURVEYED).astype(int))
    tell = Progress("track: looks", total=len(spread))
    found = []
    for count, index in enumerate(frames[spread].tolist()):
        at = look(index)
        if at is not None:
            found.append(
                sight(
                    index, at.picture, at.hand, links, string.length_m / links, string.thickness_m, polarity
                )
            )
        tell(count + 1)
    return [sighting for sighting in found if sighting is not None]


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
    done = 1
    for frames in (range(anchor + 1, count), range(anchor - 1, -1, -1)):
        follower.restart(moments_at(look, fits, [anchor]))
        for index in frames:
            at = look(index)
            fits[index] = follower.step(at) if at is not None else None
            done += 1
            tell(done)
    look_again(look, fits, anchor, follower)
    return fits


def best_anchor(look: Look, sightings: list[Sighting], follower: Follower) -> tuple[int, Fit]:
    """Return the frame that shows the string best, and the string there."""
    ranked = sorted(sightings, key=lambda s: s.fit.value * s.fit.open_share, reverse=True)[:ANCHORS]
    tried = []
    for sighting in ranked:
        at = look(sighting.frame)
        assert at is not None
        fit = follower.fit(at, sighting.fit.heading, sighting.fit.heading, 0.0)
        tried.append((sighting.frame, fit))
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
            moments.append(Moment(at.time_s, at.hand, fit.heading))
    return moments


def runs(mask: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield first and last index of each run of true values (F,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    for first, end in edges.reshape(-1, 2).tolist():
        yield first, end - 1
