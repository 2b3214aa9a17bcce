"""Score a throw: its miss with the standard deviation, or why it is not known."""

from typing import NamedTuple

import numpy as np

from strandcast.core.objectives import Objective
from strandcast.records.alignment import Alignment
from strandcast.records.camera import PlaneError
from strandcast.records.track import UNSURE, Track
from strandcast.records.verdict import AFTER_MOTION_S, Verdict
from strandcast.scoring.measured_misses import Measured, TrackedThrow, measured_shortfall

MOST_UNSURE = 0.9  # of the throw's frames: with more of them unsure no miss is reported; chosen


class Aim(NamedTuple):
    """The objective of one trial's throw.

    Attributes
    ----------
    experiment, trial
        The throw.
    objective
        Includes the target, if it needs one.
    target_m, hit_radius_m
        The experiment's target, and the greatest miss that is a hit, in the world frame.
    """

    experiment: str
    trial: int
    objective: Objective
    target_m: tuple[float, ...]
    hit_radius_m: float


def score_throw(
    track: Track,
    alignment: Alignment,
    aim: Aim,
    length_m: float,
    plane_error: PlaneError | None = None,
    tip_sigma_m: float = 0.0,
) -> Verdict:
    """Score one throw; the arguments are those of `tracked_shortfall`, and the errors that all frames share.

    These are the calibration's, and the tip's own: where a string ends is seen no better than its end is
    shaped. They are independent of the tracker's in a few frames.
    """
    shortfall, reason = tracked_shortfall(track, alignment, aim.objective, length_m, aim.hit_radius_m)
    objective, bar_m = aim.objective, aim.objective.bar_m
    unknown = without_target(aim.experiment, aim.trial, aim.hit_radius_m).model_copy(
        update={
            "target_m": [float(x) for x in aim.target_m],
            "hit": False,
            "reason": reason,
            "objective": objective.kind,
            "wanted": objective.refinement,
            "bar_m": None if bar_m is None else [list(end) for end in bar_m],
        }
    )
    if shortfall is None:
        return unknown
    seen, plane_m = bool(np.isfinite(shortfall.tip_m).all()), 0.0
    if plane_error is not None:
        plane_m = plane_error.at(shortfall.tip_m) if seen else plane_error.median_m
    sigma_m = float(np.sqrt(shortfall.sigma_m**2 + plane_m**2 + tip_sigma_m**2))
    return unknown.model_copy(
        update={
            "miss_m": shortfall.miss_m,
            "miss_sigma_m": sigma_m if np.isfinite(sigma_m) else None,
            "hit": shortfall.miss_m <= aim.hit_radius_m,
            "closest_frame": int(track.frame[shortfall.row]),
            "closest_robot_time_s": shortfall.time_s,
            "closest_m": shortfall.tip_m.tolist() if seen else None,
        }
    )


def tracked_shortfall(
    track: Track, alignment: Alignment, objective: Objective, length_m: float, touch_m: float
) -> Measured:
    """Return the miss of one throw from the motion's start until 0.3 s after its end, or why it is not known.

    Parameters
    ----------
    track
        The mass points; a tip that is only predicted or hidden counts as not tracked.
    alignment
        Camera time to robot time, and when the motion was.
    objective
        Includes the target, if it needs one.
    length_m
        From the hand to the tip, along the string.
    touch_m
        An approach counts only after the tip has been farther from the target than this.
    """
    robot_s = alignment.robot_time_s(track.camera_time_s)
    window_s = (alignment.motion_start_s, alignment.motion_end_s + AFTER_MOTION_S)
    inside, tracked = (robot_s >= window_s[0]) & (robot_s <= window_s[1]), track.detected()
    reason = _too_little(track, np.flatnonzero(tracked[:, -1] & inside))
    if reason is not None:
        return None, reason
    points_m = np.where(tracked[..., None], track.points_m, np.nan)[inside]
    step_s = float(np.median(np.diff(track.camera_time_s)))
    throw = TrackedThrow(
        robot_s[inside], points_m, track.sigma_m[inside], length_m, step_s, window_s, touch_m
    )
    shortfall, reason = measured_shortfall(objective, throw)
    if shortfall is None:
        return None, reason
    return shortfall._replace(row=int(np.flatnonzero(inside)[shortfall.row])), None


def without_target(experiment: str, trial: int, hit_radius_m: float) -> Verdict:
    """Return the verdict of a trial that aimed at nothing."""
    return Verdict(
        experiment=experiment,
        trial=trial,
        target_m=None,
        hit_radius_m=hit_radius_m,
        miss_m=None,
        miss_sigma_m=None,
        hit=None,
        closest_frame=None,
        closest_robot_time_s=None,
        closest_m=None,
        reason="the experiment has no target",
    )


def _too_little(track: Track, rows: np.ndarray) -> str | None:
    """Return the reason if the frames with a tracked tip are too few or too unsure for a miss."""
    if len(rows) < 2:
        return f"the tip was tracked in {len(rows)} frames of the throw only"
    if ((track.flags[rows, -1] & UNSURE) > 0).mean() > MOST_UNSURE:
        return "the tip's place is unsure in nearly every frame of the throw"
    return None
