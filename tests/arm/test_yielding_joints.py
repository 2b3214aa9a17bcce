"""Yielding joints move as MuJoCo's on springs and dampers, and are found from a log of theirs."""

from copy import copy
from pathlib import Path

import mujoco
import numpy as np
import pytest

from strandcast.arm.load import Arm, load_arm
from strandcast.arm.servo import identify
from strandcast.arm.urdf import posed
from strandcast.arm.yielding_joints import YieldingJoints, follow, identify_yielding

ARMS = ("config/arms/fr3-space.toml", "config/arms/planar3.toml")
STEP_S, CYCLE_S, DELAY_S, SETTLED_S = 2e-3, 5e-4, 4e-3, 8.0
FREQUENCY_RAD_S, DAMPING_RATIO, ARMATURE_KG_M2 = 25.0, 0.9, 0.05
TIME_S = np.arange(0.0, 1.0 + 0.5 * STEP_S, STEP_S)
ENCODER_RAD = 2e-4


@pytest.fixture(scope="module", params=ARMS, ids=["space", "plane"])
def arm(project_root: Path, request: pytest.FixtureRequest) -> Arm:
    return load_arm(project_root / request.param)


def command(arm: Arm, seed: int, amplitude_rad: float) -> np.ndarray:
    """A swing of all joints (T, J) from rest to rest in 0.7 s."""
    start = np.array([0.3, 0.4, -0.2, -1.8, 0.1, 1.9, 0.5])[: len(arm.joints)]
    s = np.clip(TIME_S / 0.7, 0.0, 1.0)
    shape = np.stack([s**3 * (10.0 - 15.0 * s + 6.0 * s**2), (s * (1.0 - s)) ** 3 * 64.0])
    ways = np.random.default_rng(seed).uniform(-amplitude_rad, amplitude_rad, (len(start), 2))
    return np.asarray(start + (ways @ shape).T)


def loops(arm: Arm, share: float, carried: float = 0.0) -> YieldingJoints:
    """Loops of one frequency with the arm at zero."""
    dynamics = arm.spatial_dynamics
    inertia = np.diag(dynamics.mass_matrix(np.zeros(len(arm.joints)))) + ARMATURE_KG_M2
    stiffness = inertia * FREQUENCY_RAD_S**2
    damping = 2.0 * DAMPING_RATIO * inertia * FREQUENCY_RAD_S
    rest = [np.full(len(inertia), value) for value in (ARMATURE_KG_M2, share, DELAY_S)]
    return YieldingJoints(dynamics, np.array([stiffness, damping, *rest]), carried)


def on_springs(arm: Arm, commands: np.ndarray, share: float = 1.0, carried: float = 0.0) -> np.ndarray:
    """The joints (T, J) of the arm in MuJoCo, on springs and dampers, a share of gravity carried."""
    stiffness, damping, armature, _, _ = loops(arm, share).loops
    model = copy(arm.model_with_payload())  # the arm's own is shared
    data = mujoco.MjData(model)
    model.opt.timestep = CYCLE_S
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    dofs = [int(model.joint(name).dofadr[0]) for name in arm.joints]
    held = sorted(set(range(model.nv)) - set(dofs))
    model.dof_armature[dofs], model.dof_armature[held] = armature, 1e9
    time_s = np.arange(-SETTLED_S, TIME_S[-1] + 0.5 * CYCLE_S, CYCLE_S)
    delayed = np.stack([np.interp(time_s - DELAY_S, TIME_S, c) for c in commands.T], axis=1)
    rate = np.gradient(delayed, CYCLE_S, axis=0)
    data.qpos[:] = posed(arm.model(), arm.held | dict(zip(arm.joints, commands[0], strict=True))).qpos
    still = mujoco.MjData(model)
    answer = np.empty_like(delayed)
    for k in range(len(time_s)):
        mujoco.mj_forward(model, data)
        answer[k] = data.qpos[dofs]
        off, speed = delayed[k] - data.qpos[dofs], share * rate[k] - data.qvel[dofs]
        still.qpos[:] = data.qpos
        mujoco.mj_forward(model, still)
        data.qfrc_applied[dofs] = stiffness * off + damping * speed + carried * still.qfrc_bias[dofs]
        data.qfrc_applied[held] = data.qfrc_bias[held]
        mujoco.mj_step(model, data)
    return np.asarray(answer[time_s > -0.5 * CYCLE_S][:: round(STEP_S / CYCLE_S)])


@pytest.mark.parametrize(("share", "carried"), [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
def test_they_move_as_mujocos(arm: Arm, share: float, carried: float) -> None:
    swing = command(arm, 1, 1.0)
    expected = on_springs(arm, swing, share, carried)
    found = follow(loops(arm, share, carried), TIME_S, swing)
    yielded_rad = np.abs(expected - swing).max(axis=0)
    assert (yielded_rad > 0.01).all()
    assert np.sqrt(np.mean((found - expected) ** 2)) < 5e-4


@pytest.mark.parametrize("carried", [pytest.param(0.0, marks=pytest.mark.thorough), 1.0])
def test_a_log_tells_how_they_follow_another_motion(arm: Arm, carried: float) -> None:
    played, other = command(arm, 1, 1.0), command(arm, 1, 1.0) + command(arm, 2, 0.3) - command(arm, 2, 0.0)
    noise = ENCODER_RAD * np.random.default_rng(3).standard_normal(played.shape)
    seen = on_springs(arm, played, carried=carried) + noise
    truth = arm.hand_m(on_springs(arm, other, carried=carried))
    yielding, left_rad = identify_yielding(TIME_S, played[None], seen[None], arm.spatial_dynamics)
    servo, _ = identify(TIME_S, played[None], seen[None], arm.servo)
    assert left_rad.max() < 3.0 * ENCODER_RAD

    def missed_m(joints: object) -> float:
        """How far the hand is from where it goes, with the error of the log's motion taken off."""
        q = follow(joints, TIME_S, other) + seen - follow(joints, TIME_S, played)  # type: ignore[arg-type]
        return float(np.sqrt(np.mean(((arm.hand_m(q) - truth) ** 2).sum(axis=1))))

    assert missed_m(yielding) < 1e-3
    assert missed_m(yielding) < 0.1 * missed_m(servo)
