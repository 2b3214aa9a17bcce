"""The region that the hand can reach when it is stopped, against sweeps computed by hand."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.joint_limits import Stop
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.arm.reach import outside_m, reach_of, roughly_outside_m
from strandcast.arm.stop import SoftStop
from strandcast.core.trajectory import JointTrajectory
from strandcast.planning.bezier import Curve, rest_heights, sample

REACH_M = 0.70


@pytest.fixture
def arm(project_root: Path) -> PlanarArm:
    arm = load_arm(project_root / "config/arms/planar3.toml").planar()
    stop = Stop(np.full(3, 50.0), np.full(3, 5000.0), np.zeros(3), np.zeros(3))
    return dataclasses.replace(arm, stop=stop)


def turning(speed_rad_s: float) -> JointTrajectory:
    """An extended arm that turns about its base, horizontal at its last instant."""
    time_s = np.arange(101) * 0.001
    q = np.zeros((101, 3))
    q[:, 0] = speed_rad_s * (time_s - 0.1)
    qd = np.zeros((101, 3))
    qd[:, 0] = speed_rad_s
    return JointTrajectory(time_s, q, qd, np.zeros((101, 3)))


def test_a_soft_stop_takes_the_time_and_angle_of_its_ramps() -> None:
    # Braking from speed v at acceleration a and jerk j takes v/a + a/j, at a mean speed of v/2.
    stop = SoftStop(np.array([50.0]), np.array([5000.0]))
    duration_s = stop.begin(np.array([0.2]), np.array([3.0]), np.array([0.0]))
    assert duration_s == pytest.approx(3.0 / 50.0 + 50.0 / 5000.0)
    q, qd, qdd = stop.at(duration_s)
    assert q[0] == pytest.approx(0.2 + 0.5 * 3.0 * duration_s)
    assert (qd[0], qdd[0]) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_the_hand_moves_on_during_a_soft_stop(arm: PlanarArm) -> None:
    reach = reach_of(arm, turning(2.0), hanging_m=0.0)
    angle = 0.5 * 2.0 * (2.0 / 50.0 + 0.01)
    assert reach.stop_rad == pytest.approx([angle, 0.0, 0.0])
    assert reach.hand_m[1, 1] == pytest.approx(0.0, abs=1e-9)
    assert reach.swept_m[1, 1] == pytest.approx(REACH_M * np.sin(angle))


def test_the_controllers_own_stop_grows_with_speed(arm: PlanarArm) -> None:
    distance = np.array([0.6, 0.0, 0.0])
    slow = dataclasses.replace(arm, stop=dataclasses.replace(arm.stop, distance_rad=distance))
    reach = reach_of(slow, turning(2.0), hanging_m=0.0)
    angle = 0.6 * 2.0 / arm.limits.velocity_rad_s[0]
    assert reach.stop_rad[0] == pytest.approx(angle)
    assert reach.swept_m[1, 1] == pytest.approx(REACH_M * np.sin(angle))


def test_the_string_may_be_anywhere_around_the_hand(arm: PlanarArm) -> None:
    bare, hung = (reach_of(arm, turning(2.0), hanging_m=length) for length in (0.0, 0.4))
    np.testing.assert_allclose(hung.swept_m - bare.swept_m, [[-0.4, 0.4], [-0.4, 0.4]])
    np.testing.assert_allclose(hung.hand_m, bare.hand_m)


def test_a_stop_beyond_a_joints_range_is_reported(arm: PlanarArm) -> None:
    motion = turning(2.0)
    motion.q_rad[:, 0] += arm.limits.upper_rad[0] - 0.01
    reach = reach_of(arm, motion, 0.0)
    assert reach.beyond_rad == pytest.approx([0.5 * 2.0 * 0.05 - 0.01, 0.0, 0.0])


def test_outside_distance_is_that_of_the_farthest_side(arm: PlanarArm) -> None:
    arm = dataclasses.replace(arm, box_m=np.array([[-1.0, 1.0], [-0.5, 0.5]]))
    assert outside_m(arm, np.array([[-0.9, 0.9], [-0.4, 0.4]])) == 0.0
    assert outside_m(arm, np.array([[-1.1, 0.9], [-0.4, 0.8]])) == pytest.approx(0.3)


def test_the_rough_stop_is_conservative_and_close(arm: PlanarArm) -> None:
    tight = dataclasses.replace(arm, box_m=np.array([[-0.3, 0.75], [-0.2, 0.7]]))
    random = np.random.default_rng(0)
    heights = [rest_heights(random.normal(0.0, 3.0, (3, 6))) for _ in range(24)]
    postures = random.uniform(-0.8, 0.8, (24, 3))
    curves = [Curve(q0, 0.6, free) for q0, free in zip(postures, heights, strict=True)]
    motions = [sample(curve, 0.002) for curve in curves]
    exact_m = [outside_m(tight, reach_of(tight, m, hanging_m=0.3).swept_m) for m in motions]
    rough_m = roughly_outside_m(tight, np.array([m.q_rad for m in motions]), 0.002, hanging_m=0.3)
    assert np.ptp(exact_m) > 0.2
    assert np.all(rough_m >= np.array(exact_m) - 5e-4)
    assert np.all(rough_m <= np.array(exact_m) + 0.02)
