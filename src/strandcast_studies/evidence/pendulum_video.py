"""A filmed pendulum, a ball on a thread with its pivot out of view: its period and the tracked tip's noise.

Scale and pivot come from the ball's arc, as with `track.tracker: pendulum`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from strandcast.video.ingest import camera_times, inspect_video
from strandcast_pendulum.arc import arc_camera, fit_arc
from strandcast_pendulum.ball import BallTrack, track_ball
from strandcast_pendulum.period import period_s
from strandcast_studies.evidence.figure import Figure

FILE = "rope_pendulum_0.62m_60fps.mp4"
LENGTH_M = 0.62  # stated by its author
PERIOD_S = 1.600  # measured from the same video by other means; standard deviation 0.004 over 18 periods
FRAMES = 1844
SMOOTH_FRAMES, SMOOTH_DEGREE = 15, 3  # of the local polynomial: a quarter of a second, a sixth of a period


@dataclass(frozen=True, eq=False)
class FilmedSwing:
    """The ball in pixels, the time of each frame (F,) s, the scale m/px and the arc's residual px."""

    ball: BallTrack
    time_s: np.ndarray
    scale_m_per_px: float
    arc_rms_px: float

    @property
    def detected(self) -> np.ndarray:
        """Frames (F,) in which the ball was found."""
        return np.asarray(np.isfinite(self.ball.centre_px[:, 0]))


def follow(path: Path) -> FilmedSwing:
    """Track the video."""
    facts = inspect_video(path)
    ball = track_ball(path, facts)
    arc = fit_arc(ball.centre_px)
    scale = arc_camera(arc, facts, LENGTH_M).scale_m_per_px
    return FilmedSwing(ball, np.asarray(camera_times(facts)), float(scale), arc.rms_px)


def noise_px(swing: FilmedSwing) -> np.ndarray:
    """Return residuals (K, 2) px of the centre from a local polynomial whose frames all show the ball."""
    half = SMOOTH_FRAMES // 2
    whole = np.convolve(swing.detected, np.ones(SMOOTH_FRAMES), mode="same") == SMOOTH_FRAMES
    whole[:half] = whole[-half:] = False
    filled = np.where(swing.detected[:, None], swing.ball.centre_px, 0.0)
    smooth = savgol_filter(filled, SMOOTH_FRAMES, SMOOTH_DEGREE, axis=0)
    # The polynomial follows part of the noise: of its middle point, by this share.
    impulse = np.eye(SMOOTH_FRAMES)[half]
    own = float(savgol_filter(impulse, SMOOTH_FRAMES, SMOOTH_DEGREE)[half])
    return np.asarray((filled - smooth)[whole] / np.sqrt(1.0 - own))


def measure(folder: Path) -> list[Figure]:
    """Return figures of the period's error, of frames decoded and detected, and of the tip's noise.

    The targets are chosen.
    """
    swing = follow(folder / FILE)
    x = np.interp(swing.time_s, swing.time_s[swing.detected], swing.ball.centre_px[swing.detected, 0])
    period = period_s(swing.time_s, x)
    off = noise_px(swing)
    rms = np.sqrt((off**2).mean(axis=0))
    usual = 1.48 * np.median(np.abs(off), axis=0)
    noise = float(np.hypot(*rms))
    detail = {
        "mm": 1e3 * noise * swing.scale_m_per_px,
        "rms_xy_px": rms.tolist(),
        "robust_xy_px": usual.tolist(),
        "arc_rms_px": swing.arc_rms_px,
        "m_per_px": swing.scale_m_per_px,
    }
    period_note = f"against {PERIOD_S} s, itself known to 0.06 %"
    noise_note = f"rms of x and y together against a cubic over {SMOOTH_FRAMES} frames"
    lost, error = float(FRAMES - swing.ball.decoded), 100.0 * (period / PERIOD_S - 1.0)
    missing = 100.0 * float(1.0 - swing.detected.mean())
    return [
        Figure("pendulum_video.period", error, "%", 0.2, period_note, {"period_s": period}),
        Figure("pendulum_video.frames_lost", lost, "1", 0.0, f"frames decoded, against {FRAMES}"),
        Figure("pendulum_video.not_seen", missing, "%", 5.0, "frames without a ball of the expected radius"),
        Figure("pendulum_video.tip_noise", noise, "px", note=noise_note, detail=detail),
    ]
