"""What the simulation missed by in earlier trials, carried over to a motion near them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.arm.servo import Servo, respond
from strandcast.motion.bezier import Curve
from strandcast.motion.earlier import Earlier, resampled
from strandcast.motion.strings import Strings
from strandcast.motion.task import Task
from strandcast.motion.throws import World, throw

SAME_PLACE_RAD_S = 0.02  # motions nearer than this count as the same
FADING_RAD_S = (
    0.4  # so far from the nearest trial, rms over the heights, half of what its tip missed by is left
)


@dataclass(frozen=True, eq=False)
class Carried:
    """Residuals of N earlier trials with the same posture and time.

    Attributes
    ----------
    heights_rad_s
        (N, J, H) control heights of those motions.
    joints_rad
        (N, T, J) measured angles minus the servo's.
    tip_m
        (N, K, T, 2) tip seen minus tip simulated with each string on the measured joints.
    """

    heights_rad_s: np.ndarray
    joints_rad: np.ndarray
    tip_m: np.ndarray

    def weights(self, heights: np.ndarray) -> np.ndarray:
        """Return (P, N) weights of the earlier trials for heights (P, J, H), by inverse square distance."""
        distance2 = np.mean((heights[:, None] - self.heights_rad_s[None]) ** 2, axis=(2, 3))
        weights = 1.0 / (distance2 + SAME_PLACE_RAD_S**2)
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))

    def shares(self, heights: np.ndarray) -> np.ndarray:
        """Return (P, N) how much of each trial's residual of the tip holds there: the weights, faded out."""
        distance2 = np.mean((heights[:, None] - self.heights_rad_s[None]) ** 2, axis=(2, 3)).min(axis=1)
        return np.asarray(self.weights(heights) / (1.0 + distance2 / FADING_RAD_S**2)[:, None])


def alike(trials: list[Earlier], curve: Curve) -> list[Earlier]:
    """Return the trials that started from the motion's posture and lasted as long."""
    return [
        trial
        for trial in trials
        if trial.curve is not None and _same_start(trial.curve, curve) and trial.curve.end_s == curve.end_s
    ]


def _same_start(one: Curve, other: Curve) -> bool:
    """Tell whether two motions have the same posture and time, stop ramps aside, and as many heights."""
    return (
        one.heights_rad_s.shape == other.heights_rad_s.shape
        and (one.ramp_s > 0.0) == (other.ramp_s > 0.0)
        and abs(one.duration_s - other.duration_s) < 1e-9
        and np.allclose(one.q0_rad, other.q0_rad, atol=1e-9)
    )


def distance_rad_s(curve: Curve, trials: list[Earlier]) -> float:
    """Return how far a motion is from the nearest trial's: rms over the heights, inf if none is like it.

    How long the arm takes to stop after the curve makes no difference.
    """
    away = [
        np.sqrt(np.mean((curve.heights_rad_s - trial.curve.heights_rad_s) ** 2))
        for trial in trials
        if trial.curve is not None and _same_start(trial.curve, curve)
    ]
    return float(min(away, default=np.inf))


def carry(task: Task, strings: Strings, servo: Servo | None, trials: list[Earlier]) -> Carried:
    """Simulate earlier trials as they were and keep what the simulation missed by."""
    time_s = np.arange(len(trials[0].q)) * task.step_s
    tips = []
    for trial in trials:
        world = World(start_m=trial.start_m)
        swaying = replace(strings, sway=np.tile([0.0, trial.sway_rad_s], (len(strings), 1)))
        thrown = throw(task, swaying, world, trial.q[None], np.array([len(time_s) - 1]))
        tips.append(missed_by(trial, thrown.points_m[:, :, -1], task.step_s))
    return Carried(
        np.array([trial.curve.heights_rad_s for trial in trials if trial.curve is not None]),
        np.array([trial.q - _followed(servo, time_s, trial.q_command) for trial in trials]),
        np.array(tips),
    )


def _followed(servo: Servo | None, time_s: np.ndarray, q_command: np.ndarray) -> np.ndarray:
    return q_command if servo is None else respond(servo, time_s, q_command)


def missed_by(trial: Earlier, tips_m: np.ndarray, step_s: float) -> np.ndarray:
    """Return (K, T, 2) by what simulated tips (K, T, 2), every `step_s`, missed the tip that was seen [m].

    It is linear between the frames that saw the tip, and held before and after: from frame to frame the
    tip's path bends, by millimetres where frames are lost, and what the simulation misses it by hardly does.
    Nothing seen, or a string whose simulation failed, carries nothing.
    """
    time_s = np.arange(tips_m.shape[1]) * step_s
    during = (trial.seen_s >= 0.0) & (trial.seen_s <= time_s[-1])
    seen_s, seen_m = trial.seen_s[during], trial.tip_m[during]
    answer = np.zeros_like(tips_m)
    for tip_m, missed_m in zip(tips_m, answer, strict=True):
        off_m = seen_m - resampled(seen_s, time_s, tip_m)
        known = np.isfinite(off_m).all(axis=1)
        if known.any():
            missed_m[:] = resampled(time_s, seen_s[known], off_m[known])
    return answer
