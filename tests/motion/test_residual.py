"""What earlier trials taught is carried over: exactly to the same motion, partly to one between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.servo import Servo, respond
from strandcast.motion.bezier import Curve, rest_heights, sample
from strandcast.motion.earlier import Earlier, start_shape, tip_path
from strandcast.motion.later import neighbourhood, throw_near
from strandcast.motion.residual import alike, filled
from strandcast.motion.strings import Strings, regrasped
from strandcast.motion.task import Task
from strandcast.motion.throws import World, commands, throw

SLOW = Servo(np.full(3, 0.010), np.full(3, 40.0), np.full(3, 0.8), np.full(3, 0.98))


def curve(scale: float = 1.0) -> Curve:
    heights = scale * np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]])
    return Curve(np.array([0.4, -0.5, 0.3]), 0.5, rest_heights(heights))


def played(task: Task, string: Strings, motion: Curve, trial: int) -> Earlier:
    time_s, q_command, last = commands([sample(motion, task.step_s)], task.step_s)
    q = respond(SLOW, time_s, q_command)
    tip = throw(task, string, World(), q, last).points_m[0, :, -1]
    return Earlier(trial, motion, q_command[0], q[0], tip, None, 0.1)


@pytest.fixture(scope="module")
def unlike(strings: Strings) -> Strings:
    one = strings.take([0])
    more_drag = one.parameters * np.where(np.arange(10) == 7, 10.0, 1.0)
    return replace(one, parameters=more_drag, masses=one.masses * 0.5, curl_rad_m=np.array([3.0]))


def test_the_same_motion_is_foreseen_exactly_with_every_string(
    task: Task, strings: Strings, unlike: Strings
) -> None:
    trial = played(task, unlike, curve(), 1)
    near = neighbourhood(task, strings, World(task.arm.servo), trial, [trial])
    thrown, shift = throw_near(task, near, [curve()])
    foreseen = thrown.points_m[:, :, -1] + shift
    np.testing.assert_allclose(foreseen, np.broadcast_to(trial.tip_m, foreseen.shape), atol=1e-9)
    # Without what is carried over the same simulation is millimetres off.
    assert np.abs(thrown.points_m[0, :, -1] - trial.tip_m).max() > 0.005


def test_of_two_trials_the_nearer_counts_more(task: Task, strings: Strings, unlike: Strings) -> None:
    trials = [played(task, unlike, curve(), 1), played(task, unlike, curve(1.2), 2)]
    near = neighbourhood(task, strings, World(task.arm.servo), trials[0], trials)
    weights = near.carried.weights([curve(), curve(1.1), curve(1.15)])
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(weights[1], [0.5, 0.5], atol=1e-6)
    assert weights[0, 0] > 0.99
    # A third of the distance: nine times the weight.
    np.testing.assert_allclose(weights[2, 1] / weights[2, 0], 9.0, rtol=0.1)


def test_only_trials_of_the_same_posture_and_time_are_alike(
    task: Task, strings: Strings, unlike: Strings
) -> None:
    best = played(task, unlike, curve(), 1)
    longer = replace(best, curve=replace(curve(), duration_s=0.6))
    elsewhere = replace(best, curve=replace(curve(), q0_rad=np.array([0.4, -0.5, 0.31])))
    assert alike([best, longer, elsewhere, replace(best, curve=None)], best) == [best]


def test_gaps_are_filled_in_time_and_nothing_known_carries_nothing() -> None:
    residual = np.full((2, 5, 2), np.nan)
    residual[0, 1], residual[0, 3] = [1.0, 2.0], [3.0, 6.0]
    np.testing.assert_array_equal(filled(residual)[0, :, 1], [2.0, 2.0, 4.0, 6.0, 6.0])
    np.testing.assert_array_equal(filled(residual)[1], 0.0)


def test_a_tip_unseen_for_long_is_not_made_up() -> None:
    seen_s = np.arange(0.0, 0.1, 0.002)
    tip = np.stack([seen_s, 2.0 * seen_s], axis=1)
    tip[10:14] = np.nan
    tip[20:45] = np.nan
    path = tip_path(seen_s, seen_s, tip)
    np.testing.assert_allclose(path[10:14], np.stack([seen_s, 2.0 * seen_s], axis=1)[10:14])
    assert np.isnan(path[21:44]).all()
    assert np.isnan(tip_path(seen_s, seen_s, np.full_like(tip, np.nan))).all()


def test_the_start_is_the_mean_before_it_or_unknown() -> None:
    seen_s = np.array([-0.1, -0.04, -0.02, 0.01])
    points = np.zeros((4, 2, 2))
    points[:, 0, 0] = [9.0, 1.0, 3.0, 9.0]
    points[1, 1] = np.nan
    np.testing.assert_allclose(start_shape(seen_s, points), [[2.0, 0.0], [0.0, 0.0]])
    points[2, 1] = np.nan
    assert start_shape(seen_s, points) is None


def test_regrasped_strings_hang_out_further_and_are_turned(task: Task, strings: Strings) -> None:
    other = regrasped(strings, np.random.default_rng(0))
    assert np.abs(other.clamp_offset_rad).max() < 0.3
    longer = replace(strings.take([0]), longer_m=np.array([0.01]))
    q = np.tile([0.0, 0.0, 0.0], (1, 50, 1))
    one, two = (throw(task, s, World(), q, np.array([49])).points_m[0] for s in (strings.take([0]), longer))
    np.testing.assert_allclose(two[0] - one[0], np.tile([0.01, 0.0], (11, 1)), atol=1e-9)
