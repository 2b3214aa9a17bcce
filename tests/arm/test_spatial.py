"""An arm in space: its hand, its links and its torques are MuJoCo's; its file's faults are reported."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from strandcast.arm.limits import torques
from strandcast.arm.load import SpatialArm, load_arm
from strandcast.arm.settings import Payload
from strandcast.arm.spatial import capsules_in_space, clamp_axes
from strandcast.arm.urdf import posed
from strandcast.errors import StrandcastError

ARMS = Path("config/arms")


@pytest.fixture(params=["ur5e-space", "fr3-space"])
def arm(project_root: Path, request: pytest.FixtureRequest) -> SpatialArm:
    return load_arm(project_root / ARMS / f"{request.param}.toml").spatial()


def postures(arm: SpatialArm, count: int) -> np.ndarray:
    low, high = np.maximum(arm.limits.lower_rad, -3.0), np.minimum(arm.limits.upper_rad, 3.0)
    return np.random.default_rng(3).uniform(low, high, (count, len(arm.joints)))


def test_hand_and_links_are_mujocos(arm: SpatialArm) -> None:
    q = postures(arm, 20)
    data = mujoco.MjData(arm.model())
    poses, ends = arm.hand_path(q), capsules_in_space(arm.chain, q)
    for k in range(len(q)):
        data.qpos[:] = posed(arm.model(), arm.held | dict(zip(arm.joints, q[k], strict=True))).qpos
        mujoco.mj_kinematics(arm.model(), data)
        link = data.body(arm.clamp.link)
        frame = link.xmat.reshape(3, 3)
        hand_m = link.xpos + frame @ arm.clamp.offset_m
        expected = np.concatenate([hand_m, *(clamp_axes(arm.clamp)[:2] @ frame.T)])
        np.testing.assert_allclose(poses[k], expected, atol=1e-12)
        anchors = np.array([data.joint(name).xanchor for name in arm.joints])
        np.testing.assert_allclose(ends[k, :, 0], anchors, atol=1e-12)
        np.testing.assert_allclose(ends[k, :, 1], [*anchors[1:], hand_m], atol=1e-12)


def test_torques_in_space_are_mujocos(arm: SpatialArm) -> None:
    q, rng = postures(arm, 40), np.random.default_rng(4)
    qd, qdd = rng.uniform(-3, 3, q.shape), rng.uniform(-20, 20, q.shape)
    for one in (arm, replace(arm, payload=Payload(mass_kg=0.7, centre_m=(0.02, -0.01, 0.05)))):
        found = one.spatial_dynamics.torques(q, qd, qdd)
        np.testing.assert_allclose(found, torques(one, q, qd, qdd), rtol=1e-9, atol=1e-9)


def test_the_mass_matrix_is_mujocos(arm: SpatialArm) -> None:
    model = arm.model_with_payload()
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    dofs = [int(model.joint(name).dofadr[0]) for name in arm.joints]
    for q in postures(arm, 20):
        data.qpos[:] = posed(arm.model(), arm.held | dict(zip(arm.joints, q, strict=True))).qpos
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        found = arm.spatial_dynamics.mass_matrix(q)
        np.testing.assert_allclose(found, full[np.ix_(dofs, dofs)], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("direction = [0, 0, 1]", "direction = [0, 0, 0]", "clamp.direction"),
        ('"elbow_joint", "wrist_1_joint"', '"wrist_1_joint", "elbow_joint"', "from the base to the hand"),
        ("z_m = [-0.7, 1.7]", "z_m = [1.7, -0.7]", "workspace.z_m"),
        ('"wrist_3_joint",\n', "\n", "neither moves nor is held"),
    ],
)
def test_a_fault_of_the_file_is_reported(
    project_root: Path, tmp_path: Path, old: str, new: str, words: str
) -> None:
    for suffix in (".toml", ".urdf"):
        text = (project_root / ARMS / f"ur5e-space{suffix}").read_text(encoding="utf-8")
        (tmp_path / f"arm{suffix}").write_text(text.replace(old, new).replace("ur5e-space.urdf", "arm.urdf"))
    with pytest.raises(StrandcastError) as caught:
        load_arm(tmp_path / "arm.toml").spatial()
    assert words in str(caught.value)
