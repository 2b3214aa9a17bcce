"""What the planner knows of a rig's scatter: near the prior with few trials, the truth with many."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.servo import Servo, respond
from strandcast.config.plan import PlanSettings
from strandcast.core.disturbances import DISTURBING, TYPICAL_SIZES
from strandcast.core.strings import StringBatch
from strandcast.planning.bezier import Curve, rest_heights, sample
from strandcast.planning.deviations import trial_deviations
from strandcast.planning.past_trials import Measured, PastTrial
from strandcast.planning.plan import plan_first
from strandcast.planning.rig_scatter import (
    SizePrior,
    TrialDeviations,
    drawn_sizes,
    learnt_sizes,
    prior_of,
    size_posterior,
)
from strandcast.planning.rollouts import RolloutConditions, commands, simulate_rollouts
from strandcast.planning.task import PlanningTask

PRIOR = SizePrior(median=0.01, factor=2.0)
LEARNS = PlanSettings(disturbances="learnt", ensemble=8)


def posterior(values: list[float], error: float = 0.0, *, about_mean: bool = False) -> float:
    column = np.array(values).reshape(-1, 1)
    return float(
        size_posterior(PRIOR, column, np.full_like(column, error), about_mean=about_mean).quantile(0.5)
    )


def test_without_trials_the_size_is_the_priors() -> None:
    prior = prior_of(PRIOR)
    np.testing.assert_allclose(
        prior.quantile(np.array([0.1587, 0.5, 0.8413])), [0.005, 0.01, 0.02], rtol=2e-3
    )
    # E sigma^2 of a logarithmic normal distribution.
    np.testing.assert_allclose(prior.rms, 0.01 * np.exp(np.log(2.0) ** 2), rtol=2e-3)


def test_few_trials_move_it_a_little_and_many_to_the_truth() -> None:
    random = np.random.default_rng(1)
    drawn = random.standard_normal(400)
    drawn *= 0.03 / drawn.std()
    assert 0.01 < posterior([0.03]) < posterior([0.03, -0.03]) < 0.03
    np.testing.assert_allclose(posterior(drawn.tolist()), 0.03, rtol=0.02)
    np.testing.assert_allclose(posterior((5.0 + drawn).tolist(), about_mean=True), 0.03, rtol=0.02)


def test_a_common_offset_is_no_scatter_and_one_trial_shows_none() -> None:
    np.testing.assert_allclose(posterior([7.0], about_mean=True), 0.01, rtol=1e-3)
    assert posterior([7.0, 7.0, 7.0], about_mean=True) < 0.008
    assert posterior([7.0, 7.0, 7.0]) > 0.1


def test_what_is_measured_badly_teaches_little() -> None:
    assert abs(posterior([0.05, -0.05], error=0.05) - 0.01) < 0.2 * abs(posterior([0.05, -0.05]) - 0.01)


def seen(trial: int, length_m: float, rate: float = 0.0) -> TrialDeviations:
    values = {"grasp_length_m": np.array([length_m]), "sway_rad_s": np.array([rate])}
    return TrialDeviations(trial, values, {name: np.array([1e-4]) for name in values})


def test_sizes_are_drawn_with_the_mean_square_of_the_posterior() -> None:
    trials = [seen(1, 0.300, 0.2), seen(2, 0.312, -0.3), seen(3, 0.290, 0.25)]
    before, after = drawn_sizes(LEARNS, []), drawn_sizes(LEARNS, trials)
    assert before.shape == after.shape == (8, 5)
    known = {one.quantity: one.posterior.rms for one in learnt_sizes(LEARNS, trials)}
    np.testing.assert_allclose(np.sqrt((after**2).mean(axis=0)), [known[name] for name in DISTURBING])
    # Learnt: the length and the rate of sway; nothing was seen of the others.
    grown = np.sqrt((after**2).mean(axis=0) / (before**2).mean(axis=0))
    assert (grown[[1, 3]] > 1.7).all()
    np.testing.assert_allclose(grown[[0, 2, 4]], 1.0)
    # Not knowing the size is part of the draws: they differ from string to string, in another order for each.
    assert (np.ptp(np.log(before), axis=0) > 1.0).all()
    assert len({tuple(np.argsort(column)) for column in before.T}) == 5


def test_a_number_is_a_scale_of_a_typical_rig_whatever_was_seen() -> None:
    fixed = drawn_sizes(PlanSettings(disturbances=0.5), [seen(1, 0.3, 9.0)])
    np.testing.assert_array_equal(fixed, 0.5 * TYPICAL_SIZES)


def test_slips_and_drifts_are_named() -> None:
    def warned(*lengths_m: float) -> list[str]:
        trials = [seen(k, length_m) for k, length_m in enumerate(lengths_m, start=1)]
        return [words for one in learnt_sizes(LEARNS, trials) for words in one.warnings()]

    assert warned(0.300, 0.301, 0.2995, 0.3005) == []
    assert any("grasp_length_m: trial 3 is" in words for words in warned(0.300, 0.301, 0.320, 0.300))
    assert warned(0.300, 0.301, 0.302, 0.3031) == ["grasp_length_m: drifts from trial to trial"]


def test_predictions_are_as_wide_as_the_rig_scatters(task: PlanningTask, strings: StringBatch) -> None:
    settings = PlanSettings(
        screening=64, evaluations=200, ensemble=3, disturbances="learnt", mesh_refinement=False
    )

    def rms_m(sizes: np.ndarray | None) -> float:
        plan = plan_first(task, strings, settings, np.random.default_rng(3), sizes)
        return float(np.sqrt(np.mean(plan.throws.miss_m**2)))

    wild = [seen(k, 0.3 + 0.02 * (-1) ** k, 0.8 * (-1) ** k) for k in range(1, 6)]
    assert rms_m(None) == rms_m(drawn_sizes(settings, []))
    assert rms_m(drawn_sizes(settings, wild)) > 1.3 * rms_m(drawn_sizes(settings, []))


def curve() -> Curve:
    heights = np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]])
    return Curve(np.array([0.4, -0.5, 0.3]), 0.5, rest_heights(heights))


ZEROS_RAD = np.array([0.002, -0.003, 0.0])
SERVO = Servo(np.full(3, 0.010), np.full(3, 80.0), np.full(3, 0.8), np.ones(3))


@pytest.fixture(scope="module")
def measured(task: PlanningTask, strings: StringBatch) -> tuple[PastTrial, Measured]:
    """A throw whose string is longer and sways, with joints whose zeros, travel and lag are wrong."""
    time_s, command, _ = commands([sample(curve(), task.step_s)], task.step_s)
    expected = respond(SERVO, time_s, command)[0]
    slower = np.stack([np.interp(time_s - 0.002, time_s, joint) for joint in expected.T], axis=1)
    q_rad = slower[0] + 1.01 * (slower - slower[0])
    still = np.arange(-60, 0) * 0.002
    frame_s = np.concatenate([still, time_s])
    angles = np.concatenate([np.tile(q_rad[0], (len(still), 1)), q_rad])
    last = np.array([1])
    resting = np.tile(q_rad[0], (1, 2, 1))
    shape = simulate_rollouts(task, strings.first(1), RolloutConditions(), resting, last).points_m[0, 0]
    turn = 0.02 + 0.1 * (frame_s + 0.06)
    away = 1.01 * (shape[1:] - shape[0])
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    swayed = np.stack([cos * away[:, 0] - sin * away[:, 1], sin * away[:, 0] + cos * away[:, 1]], axis=2)
    true_hand_m = hand_pose(task.arm.chain, task.arm.clamp, angles + ZEROS_RAD).position_m
    points_m = np.concatenate([true_hand_m[:, None], true_hand_m[:, None] + swayed], axis=1)
    measured = Measured(frame_s, angles, frame_s, points_m, 0.1)
    trial = PastTrial(1, curve(), command[0], q_rad, frame_s, points_m[:, -1], None, 0.1, 0.1)
    return trial, measured


def test_a_trial_shows_how_it_was_held_and_how_the_joints_followed(
    task: PlanningTask, strings: StringBatch, measured: tuple[PastTrial, Measured]
) -> None:
    found = trial_deviations(task, strings, *measured, SERVO, None)
    values, errors = found.values, found.errors
    np.testing.assert_allclose(values["sway_rad"], 0.02, atol=1e-3)
    np.testing.assert_allclose(values["sway_rad_s"], 0.1)
    np.testing.assert_allclose(values["grasp_length_m"], 1.01 * 0.300, atol=1e-3)
    np.testing.assert_allclose(values["joint_zero_rad"], [0.002, -0.003, np.nan], atol=2e-4)
    np.testing.assert_allclose(values["servo_gain"], 0.01, atol=1e-3)
    np.testing.assert_allclose(values["servo_lag_s"], 0.002, atol=2e-4)
    assert "grasp_angle_rad" not in values
    assert 0.0 < errors["sway_rad_s"][0] < 0.02
    other = trial_deviations(task, strings, *measured, None, (0.31, 2e-4))
    assert (other.values["grasp_length_m"], other.errors["grasp_length_m"]) == (0.31, 2e-4)
    assert "servo_gain" not in other.values


def test_what_the_tracker_did_not_see_is_not_measured(
    task: PlanningTask, strings: StringBatch, measured: tuple[PastTrial, Measured]
) -> None:
    trial, seen_before = measured
    blind = seen_before._replace(points_m=np.full_like(seen_before.points_m, np.nan))
    found = trial_deviations(task, strings, replace(trial, sway_rad_s=0.0), blind, None, None)
    assert found.values == {}
