"""An arm's file: its values, and every fault reported at once with field and fix."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose, link_points
from strandcast.arm.load import load_arm
from strandcast.arm.urdf import posed
from strandcast.errors import StrandcastError


@pytest.fixture
def copy(project_root: Path, tmp_path: Path):
    """Copy planar3 with edits of (old, new) in its two files."""

    def make(*edits: tuple[str, str]) -> Path:
        for name in ("planar3.toml", "planar3.urdf"):
            text = (project_root / "config" / "arms" / name).read_text()
            for old, new in edits:
                text = text.replace(old, new)
            (tmp_path / name).write_text(text)
        return tmp_path / "planar3.toml"

    return make


def refusal(path: Path) -> str:
    with pytest.raises(StrandcastError) as caught:
        load_arm(path).planar()
    return str(caught.value)


def test_planar3_is_what_its_files_say(project_root: Path) -> None:
    arm = load_arm(project_root / "config/arms/planar3.toml").planar()
    assert arm.joints == ("joint_1", "joint_2", "joint_3")
    np.testing.assert_allclose(arm.chain.lengths_m, [0.30, 0.25, 0.15], atol=1e-15)
    np.testing.assert_array_equal(arm.chain.signs, [1, 1, 1])
    np.testing.assert_allclose(arm.limits.lower_rad, [-0.33, -2.38, -1.98])
    np.testing.assert_allclose(arm.limits.velocity_rad_s, 9.5)
    np.testing.assert_allclose(arm.limits.acceleration_rad_s2, 95.0)
    np.testing.assert_allclose(arm.limits.torque_n_m, [48.0, 20.0, 6.4])
    assert [marker.id for marker in arm.markers] == [40, 41]


def test_a_positive_angle_lifts_the_hand_and_is_counter_clockwise(project_root: Path) -> None:
    arm = load_arm(project_root / "config/arms/planar3.toml").planar()
    pose = hand_pose(arm.chain, arm.clamp, np.array([np.pi / 2, 0.0, 0.0])).array()
    np.testing.assert_allclose(pose, [0.0, 0.7, np.pi / 2], atol=1e-15)


@pytest.mark.parametrize("name", ["planar3", "ur5e-example", "fr3-example", "xarm6-example"])
def test_chain_agrees_with_mujoco_in_every_posture(project_root: Path, name: str) -> None:
    arm = load_arm(project_root / "config" / "arms" / f"{name}.toml").planar()
    data = mujoco.MjData(arm.model())
    for q in np.random.default_rng(3).uniform(-3.0, 3.0, (20, 3)):
        data.qpos[:] = posed(arm.model(), arm.held | dict(zip(arm.joints, q, strict=True))).qpos
        mujoco.mj_kinematics(arm.model(), data)
        bodies = [data.joint(joint).xanchor for joint in arm.joints] + [data.body(arm.clamp.link).xpos]
        np.testing.assert_allclose(link_points(arm.chain, q), np.array(bodies) @ arm.plane.T, atol=1e-12)


@pytest.mark.parametrize("name", ["ur5e-example", "fr3-example", "xarm6-example"])
def test_the_hands_angle_turns_with_mujocos_frame(project_root: Path, name: str) -> None:
    arm = load_arm(project_root / "config" / "arms" / f"{name}.toml").planar()
    data = mujoco.MjData(arm.model())
    for q in np.random.default_rng(4).uniform(-3.0, 3.0, (5, 3)):
        data.qpos[:] = posed(arm.model(), arm.held | dict(zip(arm.joints, q, strict=True))).qpos
        mujoco.mj_kinematics(arm.model(), data)
        tool = arm.plane @ data.body(arm.clamp.link).xmat.reshape(3, 3)[:, 2]
        angle = hand_pose(arm.chain, arm.clamp, q).angle_rad
        # The example's clamp points along the tool's z axis.
        np.testing.assert_allclose([np.cos(angle), np.sin(angle)], tool, atol=1e-12)


def test_clamp_offset_and_angle_move_the_hand(copy) -> None:
    path = copy(
        ("offset_m = [0.0, 0.0]", "offset_m = [0.02, 0.01]"), ("angle_rad = 0.0   ", "angle_rad = 0.5   ")
    )
    arm = load_arm(path).planar()
    pose = hand_pose(arm.chain, arm.clamp, np.array([np.pi / 2, 0.0, 0.0])).array()
    np.testing.assert_allclose(pose, [-0.01, 0.72, np.pi / 2 + 0.5], atol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"joint_3"]', '"joint_4"]', "throw.joints: the URDF has no moving joint 'joint_4'"),
        (
            '"joint_1", "joint_2", "joint_3"]',
            '"joint_1", "joint_2"]',
            "'joint_3' of the URDF neither moves nor",
        ),
        ("plane_y = [0, 0, 1]", "plane_y = [0, 1, 0]", "is 90.0° off the plane's normal"),
        ("plane_y = [0, 0, 1]", "plane_y = [1, 0, 1]", "are not at right angles"),
        (' velocity="10" effort="8"', ' effort="8"', "<joint name='joint_3'> <limit>: has no velocity"),
        ("[100, 100, 100]", "[100, 100]", "limits.acceleration_rad_s2: 2 numbers for 3 moving joints"),
        (
            ' velocity="10" effort="8"',
            ' velocity="nan" effort="8"',
            "limit velocity: 'nan' is not a number",
        ),
        (' velocity="10" effort="8"', ' velocity="10" effort="0"', "<limit>: effort=0 is not above 0"),
        ('lower="-2.0"', 'lower="2.5"', "leaves no range"),
        ('type="fixed"', 'type="floating"', "is of the type floating"),
        ("swallowed_m", "swalowed_m", "clamp.swalowed_m"),
        ('link = "grip"', 'link = "gripper"', "clamp.link: the URDF has no link 'gripper'"),
        (
            '"joint_1", "joint_2", "joint_3"]',
            '"joint_2", "joint_1", "joint_3"]',
            "not on the way from the joint",
        ),
        ('urdf = "planar3.urdf"', 'urdf = "nothing.urdf"', "nothing.urdf: the URDF is not there"),
        ("[clamp]", "[clamp", "is not TOML"),
    ],
)
def test_faults_name_file_field_and_value(copy, old: str, new: str, expected: str) -> None:
    message = refusal(copy((old, new)))
    assert expected in message
    assert "Fix:" in message


def test_a_joint_that_follows_another_is_neither_thrown_nor_led(copy) -> None:
    end = '<limit lower="-2.0" upper="2.0" velocity="10" effort="8"/>'
    follows = copy((end, f'{end}<mimic joint="joint_1" multiplier="-1"/>'))
    assert "throw.joints: 'joint_3' follows 'joint_1' (<mimic>)" in refusal(follows)
    held = ('"joint_1", "joint_2", "joint_3"]', '"joint_1", "joint_2"]')
    held = copy((end, f'{end}<mimic joint="joint_1"/>'), held, ("# wrist_2 = 0.0", "joint_3 = 0.0"))
    assert "throw.joints: 'joint_3' follows 'joint_1' (<mimic>)" in refusal(held)


@pytest.mark.parametrize(("angle", "fits"), [("2.0005", True), ("90.0", False)])
def test_a_held_joint_is_within_its_range(copy, angle: str, fits: bool) -> None:
    moving = ('"joint_1", "joint_2", "joint_3"]', '"joint_1", "joint_2"]')
    message = refusal(copy(moving, ("# wrist_2 = 0.0", f"joint_3 = {angle}")))  # its lists have three numbers
    assert ("throw.held.joint_3: 90 is not within -2 and 2" in message) is not fits


@pytest.mark.parametrize(("range_", "upper"), [('"-0.35" upper="2.8"', 2.78), ('"0" upper="0"', np.inf)])
def test_a_continuous_joint_may_have_a_range(copy, range_: str, upper: float) -> None:
    revolute = '<joint name="joint_1" type="revolute">'
    path = copy((revolute, revolute.replace("revolute", "continuous")), ('"-0.35" upper="2.8"', range_))
    assert load_arm(path).limits.upper_rad[0] == pytest.approx(upper)


def test_an_arm_on_a_ceiling_carries_its_links_the_other_way(copy, project_root: Path) -> None:
    standing = load_arm(project_root / "config" / "arms" / "planar3.toml")
    hanging = load_arm(copy(("plane_y = [0, 0, 1]", "plane_y = [0, 0, -1]")))
    q, still = np.array([[0.3, 0.4, -0.2]]), np.zeros((1, 3))
    for torques in ("dynamics", "spatial_dynamics"):
        up, down = (getattr(arm, torques).torques(q, still, still) for arm in (standing, hanging))
        np.testing.assert_allclose(down, -up, atol=1e-12)
        assert np.abs(up).max() > 0.1


def test_several_faults_are_reported_at_once(copy) -> None:
    message = refusal(
        copy(("[100, 100, 100]", "[100, 100]"), ("[62, 62, 62]", "[62]"), ("[-1.35, 1.35]", "[2, 1]"))
    )
    assert message.count("SC-F205") == 3


def test_jerk_and_margins_enter_the_limits(copy) -> None:
    arm = load_arm(
        copy(("# jerk_rad_s3 = [20000, 20000, 20000]", "jerk_rad_s3 = [20000, 20000, 10000]"))
    ).planar()
    np.testing.assert_allclose(arm.limits.jerk_rad_s3, [19000, 19000, 9500])
