"""The UR driver's settings, and what it says where ur_rtde is not installed."""

import dataclasses
import sys
from pathlib import Path
from typing import Any

import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.errors import ENVIRONMENT, REFUSED, StrandcastError
from strandcast.executor.drivers.ur import UrDriver


@pytest.fixture(scope="module")
def arm(project_root: Path) -> PlanarArm:
    return load_arm(project_root / "config" / "arms" / "ur5e-example.toml").planar()


def with_settings(arm: PlanarArm, **settings: Any) -> PlanarArm:
    return dataclasses.replace(arm, driver_settings=arm.driver_settings | settings)


def test_the_example_names_the_driver_but_no_address(arm: PlanarArm) -> None:
    assert arm.driver == "ur"
    with pytest.raises(StrandcastError, match=r"driver\.settings\.host") as caught:
        UrDriver(arm).connect()
    assert caught.value.exit_code == REFUSED


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"port": 30004}, r"driver\.settings\.port"),
        ({"look_ahead_s": 0.02}, r"driver\.settings\.look_ahead_s"),
        ({"gain": 5000}, r"driver\.settings\.gain"),
        ({"rate_hz": 250}, r"driver\.settings\.rate_hz"),
        ({"sync_output": 8}, r"driver\.settings\.sync_output"),
        ({"joints": ["a", "b", "c", "d", "e", "f"]}, r"throw\.joints"),
    ],
)
def test_invalid_settings_are_refused_by_name(arm: PlanarArm, wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(StrandcastError, match=named) as caught:
        UrDriver(with_settings(arm, host="127.0.0.1", **wrong))
    assert caught.value.exit_code == REFUSED


def test_without_ur_rtde_it_says_what_to_install(arm: PlanarArm, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("dashboard_client", "rtde_receive"):
        monkeypatch.setitem(sys.modules, module, None)
    driver = UrDriver(with_settings(arm, host="127.0.0.1"))
    with pytest.raises(StrandcastError, match=r"pip install 'strandcast\[ur\]'") as caught:
        driver.connect()
    assert caught.value.exit_code == ENVIRONMENT
    driver.stop()
