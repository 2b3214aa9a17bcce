"""Random motions keep the arm's limits; the same seed gives the same motions."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.limits import violations
from strandcast.arm.load import PlanarArm
from strandcast.errors import StrandcastError
from strandcast.planning.bezier import Curve, sample
from strandcast.planning.draw import CurvePrior, JointBounds, Reading, draw_first, within_one_turn

STEP_S = 0.002


def prior(reading: Reading) -> CurvePrior:
    return CurvePrior(reading, (0.3, 0.9), 60.0)


def drawn(arm: PlanarArm, reading: Reading, seed: int = 0, count: int = 30) -> list[Curve]:
    bounds = JointBounds(arm, STEP_S, arm.dynamics)
    return draw_first(count, prior(reading), bounds, np.random.default_rng(seed))


@pytest.mark.parametrize("reading", ["rest", "paper"])
def test_all_draws_keep_the_limits(arm: PlanarArm, reading: Reading) -> None:
    curves = drawn(arm, reading)
    for curve in curves:
        motion = sample(curve, STEP_S)
        assert violations(arm, motion) == []
        assert 0.3 <= curve.duration_s <= 0.9
    # They are fast enough to throw: some joint reaches 3 rad/s in most.
    fast = [np.abs(sample(curve, STEP_S).qd_rad_s).max() > 3.0 for curve in curves]
    assert np.mean(fast) > 0.5


@pytest.mark.parametrize("reading", ["rest", "paper"])
def test_draws_keep_the_torque_limits_of_a_weak_arm(arm: PlanarArm, reading: Reading) -> None:
    weak = replace(arm, limits=replace(arm.limits, torque_n_m=np.array([17.0, 6.0, 1.5])))
    for curve in drawn(weak, reading, count=10):
        motion = sample(curve, STEP_S)
        assert violations(weak, motion) == []


@pytest.mark.parametrize("reading", ["rest", "paper"])
def test_a_range_away_from_zero_is_used_whole(arm: PlanarArm, reading: Reading) -> None:
    low, high = np.array([-0.33, 3.5, 1.6]), np.array([2.78, 6.5, 5.1])
    offset = replace(arm, limits=replace(arm.limits, lower_rad=low, upper_rad=high))
    starts = np.array([curve.q0_rad for curve in drawn(offset, reading, count=20)])
    assert starts[:, 1].min() > 3.5
    assert starts[:, 2].max() > np.pi


def test_a_start_is_within_one_turn_of_a_wide_range() -> None:
    low, high = within_one_turn(np.array([-np.inf, -6.0, 0.0, -3.3]), np.array([np.inf, 6.5, 7.0, 2.0]))
    np.testing.assert_allclose(low, [-np.pi, -np.pi, 0.0, -3.3])
    np.testing.assert_allclose(high, [np.pi, np.pi, 2.0 * np.pi, 2.0])


def test_draws_keep_a_jerk_limit(arm: PlanarArm) -> None:
    smooth = replace(arm, limits=replace(arm.limits, jerk_rad_s3=np.full(3, 600.0)))
    for curve in drawn(smooth, "rest", count=10):
        motion = sample(curve, STEP_S)
        assert violations(smooth, motion) == []


def test_draws_keep_the_limits_of_the_whole_arm(arm: PlanarArm) -> None:
    whole_arm = np.array([1.0, 1.2, 0.4, 6.0, 0.4, 0.1, 0.05, 0.02])
    slow = replace(arm, limits=replace(arm.limits, whole_arm=whole_arm))
    for curve in drawn(slow, "rest", count=10):
        motion = sample(curve, STEP_S)
        assert violations(slow, motion) == []
        assert np.linalg.norm(np.diff(slow.hand_m(motion.q_rad), axis=0), axis=1).max() < 1.2 * STEP_S


def test_the_papers_motions_end_in_a_ramp_ours_do_not(arm: PlanarArm) -> None:
    assert all(curve.ramp_s > 0.0 for curve in drawn(arm, "paper", count=5))
    assert all(curve.ramp_s == 0.0 for curve in drawn(arm, "rest", count=5))


def test_same_seed_same_motions(arm: PlanarArm) -> None:
    one, two, other = drawn(arm, "rest", 7, 5), drawn(arm, "rest", 7, 5), drawn(arm, "rest", 8, 5)
    np.testing.assert_array_equal(one[4].heights_rad_s, two[4].heights_rad_s)
    assert not np.array_equal(one[4].q0_rad, other[4].q0_rad)


def test_limits_without_room_are_refused(arm: PlanarArm) -> None:
    tight = replace(arm, limits=replace(arm.limits, lower_rad=np.zeros(3), upper_rad=np.full(3, 1e-4)))
    with pytest.raises(StrandcastError, match="SC-P004"):
        draw_first(3, prior("rest"), JointBounds(tight, STEP_S), np.random.default_rng(0))


def test_only_postures_that_are_allowed_are_drawn(arm: PlanarArm) -> None:
    rng = np.random.default_rng(0)
    bounds = JointBounds(arm, STEP_S)
    curves = draw_first(10, prior("rest"), bounds, rng, lambda q0: q0[:, 1] > 0.5)
    assert min(curve.q0_rad[1] for curve in curves) > 0.5
