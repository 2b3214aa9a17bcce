"""What earlier trials taught is carried over: exactly to the same motion, partly to one between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.servo import Servo, respond
from strandcast.motion.bezier import Curve, rest_heights, sample
from strandcast.motion.earlier import Earlier, start_shape
from strandcast.motion.later import Neighbourhood, neighbourhood, throw_near, with_every_disturbance
from strandcast.motion.paths import Paths, packed, paths_of
from strandcast.motion.residual import FADING_RAD_S, alike, distance_rad_s, missed_by
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import AFTER_END_S, World, commands, throw

SLOW = Servo(np.full(3, 0.010), np.full(3, 40.0), np.full(3, 0.8), np.full(3, 0.98))


def curve(scale: float = 1.0) -> Curve:
    heights = scale * np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]])
    return Curve(np.array([0.4, -0.5, 0.3]), 0.5, rest_heights(heights))


def played(task: Task, string: Strings, motion: Curve, trial: int) -> Earlier:
    time_s, q_command, last = commands([sample(motion, task.step_s)], task.step_s)
    q = respond(SLOW, time_s, q_command)
    tip = throw(task, string, World(), q, last).points_m[0, :, -1]
    return Earlier(trial, motion, q_command[0], q[0], time_s, tip, None, 0.0, 0.1)


def near_to(task: Task, strings: Strings, trials: list[Earlier], options: Options) -> Neighbourhood:
    return neighbourhood(task, strings, World(task.arm.servo), trials[0], trials, options)


def paths(task: Task, curves: list[Curve]) -> Paths:
    return paths_of(packed(curves), task.step_s, AFTER_END_S)


def heights(curves: list[Curve]) -> np.ndarray:
    return np.array([curve.heights_rad_s for curve in curves])


@pytest.fixture(scope="module")
def unlike(strings: Strings) -> Strings:
    one = strings.take([0])
    more_drag = one.parameters * np.where(np.arange(10) == 7, 10.0, 1.0)
    return replace(one, parameters=more_drag, masses=one.masses * 0.5, curl_rad_m=np.array([3.0]))


def test_the_same_motion_is_foreseen_exactly_with_every_string(
    task: Task, strings: Strings, unlike: Strings, options: Options
) -> None:
    trial = played(task, unlike, curve(), 1)
    near = near_to(task, strings, [trial], options)
    thrown, shift = throw_near(task, near, paths(task, [curve()]), heights([curve()]))
    foreseen = thrown.points_m[:, :, -1] + shift
    np.testing.assert_allclose(foreseen, np.broadcast_to(trial.tip_m, foreseen.shape), atol=1e-9)
    # Without what is carried over the same simulation is millimetres off.
    assert np.abs(thrown.points_m[0, :, -1] - trial.tip_m).max() > 0.005


def test_of_two_trials_the_nearer_counts_more(
    task: Task, strings: Strings, unlike: Strings, options: Options
) -> None:
    trials = [played(task, unlike, curve(), 1), played(task, unlike, curve(1.2), 2)]
    near = near_to(task, strings, trials, options)
    weights = near.carried.weights(heights([curve(), curve(1.1), curve(1.15)]))
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(weights[1], [0.5, 0.5], atol=1e-6)
    assert weights[0, 0] > 0.99
    # A third of the distance: nine times the weight.
    np.testing.assert_allclose(weights[2, 1] / weights[2, 0], 9.0, rtol=0.1)


def test_what_is_carried_over_fades_with_the_distance(
    task: Task, strings: Strings, unlike: Strings, options: Options
) -> None:
    trial = played(task, unlike, curve(), 1)
    carried = near_to(task, strings, [trial], options).carried
    away = [curve(1.0 + scale / rms(curve())) for scale in (0.0, FADING_RAD_S, 3 * FADING_RAD_S)]
    np.testing.assert_allclose(carried.shares(heights(away))[:, 0], [1.0, 0.5, 0.1])
    np.testing.assert_allclose(carried.weights(heights(away))[:, 0], 1.0)


def test_the_distance_is_to_the_nearest_trial_that_is_like_it(task: Task, unlike: Strings) -> None:
    trials = [played(task, unlike, curve(), 1), played(task, unlike, curve(1.2), 2)]
    assert distance_rad_s(curve(1.15), trials) == pytest.approx(0.05 * rms(curve()))
    assert distance_rad_s(replace(curve(), duration_s=0.6), trials) == np.inf
    # How long the arm takes to stop differs with the heights.
    ramped = [replace(trial, curve=replace(curve(), ramp_s=0.12)) for trial in trials[:1]]
    assert distance_rad_s(replace(curve(1.15), ramp_s=0.14), ramped) == pytest.approx(0.15 * rms(curve()))
    assert distance_rad_s(curve(1.15), ramped) == np.inf


def rms(one: Curve) -> float:
    return float(np.sqrt(np.mean(one.heights_rad_s**2)))


def test_only_trials_of_the_same_posture_and_time_are_alike(
    task: Task, strings: Strings, unlike: Strings
) -> None:
    best = played(task, unlike, curve(), 1)
    longer = replace(best, curve=replace(curve(), duration_s=0.6))
    elsewhere = replace(best, curve=replace(curve(), q0_rad=np.array([0.4, -0.5, 0.31])))
    assert alike([best, longer, elsewhere, replace(best, curve=None)], curve()) == [best]


def seen_tip(seen_s: np.ndarray, tip_m: np.ndarray) -> Earlier:
    return Earlier(1, None, np.zeros((0, 3)), np.zeros((0, 3)), seen_s, tip_m, None, 0.0, None)


def circled(time_s: np.ndarray) -> np.ndarray:
    """Return a tip on a circle of 0.2 m at 6 m/s, which frames at 250 Hz see bend by 0.4 mm between two."""
    return 0.2 * np.stack([np.cos(30.0 * time_s), np.sin(30.0 * time_s)], axis=1)


def test_what_was_missed_by_is_known_between_frames_where_the_path_bends() -> None:
    time_s, seen_s = np.arange(0.0, 0.2, 1e-3), np.arange(-0.01, 0.25, 0.004)
    tip = circled(seen_s) + np.array([0.003, -0.002])
    tip[20:24] = np.nan
    missed = missed_by(seen_tip(seen_s, tip), circled(time_s)[None], 1e-3)
    # The simulated path is itself straight between its samples: 0.02 mm.
    np.testing.assert_allclose(missed[0], np.broadcast_to([0.003, -0.002], (200, 2)), atol=3e-5)


def test_what_was_missed_by_is_linear_between_frames_and_held_at_the_ends() -> None:
    tip = np.full((6, 2), np.nan)
    tip[2], tip[4] = [1.0, 2.0], [3.0, 6.0]
    seen_s = np.arange(-1.0, 5.0)  # the first frame was before the start
    missed = missed_by(seen_tip(seen_s, tip), np.zeros((1, 5, 2)), 1.0)
    np.testing.assert_array_equal(missed[0, :, 1], [2.0, 2.0, 4.0, 6.0, 6.0])


def test_nothing_seen_or_simulated_carries_nothing() -> None:
    seen_s, tips = np.arange(5.0), np.zeros((2, 5, 2))
    np.testing.assert_array_equal(missed_by(seen_tip(seen_s, np.full((5, 2), np.nan)), tips, 1.0), 0.0)
    tips[1] = np.nan
    missed = missed_by(seen_tip(seen_s, np.ones((5, 2))), tips, 1.0)
    np.testing.assert_array_equal(missed, np.stack([np.ones((5, 2)), np.zeros((5, 2))]))


def test_the_start_is_the_mean_before_it_or_unknown() -> None:
    seen_s = np.array([-0.1, -0.04, -0.02, 0.01])
    points = np.zeros((4, 2, 2))
    points[:, 0, 0] = [9.0, 1.0, 3.0, 9.0]
    points[1, 1] = np.nan
    np.testing.assert_allclose(start_shape(seen_s, points), [[2.0, 0.0], [0.0, 0.0]])
    points[2, 1] = np.nan
    assert start_shape(seen_s, points) is None


def test_every_disturbance_keeps_what_is_carried_over_to_its_string(
    task: Task, strings: Strings, unlike: Strings, options: Options
) -> None:
    trial = played(task, unlike, curve(), 1)
    near = near_to(task, strings, [trial], options)
    every = with_every_disturbance(task, near, options)
    assert len(every.strings) == 16 * len(strings)
    for k in (0, 1, 15, 17, 40, 47):
        np.testing.assert_array_equal(every.carried.tip_m[:, k], near.carried.tip_m[:, k // 16])
        np.testing.assert_array_equal(every.strings.parameters[k], strings.parameters[k // 16])


def test_without_the_residual_the_simulation_is_left_as_it_is(
    task: Task, strings: Strings, unlike: Strings, options: Options
) -> None:
    trial = played(task, unlike, curve(), 1)
    near = near_to(task, strings, [trial], replace(options, carry_residual=False))
    _, shift = throw_near(task, near, paths(task, [curve()]), heights([curve()]))
    np.testing.assert_array_equal(shift, 0.0)
