"""Simulate many motions with many strings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from strandcast.arm.yielding_joints import JointResponse, follow
from strandcast.core.strings import StringBatch
from strandcast.core.trajectory import JointTrajectory
from strandcast.dynamics.batch import HandPath, StringStart
from strandcast.dynamics.simulate import simulate_batch
from strandcast.planning.approach import closest_approaches
from strandcast.planning.bezier import Curve, sample
from strandcast.planning.paths import JointPaths
from strandcast.planning.task import PlanningTask
from strandcast.records.verdict import AFTER_MOTION_S

# The miss's window ends this long after the motion, as the scorer's: the tip may arrive after the arm stops.
AFTER_END_S = AFTER_MOTION_S

Miss = tuple[np.ndarray, np.ndarray]  # (B,) by how much each rollout misses [m], (B,) at which sample


@dataclass(frozen=True, eq=False)
class RolloutConditions:
    """What rollouts have in common besides the strings.

    Attributes
    ----------
    servo
        Response of the joints, None where they follow exactly.
    start_m
        (n, 2 or 3) where the string's points 1…n are at the start [m], None for hanging at rest.
    """

    servo: JointResponse | None = None
    start_m: np.ndarray | None = None

    def followed(self, q_command: np.ndarray, step_s: float) -> np.ndarray:
        """Return the angles (..., T, J) that the joints take on commands every `step_s` [rad]."""
        if self.servo is None:
            return q_command
        return follow(self.servo, np.arange(q_command.shape[-2]) * step_s, q_command)


class Rollouts(NamedTuple):
    """P motions simulated with K strings each: B = P * K rollouts, motion by motion.

    Attributes
    ----------
    points_m
        (B, T, n+1, 2 or 3) hand and string [m], NaN from where a simulation failed.
    tip_bias_m
        (B, T, 2 or 3) bias correction of the tip, zero if there is none [m].
    last
        (B,) last sample of each rollout's window, which starts with its motion.
    step_s, spacing_m
        Time between samples; rest length of a segment.
    capsules_m
        (P, T, S, 2, 2 or 3) ends of the arm's capsules [m].
    """

    points_m: np.ndarray
    tip_bias_m: np.ndarray
    last: np.ndarray
    step_s: float
    spacing_m: float
    capsules_m: np.ndarray

    def tip_m(self) -> np.ndarray:
        """Return the tip's path (B, T, 2), with its bias correction [m]."""
        return np.asarray(self.points_m[:, :, -1] + self.tip_bias_m)

    def place_m(self, along_m: float) -> np.ndarray:
        """Return the path (B, T, 2) of a place on the string, from the hand on; at its end, the tip's."""
        count = self.points_m.shape[2] - 1
        if along_m >= (count - 1e-6) * self.spacing_m:
            return self.tip_m()
        before, share = divmod(max(along_m, 0.0) / self.spacing_m, 1.0)
        ends = self.points_m[:, :, int(before)], self.points_m[:, :, int(before) + 1]
        return np.asarray((1.0 - share) * ends[0] + share * ends[1])

    def nearest(self, path_m: np.ndarray, target_m: np.ndarray | tuple[float, ...]) -> Miss:
        """Return how near paths (B, T, 2 or 3) come to a place, between the samples too, and when."""
        return closest_approaches(path_m, self.last, np.asarray(target_m, float))

    def least(self, values: np.ndarray) -> Miss:
        """Return the least of values (B, T) within each rollout's window, and its sample."""
        within = np.arange(values.shape[1]) <= self.last[:, None]
        index = np.argmin(np.where(within, values, np.inf), axis=1)
        return np.take_along_axis(values, index[:, None], axis=1)[:, 0], index

    def with_bias(self, tip_bias_m: np.ndarray) -> Rollouts:
        """Return the rollouts with another bias correction (B, T, 2) of the tip [m]."""
        return self._replace(tip_bias_m=np.ascontiguousarray(tip_bias_m))


def commands(motions: list[JointTrajectory], step_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time (T,), commanded angles (P, T, J), held at the end, the last sample of each window (P,)."""
    after = round(AFTER_END_S / step_s)
    ends = np.array([len(motion.time_s) for motion in motions])
    count = int(ends.max()) + after
    q = np.empty((len(motions), count, motions[0].q_rad.shape[1]))
    for p, motion in enumerate(motions):
        q[p, : ends[p]] = motion.q_rad
        q[p, ends[p] :] = motion.q_rad[-1]
    return np.arange(count) * step_s, q, ends - 1 + after


def simulate_rollouts(
    task: PlanningTask, strings: StringBatch, conditions: RolloutConditions, q: np.ndarray, last: np.ndarray
) -> Rollouts:
    """Simulate joint paths with every string.

    Parameters
    ----------
    q
        (P, T, J) angles that the joints take [rad].
    last
        (P,) last sample of each window.
    """
    time_s = np.arange(q.shape[1], dtype=np.float64) * task.step_s
    zeros = strings.disturbances.joint_zero_rad
    if not zeros.size:
        zeros = np.zeros((len(strings), q.shape[2]))
    longer_m = strings.disturbances.longer_m
    q = np.ascontiguousarray(q)
    poses = task.arm.hand_poses(q, np.ascontiguousarray(zeros), np.ascontiguousarray(longer_m))
    every = strings.take(np.tile(np.arange(len(strings)), len(q)))
    hand = HandPath(time_s, poses)
    points, _ = simulate_batch(task.model, every, hand, time_s, StringStart(conditions.start_m))
    no_bias = np.zeros((*points.shape[:2], points.shape[3]))
    windows = np.repeat(last, len(points) // len(last))
    return Rollouts(points, no_bias, windows, task.step_s, task.model.spacing_m, task.arm.capsules(q))


def rollouts_of_curves(
    task: PlanningTask, strings: StringBatch, conditions: RolloutConditions, curves: list[Curve]
) -> Rollouts:
    """Simulate motions, the servo's response included, with every string."""
    _, q, last = commands([sample(curve, task.step_s) for curve in curves], task.step_s)
    return simulate_rollouts(task, strings, conditions, conditions.followed(q, task.step_s), last)


def rollouts_of_paths(
    task: PlanningTask, strings: StringBatch, conditions: RolloutConditions, paths: JointPaths
) -> Rollouts:
    """Simulate motions side by side, sampled until the end of the miss's window, with every string."""
    q, last = conditions.followed(paths.q, task.step_s), paths.last + round(AFTER_END_S / task.step_s)
    return simulate_rollouts(task, strings, conditions, q, last)
