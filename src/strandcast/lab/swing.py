"""One throw as it happens: arm and string from rest, through the motion, to the end of the recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.optimize import root

from strandcast.arm.load import Arm
from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.lab.rig import Grasp, Rig, build_rig
from strandcast.lab.servo import CYCLE_S, PRESETS, SetPoints, drive_of, set_points
from strandcast.lab.strings import Thread
from strandcast.lab.variation import Variation
from strandcast.player.protocol import Command

BEFORE_S = 0.5
AFTER_S = 0.6
STEP_S = 1.25e-4
SMALLEST_STEP_S = 1.5e-5
RUNAWAY_RAD_S = 2e4


@dataclass(frozen=True, eq=False)
class Swing:
    """What happened, every CYCLE_S, time counted from the motion's start.

    Attributes
    ----------
    time_s
        (K,)
    command_rad, command_rad_s
        (K, J) what the controller was told.
    q_rad, qd_rad_s
        (K, J) true joint angles and speeds.
    torque_n_m
        (K, J) given by the motors.
    nodes_m
        (K, N, 2) places of the string's nodes in the plane.
    places_m
        (N,) their places along the string.
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
    arm: Arm, servo: str, thread: Thread, variation: Variation, command: Command, step_s: float = STEP_S
) -> Swing:
    """Throw.

    Parameters
    ----------
    arm
        The arm.
    servo
        Name of a preset.
    thread
        The string as it is; the variation changes how it is held.
    variation
        This throw's deviations.
    command
        The motion, from rest to rest.
    step_s
        Step of the integration [s]; halved as long as the string runs away.

    Raises
    ------
    StrandcastError
        SC-L010 the string runs away at the smallest step too.
    """
    preset = PRESETS[servo]
    drive = drive_of(arm, preset)
    time_s = (
        np.arange(round(-BEFORE_S / CYCLE_S), round((command.time_s[-1] + AFTER_S) / CYCLE_S) + 1) * CYCLE_S
    )
    told = _held(command, time_s)
    aims = set_points(arm, preset, drive, *told)
    hanging = thread.shifted(variation.grasp_length_m)
    grasp = Grasp(variation.grasp_lateral_m, variation.grasp_angle_rad)
    # What runs away is tried again with half the step: no word of MuJoCo's, and no log file, is wanted.
    mujoco.set_mju_user_warning(_silent)
    while step_s >= SMALLEST_STEP_S:
        rig = build_rig(arm, drive, hanging, grasp, step_s)
        loop = Loop(
            drive.stiffness * variation.servo_gain,
            drive.damping * variation.servo_gain,
            drive.torque_n_m,
            variation.joint_zero_rad,
        )
        recorded = _run(rig, loop, aims, variation)
        if recorded is not None:
            q, qd, torque, nodes = recorded
            return Swing(time_s, told[0], told[1], q, qd, torque, nodes, rig.places_m)
        step_s *= 0.5
    raise StrandcastError(
        "SC-L010",
        f"the virtual string runs away even at a step of {2 * step_s:.1e} s",
        field="lab.string",
        fix="a softer motion, or a string with more bending stiffness",
        exit_code=FAILED_TRIALS,
    )


def _held(command: Command, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the command at the controller's cycles: linear between its samples, held before and after."""
    columns = range(command.q_rad.shape[1])
    q, qd, qdd = (
        np.stack([np.interp(time_s, command.time_s, block[:, j]) for j in columns], axis=1)
        for block in (command.q_rad, command.qd_rad_s, command.qdd_rad_s2)
    )
    return q, qd, qdd


@dataclass(frozen=True, eq=False)
class Loop:
    """Gains of the loops (J,) and the encoders' zero errors (true angle = encoder's + zero)."""

    stiffness: np.ndarray
    damping: np.ndarray
    limit_n_m: np.ndarray
    zero_rad: np.ndarray

    def torque(self, aims: SetPoints, k: int, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return the torques (J,) of the motors at cycle k with the joints at q and moving at qd."""
        wanted = (
            self.stiffness * (aims.q_rad[k] + self.zero_rad - q)
            + self.damping * (aims.qd_rad_s[k] - qd)
            + aims.torque_n_m[k]
        )
        return np.clip(wanted, -self.limit_n_m, self.limit_n_m)


def _run(rig: Rig, loop: Loop, aims: SetPoints, variation: Variation) -> tuple[np.ndarray, ...] | None:
    """Return angles, speeds, torques and nodes at every cycle; None if the string ran away."""
    model, dofs = rig.model, rig.arm_dofs
    data = mujoco.MjData(model)
    data.qpos[:] = at_rest(rig, loop, aims)
    data.qpos[rig.string_dofs[0]] += variation.sway_rad
    data.qvel[rig.string_dofs[0]] = variation.sway_rad_s
    mujoco.mj_forward(model, data)
    count, joints = aims.q_rad.shape
    steps = round(CYCLE_S / model.opt.timestep)
    motion = np.empty((3, count, joints))
    nodes = np.empty((count, len(rig.nodes), 2))
    for k in range(count):
        motion[0, k], motion[1, k] = data.qpos[dofs], data.qvel[dofs]
        nodes[k] = rig.nodes_m(data)
        motion[2, k] = data.qfrc_applied[dofs] = loop.torque(aims, k, motion[0, k], motion[1, k])
        mujoco.mj_step(model, data, steps)
        if not np.abs(data.qvel).max() < RUNAWAY_RAD_S:
            return None
        mujoco.mj_kinematics(model, data)
    return motion[0], motion[1], motion[2], nodes


def at_rest(rig: Rig, loop: Loop, aims: SetPoints) -> np.ndarray:
    """Return the coordinates at which the loops, the weights and the bent string are in balance.

    The arm sags a little below its aim where nothing is put in ahead; the string hangs, curled.
    """
    model = rig.model
    data = mujoco.MjData(model)
    free = np.concatenate([rig.arm_dofs, rig.string_dofs])
    start = np.zeros(model.nq)
    for dof, angle in rig.held.items():
        start[dof] = angle
    start[rig.arm_dofs] = aims.q_rad[0]
    data.qpos[:] = start
    mujoco.mj_kinematics(model, data)
    first, second = rig.nodes_m(data)[:2]
    direction = np.arctan2(*(second - first)[::-1])
    start[rig.string_dofs[0]] = _wrapped(-0.5 * np.pi - direction)

    def unbalanced(x: np.ndarray) -> Any:
        data.qpos[:] = start
        data.qpos[free] = x
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        force = data.qfrc_passive - data.qfrc_bias
        force[rig.arm_dofs] += loop.torque(aims, 0, data.qpos[rig.arm_dofs], np.zeros(len(rig.arm_dofs)))
        return force[free] / scale

    scale = 1.0
    scale = np.maximum(np.abs(unbalanced(start[free] + 0.3)), 1e-9)
    answer = root(unbalanced, start[free], tol=1e-12)
    start[free] = answer.x
    return start


def _silent(_: str) -> None:
    pass


def _wrapped(angle: float) -> float:
    return float(np.arctan2(np.sin(angle), np.cos(angle)))
