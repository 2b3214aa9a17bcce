"""The refined pass: fit every frame again with the values learned from all, and derive the mass points."""

from concurrent.futures import ThreadPoolExecutor

from strandcast.tracking.chain.beads import track_beads
from strandcast.tracking.chain.fit import NARROW_PX, ChainModel, FrameFit, PredictedChain, fit_frame
from strandcast.tracking.chain.frames import StringFrames
from strandcast.tracking.chain.motion import ChainState, moving_half_px, still_half_px
from strandcast.tracking.chain.point_uncertainty import FramePoints, frame_points
from strandcast.tracking.chain.tracker import WORSE


def refine(
    frames: StringFrames,
    fits: list[FrameFit | None],
    string: ChainModel,
    per_point: int,
    length_sigma_m: float,
    exposure_s: float,
) -> list[FramePoints | None]:
    """Return the mass points of each frame, from a second fit that starts at the first; None where lost.

    The mass points are `per_point` links apart; the string's length has an uncertainty.
    """
    centres = track_beads(frames, fits, string.beads)

    def points(index: int) -> FramePoints | None:
        fit, frame = fits[index], frames.at(index)
        if fit is None or frame is None:
            return None
        before = fits[index - 1] if index else None
        if before is None:
            half_px = still_half_px(string.appearance, len(fit.heading), frame.window)
        else:
            last = ChainState(float(frames.time_s[index - 1]), frames.clamp_m(index - 1), before.heading)
            half_px = moving_half_px(string, frame, last, fit.heading, exposure_s)
        expected = PredictedChain(frame.clamp_m, fit.heading, fit.heading, half_px, centres[index])
        again = fit_frame(frame.window, string, expected, NARROW_PX, True)
        best = again if again.value > fit.value - WORSE else fit
        return frame_points(best, per_point, frame.window, frame.clamp_m, length_sigma_m)

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(points, range(len(fits))))
