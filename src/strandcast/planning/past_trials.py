"""A past trial on its motion's own clock: the motion that was played, the joints, the string."""

from dataclasses import dataclass

import numpy as np

from strandcast.core.interpolation import resampled
from strandcast.planning.bezier import Curve
from strandcast.planning.miss_calibration import FITTED
from strandcast.planning.rollouts import AFTER_END_S
from strandcast.records.motion import Motion

SWAY_BEFORE_S = 0.12  # the string's turning at the start is measured over this long before it; chosen
STILL_BEFORE_S = 0.05  # the string's shape at the start is the mean of this long before it; chosen


@dataclass(frozen=True, eq=False)
class PastTrial:
    """One past trial on the motion's own clock.

    Attributes
    ----------
    curve
        The motion that was played, None if it came without control heights.
    q_command_rad, q_rad
        (T, J) commanded and measured angles, evenly from the motion's start to 0.3 s after its end.
    frame_s, tip_m
        (F,) times of the camera's frames on that clock, and (F, 2 or 3) the tracked tip, NaN if hidden [m].
    start_m
        (n, 2 or 3) points 1…n just before the start, None if not all were tracked [m].
    sway_rad_s
        Rate at which the string turned about the hand then.
    miss_m
        Measured miss, None where the tip was not tracked at the closest approach.
    logged
        Whether there is a joint log; without one, the joints are taken to have followed the command.
    stated_m
        Median of the miss that was stated before the throw; None where it was not calibrated, or not made
        with a string fitted to throws.
    """

    trial: int
    curve: Curve | None
    q_command_rad: np.ndarray
    q_rad: np.ndarray
    frame_s: np.ndarray
    tip_m: np.ndarray
    start_m: np.ndarray | None
    sway_rad_s: float
    miss_m: float | None
    logged: bool = True
    stated_m: float | None = None


def curve_of(motion: Motion) -> Curve | None:
    """Return the velocity curve of a motion record, None if it has no control heights."""
    if motion.bezier is None:
        return None
    end_s = motion.trajectory().end_s
    duration_s = motion.bezier.duration_s
    ramp_s = end_s - duration_s if motion.bezier.stop_ramp_from_s is not None else 0.0
    return Curve(
        np.array(motion.start.positions_rad), duration_s, np.array(motion.bezier.heights_rad_s), ramp_s
    )


def past_trial(
    motion: Motion,
    step_s: float,
    joints: tuple[np.ndarray, np.ndarray],
    points: tuple[np.ndarray, np.ndarray],
    miss_m: float | None = None,
    *,
    logged: bool = True,
) -> PastTrial:
    """Bring one trial's data onto the clock of its motion, joints every `step_s`.

    Parameters
    ----------
    joints
        (R,) times since the motion's start, also before it [s], and (R, J) measured angles [rad].
    points
        (F,) times of the camera's frames, and (F, n+1, 2 or 3) the track, NaN where a point is hidden [m].
    """
    planned, (frame_s, points_m) = motion.trajectory(), points
    time_s = np.arange(round((planned.end_s + AFTER_END_S) / step_s) + 1) * step_s
    return PastTrial(
        trial=motion.trial,
        curve=curve_of(motion),
        q_command_rad=resampled(time_s, planned.time_s, planned.q_rad),
        q_rad=resampled(time_s, *joints),
        frame_s=frame_s,
        tip_m=points_m[:, -1],
        start_m=start_shape(frame_s, points_m[:, 1:]),
        sway_rad_s=start_sway(frame_s, points_m),
        miss_m=miss_m,
        logged=logged,
        stated_m=stated_miss_m(motion),
    )


def stated_miss_m(motion: Motion) -> float | None:
    """Return the median miss that was stated of a motion planned with a fitted string, see `PastTrial`."""
    stated, origin = motion.predicted, motion.provenance
    if stated is None or origin is None or not stated.calibrated or origin.kind not in FITTED:
        return None
    return stated.miss_quantiles_m.get("p50")


def start_shape(frame_s: np.ndarray, points_m: np.ndarray) -> np.ndarray | None:
    """Return the mean place (n, 2 or 3) of points 1…n just before the start, None if one was not tracked."""
    before = (frame_s <= 0.0) & (frame_s >= -STILL_BEFORE_S)
    if not np.isfinite(points_m[before]).all(axis=2).any(axis=0).all():
        return None
    return np.asarray(np.nanmean(points_m[before], axis=0))


def start_sway(frame_s: np.ndarray, points_m: np.ndarray) -> float:
    """Return the rate [rad/s] at which the string (F, n+1, 2) turns about the hand just before the start.

    It is the rigid rotation that fits all points and frames best; 0 where none is tracked. In space it is not
    one number, and 0.
    """
    if points_m.shape[2] != 2:
        return 0.0
    before = (frame_s <= 0.0) & (frame_s >= -SWAY_BEFORE_S)
    away = points_m[before, 1:] - points_m[before, :1]
    known = np.isfinite(away).all(axis=2)
    swept, inertia = 0.0, 0.0
    for i in np.flatnonzero(known.sum(axis=0) >= 3):
        place, time_s = away[known[:, i], i], frame_s[before][known[:, i]]
        since = time_s - time_s.mean()
        speed = (since[:, None] * place).sum(axis=0) / (since**2).sum()
        middle = place.mean(axis=0)
        swept += middle[0] * speed[1] - middle[1] * speed[0]
        inertia += middle @ middle
    return float(swept / inertia) if inertia > 0.0 else 0.0
