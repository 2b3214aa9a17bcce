"""Bias correction: exact for the same motion, weighted for one between past trials."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.servo import Servo, respond
from strandcast.core.disturbances import TYPICAL_SIZES
from strandcast.core.strings import StringBatch
from strandcast.planning.bezier import Curve, rest_heights, sample
from strandcast.planning.bias_correction import HALF_LEFT_RAD_S, comparable, distance_rad_s, tip_bias
from strandcast.planning.local_search import (
    Neighbourhood,
    neighbourhood,
    rollouts_near,
    with_every_disturbance,
)
from strandcast.planning.past_trials import PastTrial, start_shape
from strandcast.planning.paths import JointPaths, packed, paths_of
from strandcast.planning.rollouts import AFTER_END_S, RolloutConditions, commands, simulate_rollouts
from strandcast.planning.task import PlanningTask

SLOW = Servo(np.full(3, 0.010), np.full(3, 40.0), np.full(3, 0.8), np.full(3, 0.98))


def curve(scale: float = 1.0) -> Curve:
    heights = scale * np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]])
    return Curve(np.array([0.4, -0.5, 0.3]), 0.5, rest_heights(heights))


def played(task: PlanningTask, string: StringBatch, motion: Curve, trial: int) -> PastTrial:
    time_s, q_command, last = commands([sample(motion, task.step_s)], task.step_s)
    q = respond(SLOW, time_s, q_command)
    tip = simulate_rollouts(task, string, RolloutConditions(), q, last).points_m[0, :, -1]
    return PastTrial(trial, motion, q_command[0], q[0], time_s, tip, None, 0.0, 0.1)


def near_to(task: PlanningTask, strings: StringBatch, trials: list[PastTrial]) -> Neighbourhood:
    return neighbourhood(task, strings, RolloutConditions(task.arm.servo), trials[0], trials)


def paths(task: PlanningTask, curves: list[Curve]) -> JointPaths:
    return paths_of(packed(curves), task.step_s, AFTER_END_S)


def heights(curves: list[Curve]) -> np.ndarray:
    return np.array([curve.heights_rad_s for curve in curves])


@pytest.fixture(scope="module")
def unlike(strings: StringBatch) -> StringBatch:
    one = strings.take([0])
    more_drag = one.parameters * np.where(np.arange(10) == 7, 10.0, 1.0)
    curled = one.with_values(rest_curl_rad_m=np.array([3.0]))
    return replace(curled, parameters=more_drag, masses=one.masses * 0.5)


def test_the_same_motion_is_predicted_exactly_with_every_string(
    task: PlanningTask, strings: StringBatch, unlike: StringBatch
) -> None:
    trial = played(task, unlike, curve(), 1)
    near = near_to(task, strings, [trial])
    rollouts = rollouts_near(task, near, paths(task, [curve()]), heights([curve()]))
    predicted = rollouts.tip_m()
    np.testing.assert_allclose(predicted, np.broadcast_to(trial.tip_m, predicted.shape), atol=1e-9)
    # Without bias correction the same simulation is millimetres off.
    assert np.abs(rollouts.points_m[0, :, -1] - trial.tip_m).max() > 0.005


def test_of_two_trials_the_nearer_counts_more(
    task: PlanningTask, strings: StringBatch, unlike: StringBatch
) -> None:
    trials = [played(task, unlike, curve(), 1), played(task, unlike, curve(1.2), 2)]
    near = near_to(task, strings, trials)
    weights = near.bias.weights(heights([curve(), curve(1.1), curve(1.15)]))
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(weights[1], [0.5, 0.5], atol=1e-6)
    assert weights[0, 0] > 0.99
    # A third of the distance: nine times the weight.
    np.testing.assert_allclose(weights[2, 1] / weights[2, 0], 9.0, rtol=0.1)


def test_the_bias_correction_fades_with_the_distance(
    task: PlanningTask, strings: StringBatch, unlike: StringBatch
) -> None:
    trial = played(task, unlike, curve(), 1)
    bias = near_to(task, strings, [trial]).bias
    away = [curve(1.0 + scale / rms(curve())) for scale in (0.0, HALF_LEFT_RAD_S, 3 * HALF_LEFT_RAD_S)]
    np.testing.assert_allclose(bias.tip_weights(heights(away))[:, 0], [1.0, 0.5, 0.1])
    np.testing.assert_allclose(bias.weights(heights(away))[:, 0], 1.0)


def test_the_distance_is_to_the_nearest_trial_that_is_like_it(
    task: PlanningTask, unlike: StringBatch
) -> None:
    trials = [played(task, unlike, curve(), 1), played(task, unlike, curve(1.2), 2)]
    assert distance_rad_s(curve(1.15), trials) == pytest.approx(0.05 * rms(curve()))
    assert distance_rad_s(replace(curve(), duration_s=0.6), trials) == np.inf
    # How long the arm takes to stop differs with the heights.
    ramped = [replace(trial, curve=replace(curve(), ramp_s=0.12)) for trial in trials[:1]]
    assert distance_rad_s(replace(curve(1.15), ramp_s=0.14), ramped) == pytest.approx(0.15 * rms(curve()))
    assert distance_rad_s(curve(1.15), ramped) == np.inf


def rms(one: Curve) -> float:
    return float(np.sqrt(np.mean(one.heights_rad_s**2)))


def test_only_trials_of_the_same_posture_and_time_are_comparable(
    task: PlanningTask, strings: StringBatch, unlike: StringBatch
) -> None:
    best = played(task, unlike, curve(), 1)
    longer = replace(best, curve=replace(curve(), duration_s=0.6))
    elsewhere = replace(best, curve=replace(curve(), q0_rad=np.array([0.4, -0.5, 0.31])))
    assert comparable([best, longer, elsewhere, replace(best, curve=None)], curve()) == [best]


def tracked_tip(frame_s: np.ndarray, tip_m: np.ndarray) -> PastTrial:
    return PastTrial(1, None, np.zeros((0, 3)), np.zeros((0, 3)), frame_s, tip_m, None, 0.0, None)


def circled(time_s: np.ndarray) -> np.ndarray:
    """Return a tip on a circle of 0.2 m at 6 m/s, whose path bends by 0.4 mm between two frames at 250 Hz."""
    return 0.2 * np.stack([np.cos(30.0 * time_s), np.sin(30.0 * time_s)], axis=1)


def test_the_tip_bias_is_interpolated_where_the_path_bends_between_frames() -> None:
    time_s, frame_s = np.arange(0.0, 0.2, 1e-3), np.arange(-0.01, 0.25, 0.004)
    tip = circled(frame_s) + np.array([0.003, -0.002])
    tip[20:24] = np.nan
    bias = tip_bias(tracked_tip(frame_s, tip), circled(time_s)[None], 1e-3)
    # The simulated path is itself straight between its samples: 0.02 mm.
    np.testing.assert_allclose(bias[0], np.broadcast_to([0.003, -0.002], (200, 2)), atol=3e-5)


def test_the_tip_bias_is_linear_between_frames_and_held_at_the_ends() -> None:
    tip = np.full((6, 2), np.nan)
    tip[2], tip[4] = [1.0, 2.0], [3.0, 6.0]
    frame_s = np.arange(-1.0, 5.0)  # the first frame was before the start
    bias = tip_bias(tracked_tip(frame_s, tip), np.zeros((1, 5, 2)), 1.0)
    np.testing.assert_array_equal(bias[0, :, 1], [2.0, 2.0, 4.0, 6.0, 6.0])


def test_no_bias_where_nothing_was_tracked_or_simulated() -> None:
    frame_s, tips = np.arange(5.0), np.zeros((2, 5, 2))
    np.testing.assert_array_equal(tip_bias(tracked_tip(frame_s, np.full((5, 2), np.nan)), tips, 1.0), 0.0)
    tips[1] = np.nan
    bias = tip_bias(tracked_tip(frame_s, np.ones((5, 2))), tips, 1.0)
    np.testing.assert_array_equal(bias, np.stack([np.ones((5, 2)), np.zeros((5, 2))]))


def test_the_start_is_the_mean_before_it_or_unknown() -> None:
    frame_s = np.array([-0.1, -0.04, -0.02, 0.01])
    points = np.zeros((4, 2, 2))
    points[:, 0, 0] = [9.0, 1.0, 3.0, 9.0]
    points[1, 1] = np.nan
    np.testing.assert_allclose(start_shape(frame_s, points), [[2.0, 0.0], [0.0, 0.0]])
    points[2, 1] = np.nan
    assert start_shape(frame_s, points) is None


def test_every_disturbance_keeps_its_strings_bias(
    task: PlanningTask, strings: StringBatch, unlike: StringBatch
) -> None:
    trial = played(task, unlike, curve(), 1)
    near = near_to(task, strings, [trial])
    every = with_every_disturbance(task, near, TYPICAL_SIZES)
    assert len(every.strings) == 16 * len(strings)
    for k in (0, 1, 15, 17, 40, 47):
        np.testing.assert_array_equal(every.bias.tip_m[:, k], near.bias.tip_m[:, k // 16])
        np.testing.assert_array_equal(every.strings.parameters[k], strings.parameters[k // 16])
