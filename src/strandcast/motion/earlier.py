"""What an earlier trial taught: the motion that was played, what the joints did, where the string was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.motion.bezier import Curve
from strandcast.motion.throws import AFTER_END_S
from strandcast.records.motion import Motion

SWAY_BEFORE_S = 0.12  # the string's turning at the start is looked for in this long before it
STILL_BEFORE_S = 0.05  # the string's shape at the start is the mean of this long before it


@dataclass(frozen=True, eq=False)
class Earlier:
    """One earlier trial on the motion's own clock.

    Attributes
    ----------
    trial
        Its number.
    curve
        The motion that was played, None if it came without control heights.
    q_command, q
        (T, J) commanded and measured angles [rad], evenly from the motion's start to 0.3 s after its end.
    seen_s, tip_m
        (F,) times of the camera's frames on that clock, and (F, 2) the tip as seen, NaN where it was not [m].
    start_m
        (n, 2) points 1…n just before the start, None if not all were seen [m].
    sway_rad_s
        Rate at which the string turned about the hand then.
    miss_m
        Measured miss, None where the tip was not seen at the closest approach.
    """

    trial: int
    curve: Curve | None
    q_command: np.ndarray
    q: np.ndarray
    seen_s: np.ndarray
    tip_m: np.ndarray
    start_m: np.ndarray | None
    sway_rad_s: float
    miss_m: float | None


def curve_of(motion: Motion) -> Curve | None:
    """Return the velocity curve of a motion record, None if it has no control heights."""
    if motion.bezier is None:
        return None
    end_s = float(motion.time_s()[-1])
    duration_s = motion.bezier.duration_s
    ramp_s = end_s - duration_s if motion.bezier.stop_ramp_from_s is not None else 0.0
    return Curve(
        np.array(motion.start.positions_rad), duration_s, np.array(motion.bezier.heights_rad_s), ramp_s
    )


def earlier_trial(
    motion: Motion,
    joint_time_s: np.ndarray,
    q: np.ndarray,
    camera_time_s: np.ndarray,
    points_m: np.ndarray,
    miss_m: float | None,
    step_s: float,
) -> Earlier:
    """Bring one trial's data onto the motion's clock.

    Parameters
    ----------
    motion
        The motion that was played.
    joint_time_s, q
        (R,) times since the motion's start, also before it, and (R, J) measured angles [rad].
    camera_time_s, points_m
        (F,) frame times since the motion's start, on the robot's clock, and (F, n+1, 2) the track [m].
    miss_m
        The measured miss.
    step_s
        Time between samples.
    """
    time_s = np.arange(round((motion.time_s()[-1] + AFTER_END_S) / step_s) + 1) * step_s
    positions = motion.joints()[0]
    return Earlier(
        trial=motion.trial,
        curve=curve_of(motion),
        q_command=resampled(time_s, motion.time_s(), positions),
        q=resampled(time_s, joint_time_s, q),
        seen_s=camera_time_s,
        tip_m=points_m[:, -1],
        start_m=start_shape(camera_time_s, points_m[:, 1:]),
        sway_rad_s=start_sway(camera_time_s, points_m),
        miss_m=miss_m,
    )


def resampled(time_s: np.ndarray, known_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return columns of `values` at other times, linear between samples, held at the ends."""
    return np.stack([np.interp(time_s, known_s, column) for column in values.T], axis=1)


def start_shape(seen_s: np.ndarray, points_m: np.ndarray) -> np.ndarray | None:
    """Return the mean place (n, 2) of points 1…n just before the start, None if one was never seen then."""
    before = (seen_s <= 0.0) & (seen_s >= -STILL_BEFORE_S)
    if not np.isfinite(points_m[before]).all(axis=2).any(axis=0).all():
        return None
    return np.asarray(np.nanmean(points_m[before], axis=0))


def start_sway(seen_s: np.ndarray, points_m: np.ndarray) -> float:
    """Return the rate [rad/s] at which the string (F, n+1, 2) turns about the hand just before the start.

    It is that of the rigid turn that fits all points and frames best; 0 where none is seen.
    """
    before = (seen_s <= 0.0) & (seen_s >= -SWAY_BEFORE_S)
    away = points_m[before, 1:] - points_m[before, :1]
    known = np.isfinite(away).all(axis=2)
    swept, spread = 0.0, 0.0
    for i in np.flatnonzero(known.sum(axis=0) >= 3):
        place, time_s = away[known[:, i], i], seen_s[before][known[:, i]]
        since = time_s - time_s.mean()
        speed = (since[:, None] * place).sum(axis=0) / (since**2).sum()
        middle = place.mean(axis=0)
        swept += middle[0] * speed[1] - middle[1] * speed[0]
        spread += middle @ middle
    return float(swept / spread) if spread > 0.0 else 0.0
