"""Velocity curves: closed forms, consistency of the derivatives, rest at both ends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strandcast.planning.bezier import Curve, paper_heights, rest_heights, sample, with_stop_ramp

STEP_S = 0.002


def test_one_inner_height_is_the_bernstein_polynomial() -> None:
    # Five heights, the middle one h: speed 6 h s^2 (1-s)^2, turned by h T / 5 in all.
    curve = Curve(np.array([0.3]), 0.4, rest_heights(np.array([[2.0]])))
    motion = sample(curve, STEP_S)
    s = motion.time_s / 0.4
    np.testing.assert_allclose(motion.qd_rad_s[:, 0], 12.0 * s**2 * (1 - s) ** 2, atol=1e-12)
    np.testing.assert_allclose(motion.q_rad[-1, 0], 0.3 + 2.0 * 0.4 / 5, atol=1e-12)
    np.testing.assert_allclose(
        motion.qdd_rad_s2[50, 0], 12.0 * 2 * s[50] * (1 - s[50]) * (1 - 2 * s[50]) / 0.4
    )


def test_equal_slopes_of_eq_1_are_constant_acceleration() -> None:
    curve = Curve(np.zeros(1), 0.5, paper_heights(np.full((1, 6), 8.0), 0.5))
    motion = sample(curve, STEP_S)
    np.testing.assert_allclose(motion.qd_rad_s[:, 0], 8.0 * motion.time_s, atol=1e-12)
    np.testing.assert_allclose(motion.q_rad[-1, 0], 0.5 * 8.0 * 0.25, atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(60, 500))
@settings(max_examples=40, deadline=None)
def test_rest_to_rest_and_consistent(seed: int, free: int, steps: int) -> None:
    heights = rest_heights(np.random.default_rng(seed).uniform(-8, 8, (3, free)))
    motion = sample(Curve(np.zeros(3), steps * STEP_S, heights), STEP_S)
    assert len(motion.time_s) == steps + 1
    for end in (0, -1):
        np.testing.assert_array_equal(motion.qd_rad_s[end], 0.0)
        np.testing.assert_array_equal(motion.qdd_rad_s2[end], 0.0)
    slope = np.abs(np.diff(motion.qdd_rad_s2, axis=0)).max() / STEP_S
    middle = 0.5 * (motion.qd_rad_s[1:] + motion.qd_rad_s[:-1])
    assert np.abs(np.diff(motion.q_rad, axis=0) / STEP_S - middle).max() <= slope * STEP_S**2 / 6


def test_the_papers_free_end_gets_the_shortest_ramp_within_the_limit() -> None:
    limit = np.full(2, 95.0)
    heights = paper_heights(np.random.default_rng(2).uniform(-60, 60, (2, 6)), 0.4)
    curve = with_stop_ramp(Curve(np.zeros(2), 0.4, heights), limit, STEP_S)
    assert curve is not None
    motion = sample(curve, STEP_S)
    np.testing.assert_allclose(motion.time_s[-1], 0.4 + curve.ramp_s)
    np.testing.assert_allclose(motion.qd_rad_s[-1], 0.0, atol=1e-12)
    np.testing.assert_allclose(motion.qdd_rad_s2[-1], 0.0, atol=1e-12)
    assert np.abs(motion.qdd_rad_s2[201:]).max() <= 95.0
    # The join is smooth and the ramp moves as its speed says.
    assert np.abs(motion.qd_rad_s[200] - heights[:, -1]).max() < 1e-12
    np.testing.assert_allclose(
        np.gradient(motion.q_rad, STEP_S, axis=0)[202:-2], motion.qd_rad_s[202:-2], atol=0.02
    )
    shorter = np.abs(1.5 * heights[:, -1] / (curve.ramp_s - STEP_S)).max()
    assert shorter > 80.0


def test_a_ramp_that_cannot_be_is_none() -> None:
    heights = paper_heights(np.full((1, 4), 10.0), 0.5)
    assert with_stop_ramp(Curve(np.zeros(1), 0.5, heights), np.array([1.0]), STEP_S) is None


def test_too_short_a_motion_is_refused() -> None:
    with pytest.raises(Exception, match="SC-P004"):
        sample(Curve(np.zeros(1), 0.006, rest_heights(np.ones((1, 2)))), STEP_S)
