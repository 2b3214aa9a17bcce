"""The planar chain's torques are MuJoCo's inverse dynamics, whatever is held, branched off or carried."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.dynamics import chain_torques
from strandcast.arm.limits import torques
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.arm.settings import Payload


def planar(arm: PlanarArm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    dynamics = arm.dynamics
    return np.asarray(chain_torques(q, qd, qdd, dynamics.links, dynamics.gravity_m_s2))


@pytest.mark.parametrize("name", ["planar3", "ur5e-example", "fr3-example", "xarm6-example"])
def test_torques_are_mujocos(project_root: Path, name: str) -> None:
    arm = load_arm(project_root / f"config/arms/{name}.toml").planar()
    rng = np.random.default_rng(3)
    low, high = np.maximum(arm.limits.lower_rad, -3.0), np.minimum(arm.limits.upper_rad, 3.0)
    q = rng.uniform(low, high, (40, 3))
    qd, qdd = rng.uniform(-8, 8, (40, 3)), rng.uniform(-90, 90, (40, 3))
    for one in (arm, replace(arm, payload=Payload(mass_kg=0.7, centre_m=(0.02, -0.01, 0.05)))):
        expected = torques(one, q, qd, qdd)
        np.testing.assert_allclose(planar(one, q, qd, qdd), expected, rtol=1e-6, atol=1e-7)


def test_a_payload_is_felt_by_its_weight(project_root: Path) -> None:
    arm = load_arm(project_root / "config/arms/planar3.toml").planar()
    still = np.zeros((1, 3))
    more = planar(replace(arm, payload=Payload(mass_kg=1.0, centre_m=(0.0, 0.0, 0.0))), still, still, still)
    # Stretched out sideways, a kilogram at the grip weighs on every joint by its distance.
    lever = -9.81 * np.array([0.70, 0.40, 0.15])
    np.testing.assert_allclose(np.abs(more - planar(arm, still, still, still))[0], np.abs(lever), rtol=1e-6)


def test_dry_friction_is_never_underestimated(project_root: Path, tmp_path: Path) -> None:
    friction = 0.5
    for suffix in (".toml", ".urdf"):
        text = (project_root / f"config/arms/planar3{suffix}").read_text(encoding="utf-8")
        ending = f'<dynamics friction="{friction}"/></joint>'
        (tmp_path / f"planar3{suffix}").write_text(text.replace("</joint>", ending), encoding="utf-8")
    arm = load_arm(tmp_path / "planar3.toml").planar()
    rng = np.random.default_rng(3)
    q = rng.uniform(arm.limits.lower_rad, arm.limits.upper_rad, (40, 3))
    qd, qdd = rng.uniform(-8, 8, (40, 3)), rng.uniform(-90, 90, (40, 3))
    found, expected = planar(arm, q, qd, qdd), torques(arm, q, qd, qdd)
    assert (np.abs(found) >= np.abs(expected) - 1e-6).all()
    # MuJoCo has it against the motion: as the chain, or the other way.
    assert (np.abs(found - expected) <= 2.0 * friction + 1e-6).all()
