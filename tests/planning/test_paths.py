"""Many motions side by side are the same as one by one; the search measures the excess over each limit."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.limits import peaks, violations
from strandcast.arm.load import PlanarArm
from strandcast.planning.bezier import Curve, paper_heights, rest_heights, sample, with_stop_ramp
from strandcast.planning.draw import CurvePrior, JointBounds, draw_first
from strandcast.planning.paths import WITHIN, packed, paths_of, paths_of_any

STEP_S = 0.002


def curves(count: int, seed: int = 0) -> list[Curve]:
    rng = np.random.default_rng(seed)
    return [
        Curve(
            rng.uniform(-0.3, 0.3, 3),
            round(rng.uniform(0.3, 0.9) / STEP_S) * STEP_S,
            rest_heights(rng.uniform(-4, 4, (3, 5))),
        )
        for _ in range(count)
    ]


def test_paths_are_the_curves_sampled(arm: PlanarArm) -> None:
    given = curves(4)
    paths = paths_of(packed(given), STEP_S, 0.1, arm.dynamics)
    for p, curve in enumerate(given):
        motion = sample(curve, STEP_S)
        end = len(motion.time_s) - 1
        assert paths.last[p] == end
        np.testing.assert_allclose(paths.q[p, : end + 1], motion.q_rad, atol=1e-12)
        np.testing.assert_array_equal(paths.q[p, end:], np.tile(paths.q[p, end], (paths.q.shape[1] - end, 1)))
        most = peaks(arm, motion)
        np.testing.assert_allclose(paths.speed[p], most["velocity_rad_s"], rtol=1e-9)
        np.testing.assert_allclose(paths.acceleration[p], most["acceleration_rad_s2"], rtol=1e-9)
        np.testing.assert_allclose(paths.jerk[p], most["jerk_rad_s3"], rtol=1e-8)
        np.testing.assert_allclose(paths.torque[p], most["torque_n_m"], rtol=1e-6)
        np.testing.assert_allclose(paths.low[p], motion.q_rad.min(axis=0), atol=1e-12)
        np.testing.assert_allclose(paths.high[p], motion.q_rad.max(axis=0), atol=1e-12)
        np.testing.assert_allclose(paths.effort_rad_s[p], np.sqrt(np.mean(motion.qd_rad_s**2)))
    assert paths.q.shape[1] == paths.last.max() + 1 + round(0.1 / STEP_S)


def test_a_motion_with_a_ramp_goes_on_until_it_rests(arm: PlanarArm) -> None:
    heights = paper_heights(np.random.default_rng(2).uniform(-20, 20, (3, 6)), 0.4)
    ramped = with_stop_ramp(Curve(np.zeros(3), 0.4, heights), np.full(3, 95.0), STEP_S)
    assert ramped is not None
    paths = paths_of_any([ramped, *curves(1)], STEP_S, 0.05, arm.dynamics)
    motion = sample(ramped, STEP_S)
    np.testing.assert_array_equal(paths.q[0, : len(motion.q_rad)], motion.q_rad)
    most = peaks(arm, motion)
    np.testing.assert_allclose(paths.torque[0], most["torque_n_m"], rtol=1e-6)
    np.testing.assert_allclose(paths.jerk[0], most["jerk_rad_s3"])


@pytest.mark.parametrize("kind", ["velocity_rad_s", "acceleration_rad_s2", "jerk_rad_s3", "torque_n_m"])
def test_the_excess_over_each_limit_is_a_share_of_it(arm: PlanarArm, kind: str) -> None:
    free = {
        name: np.full(3, np.inf)
        for name in ("velocity_rad_s", "acceleration_rad_s2", "jerk_rad_s3", "torque_n_m")
    }
    motion = sample(curves(1)[0], STEP_S)
    most = peaks(arm, motion)[kind]
    paths = paths_of(packed(curves(1)), STEP_S, 0.0, arm.dynamics)
    assert paths.excess(replace(arm, limits=replace(arm.limits, **free)))[0] == 0.0
    tight = replace(arm, limits=replace(arm.limits, **(free | {kind: most / np.array([1.5, 0.5, 0.5])})))
    np.testing.assert_allclose(paths.excess(tight), 1.5 - WITHIN, rtol=1e-6)
    said = violations(tight, motion)
    assert {v.joint for v in said} == {arm.joints[0]}


def test_the_excess_of_a_joint_is_a_share_of_its_range(arm: PlanarArm) -> None:
    still = Curve(np.array([3.0, 0.0, 0.0]), 0.1, rest_heights(np.zeros((3, 2))))
    over = paths_of(packed([still]), STEP_S).excess(arm)
    np.testing.assert_allclose(over, (3.0 - 2.78) / (2.78 + 0.33))


@pytest.mark.parametrize("step_s", [pytest.param(0.002, marks=pytest.mark.thorough), 0.008])
def test_a_motion_that_leaves_rest_at_once_keeps_the_limits_in_between(arm: PlanarArm, step_s: float) -> None:
    weak = replace(arm, limits=replace(arm.limits, acceleration_rad_s2=np.full(3, 20.0)))
    rng = np.random.default_rng(3)
    prior = CurvePrior("paper", (0.2, 1.2), 22.0)
    for curve in draw_first(60, prior, JointBounds(weak, step_s), rng):
        motion = sample(curve, step_s)
        dense = motion.at(np.arange(round(1000 * motion.end_s) + 1) * 1e-3)
        assert violations(weak, dense) == []
