"""Torques are checked, or the reason is reported."""

from pathlib import Path

import pytest

from strandcast.arm.limits import torque_gap
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.arm.urdf import massless

ARMS = Path(__file__).parents[2] / "config" / "arms"


def edited(
    name: str, folder: Path, urdf: tuple[str, str] = ("", ""), toml: tuple[str, str] = ("", "")
) -> PlanarArm:
    """Return an arm with one thing replaced in its URDF, or in its file."""
    for suffix, (old, new) in ((".urdf", urdf), (".toml", toml)):
        text = (ARMS / f"{name}{suffix}").read_text()
        assert old in text
        (folder / f"{name}{suffix}").write_text(text.replace(old, new, 1) if old else text)
    return load_arm(folder / f"{name}.toml").planar()


def test_an_arm_with_masses_and_a_margin_has_its_torques_checked() -> None:
    assert torque_gap(load_arm(ARMS / "planar3.toml").planar()) is None


@pytest.mark.parametrize("name", ["ur5e-example", "fr3-example"])
def test_a_margin_of_torque_without_masses_is_reported(name: str, tmp_path: Path) -> None:
    arm = edited(name, tmp_path, toml=("[margins]", "[margins]\ntorque = 0.8"))
    assert massless(arm.model(), arm.joints) == list(arm.joints)
    assert f"{name}.urdf gives no mass to what {', '.join(arm.joints)} turn" in str(torque_gap(arm))


def test_one_link_without_mass_is_named(tmp_path: Path) -> None:
    mass = '<mass value="0.6"/>'
    arm = edited("planar3", tmp_path, urdf=(mass, '<mass value="0.0"/>'))
    assert massless(arm.model(), arm.joints) == ["joint_2"]
    assert "what joint_2 turns" in str(torque_gap(arm))


def test_no_margin_is_no_check(tmp_path: Path) -> None:
    arm = edited("planar3", tmp_path, toml=("torque = 0.80", "# no torque"))
    assert torque_gap(arm) == "torque is not checked: planar3.toml has no margins.torque"
