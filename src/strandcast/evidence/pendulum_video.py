"""A filmed pendulum, ball on a thread, pivot out of view: its period, and how quiet its tracked tip is.

Scale and pivot come from the arc that the ball describes, as for any experiment with `track.hand: pivot`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from strandcast.evidence.figure import Figure
from strandcast.evidence.string_pendulum import period_s
from strandcast.tracking.arc import arc_camera, fit_arc
from strandcast.tracking.ball import BallPath, follow_ball
from strandcast.video.ingest import camera_times, inspect_video

FILE = "rope_pendulum_0.62m_60fps.mp4"
LENGTH_M = 0.62  # as its author states
PERIOD_S = 1.600  # measured from the same video before, otherwise; standard deviation 0.004 over 18 periods
FRAMES = 1844
BACKGROUND_FRAMES = 40
PERIOD_TARGET_PERCENT = 0.2
SMOOTH_FRAMES, SMOOTH_DEGREE = 15, 3  # of the local polynomial: a quarter of a second, a sixth of a period


@dataclass(frozen=True, eq=False)
class Swing:
    """The ball in pixels, the time of each frame (F,) s, the scale m/px and the arc's residual px."""

    ball: BallPath
    time_s: np.ndarray
    scale_m_per_px: float
    arc_rms_px: float

    @property
    def seen(self) -> np.ndarray:
        """Frames (F,) in which the ball was found."""
        return np.asarray(np.isfinite(self.ball.centre_px[:, 0]))


def follow(path: Path) -> Swing:
    """Track the video."""
    facts = inspect_video(path)
    ball = follow_ball(path, facts, BACKGROUND_FRAMES)
    arc = fit_arc(ball.centre_px)
    scale = arc_camera(arc, facts, LENGTH_M).scale_m_per_px
    return Swing(ball, np.asarray(camera_times(facts)), float(scale), arc.rms_px)


def noise_px(swing: Swing) -> np.ndarray:
    """Residuals (K, 2) px of the centre against a local polynomial, where all of its frames were seen."""
    half = SMOOTH_FRAMES // 2
    whole = np.convolve(swing.seen, np.ones(SMOOTH_FRAMES), mode="same") == SMOOTH_FRAMES
    whole[:half] = whole[-half:] = False
    filled = np.where(swing.seen[:, None], swing.ball.centre_px, 0.0)
    smooth = savgol_filter(filled, SMOOTH_FRAMES, SMOOTH_DEGREE, axis=0)
    # The polynomial takes its share of the noise: of its middle point, this much is left.
    impulse = np.eye(SMOOTH_FRAMES)[half]
    own = float(savgol_filter(impulse, SMOOTH_FRAMES, SMOOTH_DEGREE)[half])
    return np.asarray((filled - smooth)[whole] / np.sqrt(1.0 - own))


def measure(folder: Path) -> list[Figure]:
    """Figures: the period's error, frames decoded and seen, the tip's noise."""
    swing = follow(folder / FILE)
    x = np.interp(swing.time_s, swing.time_s[swing.seen], swing.ball.centre_px[swing.seen, 0])
    period = period_s(swing.time_s, x)
    off = noise_px(swing)
    rms = np.sqrt((off**2).mean(axis=0))
    usual = 1.48 * np.median(np.abs(off), axis=0)
    noise = float(np.hypot(*rms))
    return [
        Figure("pendulum_video.period", 100.0 * (period / PERIOD_S - 1.0), "%", PERIOD_TARGET_PERCENT,
               f"against {PERIOD_S} s, itself known to 0.06 %", {"period_s": period}),
        Figure("pendulum_video.frames_lost", float(FRAMES - swing.ball.decoded), "1", 0.0,
               f"frames decoded, against {FRAMES}"),
        Figure("pendulum_video.not_seen", 100.0 * float(1.0 - swing.seen.mean()), "%", 5.0,
               "frames without a ball of its usual radius"),
        Figure("pendulum_video.tip_noise", noise, "px",
               note=f"rms of x and y together against a cubic over {SMOOTH_FRAMES} frames",
               detail={"mm": 1e3 * noise * swing.scale_m_per_px, "rms_xy_px": rms.tolist(),
                       "robust_xy_px": usual.tolist(), "arc_rms_px": swing.arc_rms_px,
                       "m_per_px": swing.scale_m_per_px}),
    ]  # fmt: skip
