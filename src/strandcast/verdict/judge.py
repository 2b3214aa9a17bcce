"""The verdict: by how much a throw missed what it was for, with its σ, or why that is not told."""

from __future__ import annotations

from typing import Any

import numpy as np

from strandcast.records.alignment import Alignment
from strandcast.records.summary import AFTER_MOTION_S, Verdict
from strandcast.records.track import UNSURE, Track
from strandcast.verdict.approach import closest_approach
from strandcast.verdict.moment import Seen, Shape, Swing, Velocity, least

MOST_UNSURE = 0.9  # of the throw's frames, with an unsure tip, from which no miss is told

Bar = tuple[tuple[float, float], tuple[float, float]]


def judge(
    track: Track,
    alignment: Alignment,
    target_m: tuple[float, float],
    hit_radius_m: float,
    experiment: str,
    trial: int,
    bar_m: Bar | None = None,
) -> Verdict:
    """Judge one throw at a target or a bar, from the motion's start until 0.3 s after its end.

    Parameters
    ----------
    track
        The mass points; a tip that is only predicted or hidden counts as not tracked.
    alignment
        Camera time to robot time, and when the motion was.
    target_m, hit_radius_m
        In the world frame.
    experiment, trial
        Whose verdict it is.
    bar_m
        Both ends of a bar to strike; the miss is from it then, not from the target.
    """
    target = np.asarray(target_m if bar_m is None else bar_m, float)
    robot_s, window_s = alignment.robot_time_s(track.camera_time_s), _window_s(alignment)
    tip = track.points_m[:, -1]
    mine = np.flatnonzero(track.seen()[:, -1] & _within(robot_s, window_s))
    told = {} if bar_m is None else {"objective": "segment", "bar_m": target.tolist()}
    blank = _blank(target_m, hit_radius_m, experiment, trial).model_copy(update=told)
    reason = _blind(track, mine)
    if reason is not None:
        return blank.model_copy(update={"reason": reason})
    found, reason = closest_approach(robot_s[mine], tip[mine], target, _usual_step_s(track), window_s)
    if found is None:
        return blank.model_copy(update={"reason": reason})
    before, after, share = mine[found.index], mine[found.index + 1], found.share
    sigma_m = float(np.hypot(*(np.array([1 - share, share]) * track.sigma_m[[before, after], -1])))
    return _told(
        blank,
        found.distance_m,
        sigma_m,
        frame=int(track.frame[before if share < 0.5 else after]),
        robot_s=float((1 - share) * robot_s[before] + share * robot_s[after]),
        place_m=found.place_m,
    )


def judge_moment(
    track: Track,
    alignment: Alignment,
    wanted: Velocity | Shape | Swing,
    length_m: float,
    blank: Verdict,
) -> Verdict:
    """Judge one throw that is for more than to come near a place; the tip's place then is told.

    Parameters
    ----------
    track, alignment
        See `judge`.
    wanted
        What the throw is for.
    length_m
        From the hand to the tip, along the string.
    blank
        The verdict as far as it is known: whose it is, what it is about.
    """
    robot_s, window_s = alignment.robot_time_s(track.camera_time_s), _window_s(alignment)
    inside, seen = _within(robot_s, window_s), track.seen()
    reason = _blind(track, np.flatnonzero(seen[:, -1] & inside))
    if reason is not None:
        return blank.model_copy(update={"reason": reason})
    points_m = np.where(seen[..., None], track.points_m, np.nan)[inside]
    there = Seen(robot_s[inside], points_m, track.sigma_m[inside], length_m, _usual_step_s(track))
    lack_m, sigma_m = wanted.lack(there)
    best, reason = least(lack_m, there.time_s, there.step_s, window_s)
    if best is None:
        return blank.model_copy(update={"reason": reason})
    return _told(
        blank,
        float(lack_m[best]),
        float(sigma_m[best]),
        frame=int(track.frame[inside][best]),
        robot_s=float(there.time_s[best]),
        place_m=points_m[best, -1],
    )


def blank_verdict(
    target_m: tuple[float, float],
    hit_radius_m: float,
    experiment: str,
    trial: int,
    objective: str,
    wanted: str,
) -> Verdict:
    """Return the verdict of which no miss is known yet, on an objective in words."""
    blank = _blank(target_m, hit_radius_m, experiment, trial)
    return blank.model_copy(update={"objective": objective, "wanted": wanted})


def _blank(target_m: tuple[float, float], hit_radius_m: float, experiment: str, trial: int) -> Verdict:
    return Verdict(
        experiment=experiment,
        trial=trial,
        target_m=[float(x) for x in target_m],
        hit_radius_m=hit_radius_m,
        miss_m=None,
        miss_sigma_m=None,
        hit=False,
        closest_frame=None,
        closest_robot_time_s=None,
        closest_m=None,
        reason=None,
    )


def _told(
    blank: Verdict, miss_m: float, sigma_m: float, *, frame: int, robot_s: float, place_m: np.ndarray
) -> Verdict:
    found: dict[str, Any] = {
        "miss_m": miss_m,
        "miss_sigma_m": sigma_m if np.isfinite(sigma_m) else None,
        "hit": miss_m <= blank.hit_radius_m,
        "closest_frame": frame,
        "closest_robot_time_s": robot_s,
        "closest_m": place_m.tolist() if np.isfinite(place_m).all() else None,
    }
    return blank.model_copy(update=found)


def _window_s(alignment: Alignment) -> tuple[float, float]:
    return alignment.motion_start_s, alignment.motion_end_s + AFTER_MOTION_S


def _within(robot_s: np.ndarray, window_s: tuple[float, float]) -> np.ndarray:
    return np.asarray((robot_s >= window_s[0]) & (robot_s <= window_s[1]))


def _blind(track: Track, mine: np.ndarray) -> str | None:
    """Return why nothing can be told from the frames in which the tip was seen; None where it can."""
    if len(mine) < 2:
        return f"the tip was tracked in {len(mine)} frames of the throw only"
    if ((track.flags[mine, -1] & UNSURE) > 0).mean() > MOST_UNSURE:
        return "the tip's place is unsure in nearly every frame of the throw"
    return None


def _usual_step_s(track: Track) -> float:
    return float(np.median(np.diff(track.camera_time_s)))
