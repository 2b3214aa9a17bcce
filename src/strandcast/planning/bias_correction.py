"""Past trials simulated on their measured joints: how near they came, and the simulation's error there.

That error corrects the prediction for a motion near them.
"""

from dataclasses import dataclass

import numpy as np

from strandcast.core.interpolation import resampled
from strandcast.core.strings import StringBatch
from strandcast.dynamics.simulate import LONGEST_SEGMENT
from strandcast.planning.bezier import Curve
from strandcast.planning.past_trials import PastTrial
from strandcast.planning.rollouts import RolloutConditions, Rollouts, simulate_rollouts
from strandcast.planning.simulated_misses import simulated_miss
from strandcast.planning.task import PlanningTask

SAME_MOTION_RAD_S = 0.02  # motions nearer than this count as the same; chosen
# This far from the nearest trial, rms over the heights, half of its tip's bias is left: tuned on seeds 4 to 7
# (`python -m strandcast_studies.benchmarks.loop.distance` measures it).
HALF_LEFT_RAD_S = 0.4


@dataclass(frozen=True, eq=False)
class BiasCorrection:
    """Errors of the simulation in N past trials with the same posture and time.

    Attributes
    ----------
    heights_rad_s
        (N, J, H) control heights of those motions.
    joints_rad
        (N, T, J) measured angles minus the servo's.
    tip_m
        (N, K, T, 2) tracked tip minus tip simulated with each string on the measured joints.
    """

    heights_rad_s: np.ndarray
    joints_rad: np.ndarray
    tip_m: np.ndarray

    def weights(self, heights: np.ndarray) -> np.ndarray:
        """Return (P, N) weights of the past trials for heights (P, J, H), by inverse square distance."""
        distance2 = np.mean((heights[:, None] - self.heights_rad_s[None]) ** 2, axis=(2, 3))
        weights = 1.0 / (distance2 + SAME_MOTION_RAD_S**2)
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))

    def tip_weights(self, heights: np.ndarray) -> np.ndarray:
        """Return (P, N) how much of each trial's tip bias to apply: the weights, faded with the distance."""
        distance2 = np.mean((heights[:, None] - self.heights_rad_s[None]) ** 2, axis=(2, 3)).min(axis=1)
        return np.asarray(self.weights(heights) / (1.0 + distance2 / HALF_LEFT_RAD_S**2)[:, None])


def comparable(trials: list[PastTrial], curve: Curve) -> list[PastTrial]:
    """Return the trials that started from the motion's posture and lasted as long."""
    return [
        trial
        for trial in trials
        if trial.curve is not None and _same_start(trial.curve, curve) and trial.curve.end_s == curve.end_s
    ]


def _same_start(one: Curve, other: Curve) -> bool:
    """Whether two motions have the same posture, the same time without stop ramps, and as many heights."""
    return (
        one.heights_rad_s.shape == other.heights_rad_s.shape
        and (one.ramp_s > 0.0) == (other.ramp_s > 0.0)
        and abs(one.duration_s - other.duration_s) < 1e-9
        and np.allclose(one.q0_rad, other.q0_rad, atol=1e-9)
    )


def distance_rad_s(curve: Curve, trials: list[PastTrial]) -> float:
    """Return the distance of a motion from the nearest trial's: rms over the heights, inf if none is like it.

    How long the arm takes to stop after the curve makes no difference.
    """
    away = [
        np.sqrt(np.mean((curve.heights_rad_s - trial.curve.heights_rad_s) ** 2))
        for trial in trials
        if trial.curve is not None and _same_start(trial.curve, curve)
    ]
    return float(min(away, default=np.inf))


def bias_correction(
    task: PlanningTask, strings: StringBatch, conditions: RolloutConditions, trials: list[PastTrial]
) -> BiasCorrection:
    """Simulate past trials as they were, and return the simulation's errors."""
    tips = []
    for trial in trials:
        swaying = strings.with_disturbances(sway=np.tile([0.0, trial.sway_rad_s], (len(strings), 1)))
        rollouts = on_measured_joints(task, swaying, trial)
        tips.append(tip_bias(trial, rollouts.points_m[:, :, -1], task.step_s))
    return BiasCorrection(
        np.array([trial.curve.heights_rad_s for trial in trials if trial.curve is not None]),
        np.array([trial.q_rad - conditions.followed(trial.q_command_rad, task.step_s) for trial in trials]),
        np.array(tips),
    )


def on_measured_joints(task: PlanningTask, strings: StringBatch, trial: PastTrial) -> Rollouts:
    """Simulate every string on a past trial's measured joints, from the shape at its start."""
    conditions, last = RolloutConditions(start_m=trial.start_m), np.array([len(trial.q_rad) - 1])
    return simulate_rollouts(task, strings, conditions, trial.q_rad[None], last)


def tip_bias(trial: PastTrial, tips_m: np.ndarray, step_s: float) -> np.ndarray:
    """Return (K, T, 2) tracked minus simulated tip, for simulated tips (K, T, 2) every `step_s` [m].

    It is linear between the frames with a tracked tip, and held before and after. The bias is interpolated,
    not the tip: from frame to frame the tip's path bends, by millimetres where frames are lost; the bias
    hardly changes. It is zero where nothing was tracked, or the simulation of a string failed.
    """
    time_s = np.arange(tips_m.shape[1]) * step_s
    during = (trial.frame_s >= 0.0) & (trial.frame_s <= time_s[-1])
    frame_s, tracked_m = trial.frame_s[during], trial.tip_m[during]
    answer = np.zeros_like(tips_m)
    for tip_m, bias_m in zip(tips_m, answer, strict=True):
        off_m = tracked_m - resampled(frame_s, time_s, tip_m)
        known = np.isfinite(off_m).all(axis=1)
        if known.any():
            bias_m[:] = resampled(time_s, frame_s[known], off_m[known])
    return answer


def likely_miss_m(task: PlanningTask, strings: StringBatch, trial: PastTrial) -> float:
    """Return the measured miss or, where there is none, that of the best string on the same joints.

    Where the tip was tracked, the bias correction takes the simulated path to the tracked one; in between,
    the bias is interpolated.
    """
    if trial.miss_m is not None:
        return trial.miss_m
    rollouts = on_measured_joints(task, strings.take([0]), trial)
    bias_m = tip_bias(trial, rollouts.points_m[:, :, -1], task.step_s)
    if not np.isfinite(rollouts.points_m).all():
        return np.inf
    return float(simulated_miss(task.aim, rollouts.with_bias(bias_m))[0][0])


def stable_on_past_trials(task: PlanningTask, strings: StringBatch, trials: list[PastTrial]) -> np.ndarray:
    """Return (K,) whether each string can be simulated on the joints of all trials without diverging."""
    stable = np.ones(len(strings), dtype=bool)
    for trial in trials:
        points_m = on_measured_joints(task, strings, trial).points_m
        length_m = np.linalg.norm(np.diff(points_m, axis=2), axis=3)
        # A comparison with NaN is false.
        stable &= (length_m < LONGEST_SEGMENT * task.model.spacing_m).all(axis=(1, 2))
    return stable
