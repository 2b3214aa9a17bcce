"""Search for a later motion: small changes around the best past trial, with bias correction."""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from strandcast.config.plan import PlanSettings
from strandcast.core.strings import StringBatch
from strandcast.planning.bezier import Curve
from strandcast.planning.bias_correction import BiasCorrection, bias_correction, comparable
from strandcast.planning.motion_descent import (
    HEIGHT_RAD_S,
    MotionResiduals,
    descend_motion,
    rollout_residuals,
)
from strandcast.planning.past_trials import PastTrial
from strandcast.planning.paths import JointPaths, paths_of_any
from strandcast.planning.rollouts import AFTER_END_S, RolloutConditions, Rollouts, simulate_rollouts
from strandcast.planning.scenarios import STRINGS, crossed, disturbed
from strandcast.planning.task import PlanningTask

CHANGE_COST_M_S_RAD = 0.008  # price of changing the heights [m per rad/s rms]; chosen
SAME_SHAPE_M = 0.003  # rms, between the shape at the start and the model's at rest; the tracker's accuracy


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """The curve of the best past trial, and the strings, conditions and bias correction near it."""

    best: Curve
    strings: StringBatch
    conditions: RolloutConditions
    bias: BiasCorrection


def neighbourhood(
    task: PlanningTask,
    strings: StringBatch,
    conditions: RolloutConditions,
    best: PastTrial,
    trials: list[PastTrial],
) -> Neighbourhood:
    """Return the neighbourhood of the best trial.

    Parameters
    ----------
    conditions
        With the servo's response, if there is to be one.
    best, trials
        The best trial, which has a curve, and all.
    """
    assert best.curve is not None
    bias = bias_correction(task, strings, conditions, comparable(trials, best.curve))
    conditions = replace(conditions, start_m=settled(task, strings, best))
    return Neighbourhood(best.curve, strings, conditions, bias)


def with_every_disturbance(task: PlanningTask, near: Neighbourhood, sizes: np.ndarray) -> Neighbourhood:
    """Return it with every string under every disturbance; each keeps its string's bias correction."""
    strings = crossed(near.strings, len(task.arm.joints), sizes)
    return _with_strings(near, strings, np.arange(len(strings)) * len(near.strings) // len(strings))


def disturbed_near(task: PlanningTask, near: Neighbourhood, sizes: np.ndarray) -> Neighbourhood:
    """Return it with as many strings as a search has, those given in turn, each with other disturbances."""
    strings = disturbed(near.strings, STRINGS, len(task.arm.joints), sizes)
    return _with_strings(near, strings, np.arange(len(strings)) % len(near.strings))


def _with_strings(near: Neighbourhood, strings: StringBatch, member: np.ndarray) -> Neighbourhood:
    """Return it with strings made from its `member`s, and their bias correction."""
    return replace(near, strings=strings, bias=replace(near.bias, tip_m=near.bias.tip_m[:, member]))


def settled(task: PlanningTask, strings: StringBatch, trial: PastTrial) -> np.ndarray | None:
    """Return the shape (n, 2 or 3) with which motions like a trial's start [m]; None: the model's own.

    How a string sways differs from throw to throw, so the trial's shape is turned about the hand to where it
    hangs at rest. The model's own shape is used where it is as near as the tracker can resolve.
    """
    if trial.start_m is None:
        return None
    # Not the commanded posture: a soft servo sags from it.
    resting = np.tile(trial.q_rad[0], (1, 2, 1))
    at_rest = simulate_rollouts(task, strings.first(1), RolloutConditions(), resting, np.array([1]))
    shape = at_rest.points_m[0, 0]
    rest, was = shape[1:] - shape[0], trial.start_m - shape[0]
    turned = _turned_to(rest, was)
    off_m = float(np.sqrt(np.mean(((turned - rest) ** 2).sum(axis=1))))
    return None if off_m < SAME_SHAPE_M else np.asarray(turned + shape[0])


def _turned_to(rest: np.ndarray, was: np.ndarray) -> np.ndarray:
    """Return points (n, 2 or 3), turned about the origin to where they are nearest to others."""
    if was.shape[1] == 3:
        return np.asarray(scipy.spatial.transform.Rotation.align_vectors(rest, was)[0].apply(was))
    turn = np.arctan2((was[:, 0] * rest[:, 1] - was[:, 1] * rest[:, 0]).sum(), (was * rest).sum())
    cos, sin = np.cos(turn), np.sin(turn)
    return np.asarray(was @ np.array([[cos, sin], [-sin, cos]]))


def rollouts_near(
    task: PlanningTask, near: Neighbourhood, paths: JointPaths, heights: np.ndarray
) -> Rollouts:
    """Simulate P motions with every string, with bias correction of joints and tip.

    Parameters
    ----------
    paths, heights
        The commanded angles and the control heights (P, J, H) of motions as long as the best one.
    """
    q = near.conditions.followed(paths.q, task.step_s)
    q = q + np.einsum("pn,ntj->ptj", near.bias.weights(heights), near.bias.joints_rad)
    last = paths.last + round(AFTER_END_S / task.step_s)
    rollouts = simulate_rollouts(task, near.strings, near.conditions, q, last)
    bias_m = np.einsum("pn,nktx->pktx", near.bias.tip_weights(heights), near.bias.tip_m)
    return rollouts.with_bias(bias_m.reshape(-1, *bias_m.shape[2:]))


def search_near(task: PlanningTask, near: Neighbourhood, settings: PlanSettings) -> tuple[Curve, int]:
    """Return the cheapest motion near the best trial, and the number of rollouts."""
    task, best = task.rough(), near.best
    inner = slice(2, -2) if not best.ramp_s else slice(1, None)
    shape = best.heights_rad_s[:, inner].shape

    def curve(units: np.ndarray) -> Curve:
        heights = best.heights_rad_s.copy()
        heights[:, inner] += units.reshape(shape) * HEIGHT_RAD_S
        return replace(best, heights_rad_s=heights)

    def residuals(points: np.ndarray) -> MotionResiduals:
        curves = [curve(units) for units in points]
        paths = paths_of_any(curves, task.step_s, AFTER_END_S, task.dynamics)
        rollouts = rollouts_near(task, near, paths, np.array([c.heights_rad_s for c in curves]))
        found = rollout_residuals(task, rollouts, paths, len(near.strings), stops=True)
        change = CHANGE_COST_M_S_RAD * HEIGHT_RAD_S * points / np.sqrt(points.shape[1])
        cost_m = found.cost_m + np.linalg.norm(change, axis=1)
        return MotionResiduals(np.hstack([found.parts_m, change]), cost_m)

    start = np.zeros(np.prod(shape))
    units, _, tried = descend_motion(residuals, start, len(start), 2 * settings.evaluations // 3)
    return curve(units), tried * len(near.strings)
