"""The Franka driver's own parts, without pylibfranka and without a controller."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import ENVIRONMENT, REFUSED, StrandcastError
from strandcast.executor.drivers.franka import FrankaDriver, franka_driver
from strandcast.executor.drivers.franka_limits import check_speeds, speed_limits
from strandcast.executor.drivers.franka_link import CYCLE_S
from strandcast.executor.streaming.easing import Easing

ROOT = Path(__file__).parents[3]
MOVING = np.array([1, 3, 5])


@pytest.fixture(scope="module")
def arm() -> PlanarArm:
    arm = load_arm(ROOT / "config" / "arms" / "fr3-example.toml").planar()
    return dataclasses.replace(arm, driver_settings={"host": "127.0.0.1", "realtime": "ignore"})


def test_without_the_package_it_says_what_to_install(arm: PlanarArm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pylibfranka", None)
    driver = FrankaDriver(arm)
    with pytest.raises(StrandcastError, match=r"pip install 'strandcast\[franka\]'") as caught:
        driver.connect()
    assert caught.value.exit_code == ENVIRONMENT
    driver.stop()


def test_the_example_has_no_host_and_refuses_to_connect_without_one() -> None:
    driver = franka_driver(load_arm(ROOT / "config" / "arms" / "fr3-example.toml").planar(), None)
    with pytest.raises(StrandcastError, match=r"SC-F003.*driver\.settings\.host"):
        driver.connect()


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        ({"realtime": "ignore"}, "host"),
        ({"host": "a", "speed": 2}, "speed"),
        ({"host": "a", "realtime": "maybe"}, "realtime"),
        ({"host": "a", "force_threshold_n": [1, 2]}, "force"),
        ({"host": "a", "torque_threshold_n_m": [10] * 6 + [-1]}, r"torque_threshold_n_m\.6"),
        ({"host": "a", "torque_threshold_n_m": [10] * 7}, "force_threshold_n together"),
    ],
)
def test_invalid_settings_are_refused(arm: PlanarArm, settings: dict[str, object], field: str) -> None:
    with pytest.raises(StrandcastError, match=rf"SC-F003.*driver\.settings.*{field}") as caught:
        FrankaDriver(dataclasses.replace(arm, driver_settings=settings))
    assert caught.value.exit_code == REFUSED


def test_a_joint_that_the_controller_does_not_have_is_refused(arm: PlanarArm) -> None:
    settings = {"host": "a", "joints": [f"panda_joint{j}" for j in range(1, 8)]}
    with pytest.raises(StrandcastError, match="SC-F205.*panda_joint1"):
        FrankaDriver(dataclasses.replace(arm, driver_settings=settings))


def test_the_speed_limit_falls_near_the_end_of_a_joint(arm: PlanarArm) -> None:
    # Joint 2: 2.62 rad/s in its middle; -0.20 + sqrt(5.17 (1.7918 - q)) towards its upper end.
    lowest, highest = speed_limits(np.array([[0.0, -1.5, 2.5], [1.7, -1.5, 2.5]]), MOVING)
    np.testing.assert_allclose(highest / 0.95, [[2.62, 2.62, 4.18], [0.4889, 2.62, 4.18]], atol=1e-4)
    np.testing.assert_allclose(lowest / 0.95, [[-2.62, -2.62, -4.18]] * 2, atol=1e-4)

    def moving_at(speed: float) -> JointTrajectory:
        q, still = np.array([[0.0, -1.5, 2.5], [1.7, -1.5, 2.5]]), np.zeros((2, 3))
        return JointTrajectory(np.array([0.0, 1.0]), q, np.array([[0, 0, 0], [speed, 0, 0]]), still)

    check_speeds(arm, MOVING, moving_at(0.46))
    with pytest.raises(StrandcastError, match=r"SC-X004.*fr3_joint2.*1\.70 rad") as caught:
        check_speeds(arm, MOVING, moving_at(0.47))
    assert caught.value.exit_code == REFUSED


def test_an_easing_starts_at_its_offset_and_ends_at_zero() -> None:
    easing = Easing(CYCLE_S, 0.05, np.array([1e-5, -2e-5]), np.array([0.004, 0.0]), np.array([2.0, -1.0]))
    rows = []
    while not easing.ended():
        rows.append(easing.next())
    e = np.array(rows)
    speed, acceleration = np.gradient(e, CYCLE_S, axis=0), np.diff(e, 2, axis=0) / CYCLE_S**2
    np.testing.assert_allclose(e[0], [1e-5, -2e-5])
    np.testing.assert_allclose(speed[0], [0.004, 0.0], atol=2e-3)
    np.testing.assert_allclose(acceleration[0], [2.0, -1.0], atol=0.6)
    np.testing.assert_allclose(e[-1], 0.0, atol=1e-12)
    np.testing.assert_allclose(speed[-1], 0.0, atol=1e-3)
    np.testing.assert_allclose(acceleration[-1], 0.0, atol=0.8)
    np.testing.assert_array_equal(easing.next(), e[-1])
