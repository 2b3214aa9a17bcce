"""The refined pass: fit every frame again with what all frames show, then track weak stretches again.

Beads that the chain misses are tracked from frame to frame.
"""

from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from strandcast.tracking.chain.bead_search import BEAD_REACH_PX, Beads, bead_centre
from strandcast.tracking.chain.bidirectional import states_at
from strandcast.tracking.chain.fit import NARROW_PX, ChainModel, FrameFit, PredictedChain, fit_frame
from strandcast.tracking.chain.frames import StringFrames
from strandcast.tracking.chain.links import place_on
from strandcast.tracking.chain.motion import ChainState, moving_half_px, still_half_px
from strandcast.tracking.chain.search import SHORT
from strandcast.tracking.chain.tracker import BETTER, GOOD, WORSE, ChainTracker

TURNS = 6  # chosen: most passes over weak stretches; most end after three
SEARCHES = 2  # chosen: of these, with searches of the string, one each way
FAR_PX = 6.0  # chosen: from the chain's place; beyond it a bead is searched from frame to frame instead


def refine(
    frames: StringFrames,
    fits: list[FrameFit | None],
    anchor: int,
    string: ChainModel,
    exposure_s: float,
    kept: Collection[int] = (),
) -> list[FrameFit | None]:
    """Return a second fit of each frame that starts at the first; None where the string is lost.

    The first pass tracked the string both ways from the frame `anchor`. Frames that are `kept` are not
    tracked again.
    """
    frames = replace(frames, beads_m=track_beads(frames, fits, string.beads))

    def again(index: int) -> FrameFit | None:
        fit, frame = fits[index], frames.at(index)
        if fit is None or frame is None or frame.bead_m is None:
            return None
        before = fits[index - 1] if index else None
        if before is None:
            half_px = still_half_px(string.appearance, len(fit.heading), frame.window)
        else:
            last = ChainState(float(frames.time_s[index - 1]), frames.clamp_m(index - 1), before.heading)
            half_px = moving_half_px(string, frame, last, fit.heading, exposure_s)
        expected = PredictedChain(frame.clamp_m, fit.heading, fit.heading, half_px, frame.bead_m)
        second: FrameFit = fit_frame(frame.window, string, expected, NARROW_PX, True)
        return second if second.value > fit.value - WORSE else fit

    with ThreadPoolExecutor(2) as pool:
        refined = list(pool.map(again, range(len(fits))))
    links = next(len(fit.heading) for fit in fits if fit is not None)
    retrack(frames, refined, anchor, ChainTracker(links, string, exposure_s, SHORT), kept)
    return refined


def retrack(
    frames: StringFrames,
    fits: list[FrameFit | None],
    anchor: int,
    tracker: ChainTracker,
    kept: Collection[int] = (),
) -> None:
    """Track weak stretches by turns towards the anchor and away from it, in place, until no fit gets better.

    Each frame is fitted from the best fits known of the two frames before it, so that a good stretch amid
    weak ones spreads both ways.
    """
    values = np.array([np.nan if fit is None else fit.value for fit in fits])
    bar = max(GOOD, float(np.nanmedian(values)) - WORSE)
    for turn in range(TURNS):
        weak = np.flatnonzero([fit is None or fit.value < bar or fit.end_is_off for fit in fits])
        away = turn % 2 == 1
        got_better = False
        for index in sorted(weak.tolist(), key=lambda index: abs(index - anchor), reverse=not away):
            frame = frames.at(index)
            if frame is None or index in kept:
                continue
            way = 1 if (index > anchor) == away else -1
            tracker.restart(states_at(frames, fits, [index - 2 * way, index - way]))
            fit, old = tracker.step(frame, search=turn < SEARCHES), fits[index]
            if fit is not None and (old is None or fit.value > old.value + BETTER):
                fits[index], got_better = fit, True
        if away and not got_better:
            break


def track_beads(frames: StringFrames, fits: list[FrameFit | None], beads: Beads) -> np.ndarray:
    """Return where the beads are, (F, B, 2) m; NaN where they are not found.

    A chain that cuts a fold short misses the weight in the fold. The weight itself is round, wider than the
    string, and moves steadily.
    """
    centres = np.full((len(fits), len(beads.place_m), 2), np.nan)
    if frames.given is not None:
        centres[:, : len(frames.given.share)] = frames.given.place_m
    searched = np.flatnonzero(beads.radius_m).tolist()
    for index, fit in enumerate(fits):
        window = frames.window(index) if fit is not None and len(beads.place_m) else None
        if fit is None or window is None:
            continue
        for b in searched:
            expected = place_on(fit.nodes(), fit.heading, beads.place_m[b])
            found = bead_centre(window, expected, beads, b)
            if np.hypot(*(found - expected)) < FAR_PX * window.plane.metre_per_pixel:
                centres[index, b] = found
    for b in searched:
        for order in (range(len(fits)), range(len(fits) - 1, -1, -1)):
            _continue(frames, centres[:, b], beads, b, order)
    return centres


def _continue(frames: StringFrames, centres: np.ndarray, beads: Beads, b: int, order: range) -> None:
    """Find bead `b` in frames that follow one in which it was found, in place (F, 2)."""
    for index in order[1:]:
        last = centres[index - order.step]
        if np.isfinite(centres[index, 0]) or not np.isfinite(last[0]):
            continue
        window = frames.window(index)
        if window is None:
            continue
        before = index - 2 * order.step
        known = 0 <= before < len(centres) and np.isfinite(centres[before, 0])
        expected = 2 * last - centres[before] if known else last
        found = bead_centre(window, expected, beads, b)
        if np.hypot(*(found - expected)) < BEAD_REACH_PX * window.plane.metre_per_pixel:
            centres[index] = found
