from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.optimize import curve_fit

from strandcast.arm.load import PlanarArm, clamp_frame, load_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.lab.rig import build_rig, links_of, weight_radius_m
from strandcast.lab.servo import CYCLE_S, SERVO_PRESETS, ServoSetPoints, joint_drives
from strandcast.lab.strings import PAPER_STRINGS, PhysicalString
from strandcast.lab.swing import STEP_S, LabSwing, ServoLoop, at_rest, simulate_swing
from strandcast.lab.variation import ThrowVariation, draw_variation

from .conftest import swing_command

QUIET = draw_variation(np.random.default_rng(0), 3, 0.0)


def still(q: tuple[float, float, float], duration_s: float) -> JointTrajectory:
    time_s = np.array([0.0, duration_s])
    zero = np.zeros((2, 3))
    return JointTrajectory(time_s, np.array([q, q]), zero, zero)


def throw(arm: PlanarArm, name: str, step_s: float = STEP_S, variation: ThrowVariation = QUIET) -> LabSwing:
    return simulate_swing(arm, "servoj", PAPER_STRINGS[name], variation, swing_command(), step_s)


@pytest.fixture(scope="module")
def plain(arm: PlanarArm) -> LabSwing:
    return throw(arm, "paper-1")


@pytest.mark.parametrize("name", ["paper-4", pytest.param("paper-5", marks=pytest.mark.thorough)])
def test_string_keeps_its_length_and_the_step_does_not_matter(arm: PlanarArm, name: str) -> None:
    swing = throw(arm, name)
    lengths = np.linalg.norm(np.diff(swing.nodes_m, axis=1), axis=2)
    np.testing.assert_allclose(lengths, np.broadcast_to(np.diff(swing.places_m), lengths.shape), atol=1e-12)
    finer = throw(arm, name, STEP_S / 2)
    assert np.linalg.norm(swing.nodes_m - finer.nodes_m, axis=2).max() < 1e-5
    speed = np.linalg.norm(np.diff(swing.nodes_m[:, -1], axis=0), axis=1).max() / CYCLE_S
    assert 3.0 < speed < 30.0


def test_string_hangs_still_until_the_arm_moves(arm: PlanarArm) -> None:
    swing = throw(arm, "paper-7")
    before = swing.nodes_m[swing.time_s <= 0.0]
    assert np.ptp(before, axis=0).max() < 1e-9
    assert swing.nodes_m[0, -1, 0] == pytest.approx(swing.nodes_m[0, 0, 0], abs=0.08)
    assert swing.nodes_m[0, -1, 1] < swing.nodes_m[0, 0, 1] - 0.55


def test_pipe_stays_straight(arm: PlanarArm) -> None:
    swing = throw(arm, "paper-6")
    on_pipe = (swing.places_m >= 0.4 - 1e-9) & (swing.places_m <= 0.5 + 1e-9)
    pipe = swing.nodes_m[:, on_pipe]
    chord = np.linalg.norm(pipe[:, -1] - pipe[:, 0], axis=1)
    np.testing.assert_allclose(chord, 0.1, atol=1e-12)
    assert on_pipe.sum() == 8


def test_weights_and_pipes_lie_on_link_ends() -> None:
    links = links_of(PAPER_STRINGS["paper-5"])
    assert sum(link.weight_kg for link in links) == pytest.approx(0.010)
    assert [link.to_m for link in links if link.weight_kg > 0] == [pytest.approx(0.170)]
    assert sum(link.pipe_kg for link in links) == pytest.approx(0.0015)


def test_small_swings_have_the_period_of_a_pendulum(arm: PlanarArm) -> None:
    length, density, mass = 0.3, 0.001, 0.010
    string = PhysicalString(length, density, 1e-10, 0.0, 0.001, ((length, mass),))
    sway = ThrowVariation(0.0, 0.0, 0.0, 0.02, 0.0, np.zeros(3), np.ones(3), 0.0)
    swing = simulate_swing(arm, "stiff", string, sway, still((0.8, -0.8, -1.5), 1.4))
    tip = swing.nodes_m[:, -1, 0] - swing.nodes_m[:, 0, 0]

    def wave(t: np.ndarray, a: float, w: float, p: float, c: float, d: float) -> np.ndarray:
        return a * np.exp(-d * t) * np.cos(w * t + p) + c

    (_, found, *_), _ = curve_fit(wave, swing.time_s + 0.5, tip, p0=(0.006, 5.7, 0.0, 0.0, 0.0))
    line, ball = density * length, 0.4 * weight_radius_m(mass) ** 2
    # A light string is straight in its lowest mode, to first order in line/mass.
    moment = mass * (length**2 + ball) + line * length**2 / 3
    expected = np.sqrt(9.81 * (mass * length + line * length / 2) / moment)
    assert found == pytest.approx(expected, rel=2e-3)


def test_stiff_string_sags_like_a_cantilever(arm: PlanarArm) -> None:
    length, density, stiffness = 0.3, 0.003, 0.02
    string = PhysicalString(length, density, stiffness, 0.0, 0.003)
    drive = joint_drives(arm, SERVO_PRESETS["stiff"])
    rig = build_rig(arm, drive, string, clamp_frame(arm), STEP_S)
    stretched = ServoSetPoints(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
    rigid = ServoLoop(np.full(3, 1e6), np.ones(3), np.full(3, 1e6), np.zeros(3))
    data = mujoco.MjData(rig.model)
    data.qpos[:] = at_rest(rig, rigid, stretched)
    mujoco.mj_kinematics(rig.model, data)
    nodes = rig.nodes_m(data)
    sag = nodes[0, 1] - nodes[-1, 1]
    assert sag == pytest.approx(density * 9.81 * length**4 / (8 * stiffness), rel=0.02)


@pytest.mark.thorough
def test_each_servo_has_its_own_lag(arm: PlanarArm, plain: LabSwing) -> None:
    lags = {}
    stiff, soft = (
        simulate_swing(arm, name, PAPER_STRINGS["paper-1"], QUIET, swing_command())
        for name in ("stiff", "soft")
    )
    for name, swing in {"servoj": plain, "stiff": stiff, "soft": soft}.items():
        command, measured = swing.command_rad, swing.q_rad
        count = 120
        gaps = [((measured[count:] - command[count - k : len(command) - k]) ** 2).sum() for k in range(count)]
        lags[name] = int(np.argmin(gaps)) * CYCLE_S
    assert lags["servoj"] == pytest.approx(0.034, abs=0.002)
    assert lags["stiff"] == pytest.approx(0.0045, abs=0.0015)
    assert 0.010 < lags["soft"] < 0.035


def test_variation_scales_and_moves_the_tip_by_millimetres(arm: PlanarArm, plain: LabSwing) -> None:
    rng = np.random.default_rng(3)
    varied = throw(arm, "paper-1", variation=draw_variation(rng, 3, 1.0))
    moved = np.linalg.norm(varied.nodes_m[:, -1] - plain.nodes_m[:, -1], axis=1)
    in_motion = moved[(varied.time_s > 0) & (varied.time_s < 0.35)]
    assert 0.001 < np.sqrt((in_motion**2).mean()) < 0.03
    assert QUIET.grasp_length_m == 0.0
    assert (QUIET.servo_gain == 1.0).all()


def test_weak_motors_stay_within_their_torque(arm: PlanarArm) -> None:
    swing = simulate_swing(
        arm, "weak", PAPER_STRINGS["paper-1"], QUIET, swing_command(0.2, by=(1.5, 1.5, 1.5))
    )
    np.testing.assert_allclose(np.abs(swing.torque_n_m).max(axis=0)[0], 0.4 * 60.0)
    assert np.abs(swing.q_rad[-1] - swing.command_rad[-1]).max() < 0.01


def test_an_arm_with_a_held_joint_throws_like_the_planar_one(
    arm: PlanarArm, plain: LabSwing, tmp_path: Path
) -> None:
    """A turret below the arm, held askew: the same throw in a turned plane."""
    yaw = 0.7
    turret = (
        '<joint name="yaw" type="revolute"><parent link="base"/><child link="turret"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="3" effort="50"/></joint><link name="turret"/>'
    )
    urdf = arm.urdf_path.read_text()
    urdf = urdf.replace('<parent link="base"/>', '<parent link="turret"/>')
    urdf = urdf.replace('<link name="base"/>', f'<link name="base"/>{turret}')
    (tmp_path / "planar3.urdf").write_text(urdf)
    toml = arm.path.read_text()
    toml = toml.replace("plane_x = [1, 0, 0]", f"plane_x = [{np.cos(yaw)}, {np.sin(yaw)}, 0]")
    toml = toml.replace("[throw.held]", f"[throw.held]\nyaw = {yaw}\n#")
    (tmp_path / "turned.toml").write_text(toml)
    turned = throw(load_arm(tmp_path / "turned.toml").planar(), "paper-1")
    in_motion = plain.time_s < 0.4
    np.testing.assert_allclose(turned.nodes_m[in_motion], plain.nodes_m[in_motion], atol=1e-6)
