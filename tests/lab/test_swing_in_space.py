"""The lab in space: at rest it stays, in a plane it is the planar lab, and sway leaves the plane."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import SpatialArm, load_arm
from strandcast.lab import swing_in_space
from strandcast.lab.strings import PhysicalString
from strandcast.lab.swing import LabSwing, simulate_swing
from strandcast.lab.swing_in_space import VariationInSpace, simulate_swing_in_space
from strandcast.lab.variation import draw_variation
from strandcast.planning.bezier import Curve, rest_heights, sample

STRING = PhysicalString(0.30, 0.006, 3e-6, 0.0, 0.003, ((0.21, 0.008),))
STILL = Curve(np.zeros(6), 0.1, rest_heights(np.zeros((6, 3))))
UR5E = Path("config/arms/ur5e-space.toml")


def nominal(joints: int) -> VariationInSpace:
    return VariationInSpace(*(draw_variation(np.random.default_rng(0), joints, 0.0) for _ in range(2)))


def swung(
    project_root: Path, q0: list[float], string: PhysicalString, variation: VariationInSpace
) -> LabSwing:
    arm = load_arm(project_root / UR5E).spatial()
    motion = sample(replace(STILL, q0_rad=np.array(q0)), 0.002)
    return simulate_swing_in_space(arm, "servoj", string, 0.4, variation, motion)


@pytest.mark.parametrize("q0", [[0.3, -1.2, 1.5, -1.0, -1.57, 0.2], [1.0, -0.8, 0.9, 1.0, 1.2, -0.5]])
def test_a_curled_string_at_rest_stays_and_hangs(project_root: Path, q0: list[float]) -> None:
    swing = swung(project_root, q0, replace(STRING, curl_rad_m=3.0), nominal(6))
    np.testing.assert_allclose(swing.nodes_m[-1], swing.nodes_m[0], atol=1e-6)
    assert swing.nodes_m[0, -1, 2] < swing.nodes_m[0, 0, 2] - 0.9 * STRING.length_m
    arm = load_arm(project_root / UR5E).spatial()
    np.testing.assert_allclose(arm.hand_path(swing.q_rad)[:, :3], swing.nodes_m[:, 0], atol=1e-9)


@pytest.mark.thorough
def test_sway_has_two_directions(project_root: Path) -> None:
    calm = nominal(6)
    q0 = [0.3, -1.2, 1.5, -1.0, -1.57, 0.2]
    rest = swung(project_root, q0, STRING, calm).nodes_m[0, -1]
    sways = [
        calm._replace(along=replace(calm.along, sway_rad=0.02)),
        calm._replace(across=replace(calm.across, sway_rad=0.02)),
    ]
    for turned, axis in zip(sways, (1, 0), strict=True):
        away = swung(project_root, q0, STRING, turned).nodes_m[0, -1] - rest
        np.testing.assert_allclose(np.abs(away[axis]), 0.02 * STRING.length_m, rtol=0.05)
        assert np.abs(away[1 - axis]) < 0.1 * np.abs(away[axis])


@pytest.mark.thorough
def test_a_throw_in_a_plane_is_that_of_the_planar_lab(
    project_root: Path, planar_arm_in_space: SpatialArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    planar = load_arm(project_root / "config/arms/planar3.toml").planar()
    swing = [[2.0, 4.0, 4.0, 3.0, 1.0, 0.0], [2.0, 3.0, 5.0, 5.0, 2.0, 0.0], [0.0, 3.0, 6.0, 6.0, 1.0, 0.0]]
    motion = sample(Curve(np.array([0.3, -0.9, -0.5]), 0.5, rest_heights(np.array(swing))), 0.002)
    monkeypatch.setattr(swing_in_space, "SPATIAL_LINK_M", 0.015)
    calm = nominal(3)
    flat = simulate_swing(planar, "stiff", STRING, calm.along, motion)
    found = simulate_swing_in_space(planar_arm_in_space, "stiff", STRING, 0.0, calm, motion)
    np.testing.assert_allclose(found.nodes_m[:, :, 1], 0.0, atol=1e-9)
    apart = np.linalg.norm(found.nodes_m[:, :, ::2] - flat.nodes_m, axis=2)
    moving = flat.time_s < 0.5  # later the string folds and whips, and any difference grows
    assert apart[moving].max() < 1e-3
    assert np.ptp(flat.nodes_m[:, -1], axis=0).max() > 0.3  # it was a throw
