"""The refined pass: fit every frame again with what all frames show, then track weak stretches again."""

from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from strandcast.tracking.chain.beads import track_beads
from strandcast.tracking.chain.bidirectional import states_at
from strandcast.tracking.chain.fit import NARROW_PX, ChainModel, FrameFit, PredictedChain, fit_frame
from strandcast.tracking.chain.frames import StringFrames
from strandcast.tracking.chain.motion import ChainState, moving_half_px, still_half_px
from strandcast.tracking.chain.search import SHORT
from strandcast.tracking.chain.tracker import BETTER, GOOD, WORSE, ChainTracker

TURNS = 6  # chosen: most passes over weak stretches; most end after three
SEARCHES = 2  # chosen: of these, with searches of the string, one each way


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
