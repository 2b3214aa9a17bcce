"""Drivers are found by the name in the arm's file."""

import dataclasses
import sys

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.executor.drivers.registry import driver_of_arm
from strandcast.records.motion import Motion, Robot, StartPosture, points_of


@pytest.fixture
def motion() -> Motion:
    still = np.zeros((2, 3))
    return Motion(
        experiment="demo",
        trial=3,
        target_m=[0.5, 0.5],
        robot=Robot(name="planar3", file_sha256="", urdf_sha256=""),
        joint_names=["joint_1", "joint_2", "joint_3"],
        start=StartPosture(positions_rad=[0, 0, 0], tolerance_rad=[0.01] * 3),
        bezier=None,
        points=points_of(np.array([0, 2_000_000]), still, still, still),
        predicted=None,
        provenance=None,
    )


def test_the_lab_provides_its_driver(project_root, monkeypatch, motion):
    monkeypatch.chdir(project_root)
    arm = load_arm("config/arms/planar3.toml").planar()
    driver = driver_of_arm(arm, motion)
    assert (driver.name, driver.rate_hz) == ("lab", 500)


def test_an_unknown_driver_is_reported_with_the_installed_ones(project_root, motion):
    arm = dataclasses.replace(load_arm(project_root / "config/arms/planar3.toml").planar(), driver="ur12")
    with pytest.raises(
        StrandcastError, match=r"there is no arm driver 'ur12'; available: franka, lab, ur"
    ) as caught:
        driver_of_arm(arm, motion)
    assert caught.value.exit_code == 3


def test_an_arm_without_a_driver_plays_nothing(project_root, motion):
    arm = dataclasses.replace(load_arm(project_root / "config/arms/planar3.toml").planar(), driver=None)
    with pytest.raises(StrandcastError, match=r"SC-W021.*the arm has no driver\n.*export motion"):
        driver_of_arm(arm, motion)


@pytest.mark.parametrize(
    ("name", "file", "package"),
    [
        ("franka", "fr3-example.toml", "pylibfranka"),
        ("ur", "ur5e-example.toml", "dashboard_client"),
        ("xarm", "xarm6-example.toml", "xarm.wrapper"),
    ],
)
def test_without_the_vendors_package_the_error_says_what_to_install(
    project_root, motion, monkeypatch, name, file, package
):
    arm = load_arm(project_root / "config/arms" / file).planar()
    arm = dataclasses.replace(arm, driver_settings=arm.driver_settings | {"host": "192.0.2.7"})
    driver = driver_of_arm(arm, motion)
    assert (driver.name, driver.address, driver.streams) == (name, "192.0.2.7", True)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(StrandcastError) as caught:
        driver.connect()
    assert caught.value.fix == f"pip install 'strandcast[{name}]'"
    assert caught.value.exit_code == 3
