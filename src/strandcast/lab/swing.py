"""Simulate one throw: arm and string from rest, through the motion, to the end of the recording."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import scipy

from strandcast.arm.load import Arm, PlanarArm, clamp_frame
from strandcast.core.interpolation import resampled
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.lab.rig import LabRig, SlipInClamp, build_rig
from strandcast.lab.servo import CYCLE_S, SERVO_PRESETS, JointDrives, ServoSetPoints, joint_drives, set_points
from strandcast.lab.strings import PhysicalString
from strandcast.lab.variation import ThrowVariation

# Chosen.
BEFORE_S = 0.5
AFTER_S = 0.6
STEP_S = 1.25e-4
MIN_STEP_S = 1.5e-5
DIVERGED_RAD_S = 2e4


@dataclass(frozen=True, eq=False)
class LabSwing:
    """A simulated throw, every CYCLE_S; times since the motion's start.

    Attributes
    ----------
    time_s
        (K,)
    command_rad, command_rad_s
        (K, J) commanded angles and speeds.
    q_rad, qd_rad_s
        (K, J) true joint angles and speeds.
    torque_n_m
        (K, J) motor torques.
    nodes_m
        (K, N, 2) positions of the string's nodes in the plane, or (K, N, 3) in space.
    places_m
        (N,) their positions along the string.
    """

    time_s: np.ndarray
    command_rad: np.ndarray
    command_rad_s: np.ndarray
    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    torque_n_m: np.ndarray
    nodes_m: np.ndarray
    places_m: np.ndarray


def simulate_swing(
    arm: PlanarArm,
    servo: str,
    string: PhysicalString,
    variation: ThrowVariation,
    command: JointTrajectory,
    step_s: float = STEP_S,
    slip: SlipInClamp | None = None,
) -> LabSwing:
    """Simulate a throw.

    Parameters
    ----------
    servo
        Name of a preset.
    string
        The string; the variation changes how it is held.
    command
        The motion, from rest to rest.
    step_s
        Step of the integration [s]; halved while the string diverges.
    slip
        If given, the clamp lets the string slip.

    Raises
    ------
    StrandcastError
        SC-E003 the string diverges even at the smallest step.
    """
    hanging = string.shifted(variation.grasp_length_m)
    held = clamp_frame(arm, variation.grasp_lateral_m, variation.grasp_angle_rad)

    def begin(rig: LabRig, loop: ServoLoop, points: ServoSetPoints) -> tuple[np.ndarray, np.ndarray]:
        place, speed = at_rest(rig, loop, points), np.zeros(rig.model.nv)
        place[rig.string_dofs[0]] += variation.sway_rad
        speed[rig.string_dofs[0]] = variation.sway_rad_s
        return place, speed

    return swing_on(
        arm,
        servo,
        variation,
        command,
        lambda drive, step_s: build_rig(arm, drive, hanging, held, step_s, slip),
        begin,
        step_s=step_s,
    )


Begin = Callable[["LabRig", "ServoLoop", ServoSetPoints], tuple[np.ndarray, np.ndarray]]


def swing_on(
    arm: Arm,
    servo: str,
    variation: ThrowVariation,
    command: JointTrajectory,
    make_rig: Callable[[JointDrives, float], LabRig],
    begin: Begin,
    *,
    step_s: float = STEP_S,
) -> LabSwing:
    """Simulate a throw on a rig.

    Parameters
    ----------
    arm, servo, variation, command, step_s
        See `simulate_swing`; of the variation, what concerns the joints.
    make_rig
        Returns the rig from the joints' motors and the step of the integration [s].
    begin
        Returns the rig's coordinates and speeds at the recording's start.

    Raises
    ------
    StrandcastError
        See `simulate_swing`.
    """
    preset = SERVO_PRESETS[servo]
    drive = joint_drives(arm, preset)
    time_s = (
        np.arange(round(-BEFORE_S / CYCLE_S), round((command.time_s[-1] + AFTER_S) / CYCLE_S) + 1) * CYCLE_S
    )
    command = _at_cycles(command, time_s)
    points = set_points(arm, preset, drive, command)
    # A diverged run is repeated with half the step; suppress MuJoCo's warning and its log file.
    mujoco.set_mju_user_warning(lambda _: None)
    while step_s >= MIN_STEP_S:
        rig = make_rig(drive, step_s)
        loop = ServoLoop(
            drive.stiffness * variation.servo_gain,
            drive.damping * variation.servo_gain,
            drive.torque_n_m,
            variation.joint_zero_rad,
        )
        recorded = _run(rig, loop, points, begin, time_s)
        if recorded is not None:
            q, qd, torque, nodes = recorded
            return LabSwing(time_s, command.q_rad, command.qd_rad_s, q, qd, torque, nodes, rig.places_m)
        step_s *= 0.5
    raise StrandcastError(
        "SC-E003",
        f"the virtual string diverges even at a step of {2 * step_s:.1e} s",
        field="lab.string",
        fix="plan a gentler motion, or give the string more bending stiffness",
        exit_code=FAILED_TRIALS,
    )


def _at_cycles(command: JointTrajectory, time_s: np.ndarray) -> JointTrajectory:
    """Return the command at the controller's cycles: linear between samples, constant before and after."""
    q, qd, qdd = (
        resampled(time_s, command.time_s, block)
        for block in (command.q_rad, command.qd_rad_s, command.qdd_rad_s2)
    )
    return JointTrajectory(time_s, q, qd, qdd)


@dataclass(frozen=True, eq=False)
class ServoLoop:
    """Gains and torque limits of the loops (J,), and the encoders' zero errors (true = encoder + zero)."""

    stiffness: np.ndarray
    damping: np.ndarray
    limit_n_m: np.ndarray
    zero_rad: np.ndarray

    def torque(self, points: ServoSetPoints, k: int, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return the motor torques (J,) at cycle k, at angles q and speeds qd."""
        wanted = (
            self.stiffness * (points.q_rad[k] + self.zero_rad - q)
            + self.damping * (points.qd_rad_s[k] - qd)
            + points.torque_n_m[k]
        )
        return np.asarray(np.clip(wanted, -self.limit_n_m, self.limit_n_m))


def _run(
    rig: LabRig, loop: ServoLoop, points: ServoSetPoints, begin: Begin, time_s: np.ndarray
) -> tuple[np.ndarray, ...] | None:
    """Return angles, speeds, torques and nodes at every cycle; None if the string diverged."""
    model, dofs = rig.model, rig.arm_dofs
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = begin(rig, loop, points)
    mujoco.mj_forward(model, data)
    count, joints = points.q_rad.shape
    steps = round(CYCLE_S / model.opt.timestep)
    motion = np.empty((3, count, joints))
    nodes = np.empty((count, len(rig.nodes), len(rig.plane)))
    for k in range(count):
        motion[0, k], motion[1, k] = data.qpos[dofs], data.qvel[dofs]
        nodes[k] = rig.nodes_m(data)
        if rig.slide is not None:
            dof, slip = rig.slide
            data.qvel[dof] = slip.speed_m_s(time_s[k] + 0.5 * CYCLE_S)
        motion[2, k] = data.qfrc_applied[dofs] = loop.torque(points, k, motion[0, k], motion[1, k])
        mujoco.mj_step(model, data, steps)
        if not np.abs(data.qvel).max() < DIVERGED_RAD_S:
            return None
        mujoco.mj_kinematics(model, data)
    return motion[0], motion[1], motion[2], nodes


def at_rest(rig: LabRig, loop: ServoLoop, points: ServoSetPoints) -> np.ndarray:
    """Return the coordinates at which loops, weights and the bent string are in equilibrium.

    Without feed-forward the arm sags a little below its set point; the string hangs, curled.
    """
    data, start, free = arm_at_start(rig, points)
    first, second = rig.nodes_m(data)[:2]
    direction = np.arctan2(*(second - first)[::-1])
    turn = -0.5 * np.pi - direction
    start[rig.string_dofs[0]] = np.arctan2(np.sin(turn), np.cos(turn))

    def unbalanced(x: np.ndarray) -> Any:
        data.qpos[:] = start
        data.qpos[free] = x
        return force_at_rest(rig, loop, points, data)[free] / scale

    scale = 1.0
    scale = np.maximum(np.abs(unbalanced(start[free] + 0.3)), 1e-9)
    answer = scipy.optimize.root(unbalanced, start[free], tol=1e-12)
    start[free] = answer.x
    return start


def arm_at_start(rig: LabRig, points: ServoSetPoints) -> tuple[mujoco.MjData, np.ndarray, np.ndarray]:
    """Return a state with the arm at its first set points, its coordinates, and which dofs are free."""
    data = mujoco.MjData(rig.model)
    start = np.array(rig.model.qpos0)
    for dof, angle in rig.held.items():
        start[dof] = angle
    start[rig.arm_dofs] = points.q_rad[0]
    data.qpos[:] = start
    mujoco.mj_kinematics(rig.model, data)
    return data, start, np.concatenate([rig.arm_dofs, rig.string_dofs])


def force_at_rest(rig: LabRig, loop: ServoLoop, points: ServoSetPoints, data: mujoco.MjData) -> np.ndarray:
    """Return the forces that accelerate each degree of freedom of a state, which is given no speed."""
    data.qvel[:] = 0.0
    mujoco.mj_forward(rig.model, data)
    force = data.qfrc_passive - data.qfrc_bias
    force[rig.arm_dofs] += loop.torque(points, 0, data.qpos[rig.arm_dofs], np.zeros(len(rig.arm_dofs)))
    return np.asarray(force)
