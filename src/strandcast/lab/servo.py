"""Servos by name: command smoothing, feed-forward, stiff or soft loop, limited torque."""

from dataclasses import dataclass

import mujoco
import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.urdf import dofs_of, inverse_torques, posed, read_joint_limits
from strandcast.core.trajectory import JointTrajectory

CYCLE_S = 5e-4  # of the joints' controller
TRANSPORT_S = 0.004  # UR: 34 ms measured at a look-ahead of 30 ms
DAMPING_RATIO = 0.9  # chosen
# Rotor inertia and friction of a geared joint, in proportion to its largest torque (chosen).
ARMATURE_PER_TORQUE = 1.0 / 1200.0
FRICTION_PER_TORQUE = 1.0 / 150.0


@dataclass(frozen=True)
class ServoPreset:
    """A kind of servo.

    Attributes
    ----------
    look_ahead_s
        Delay by the smoothing of the command [s].
    feed_forward
        Whether the arm's dynamics are fed forward (the string's never are).
    natural_frequency_rad_s
        Natural frequency of the loop with the arm stretched out.
    torque_share
        Share of the URDF's effort available from the motors.
    """

    look_ahead_s: float
    feed_forward: bool
    natural_frequency_rad_s: float
    torque_share: float = 1.0


SERVO_PRESETS = {
    "servoj": ServoPreset(0.030, True, 65.0),
    "stiff": ServoPreset(0.0, True, 65.0),
    "pd": ServoPreset(0.0, False, 65.0),
    "soft": ServoPreset(0.0, False, 25.0),
    "weak": ServoPreset(0.030, True, 65.0, torque_share=0.4),
}


@dataclass(frozen=True, eq=False)
class JointDrives:
    """The joints' motors, (J,) each in SI units: loop gains, torque limit, rotor inertia and friction."""

    stiffness: np.ndarray
    damping: np.ndarray
    torque_n_m: np.ndarray
    armature: np.ndarray
    friction: np.ndarray


def joint_drives(arm: Arm, preset: ServoPreset) -> JointDrives:
    """Return motors whose loops have the preset's frequency with the arm stretched out."""
    limits = read_joint_limits(arm.urdf_path)
    effort = np.array([limits[name].effort_n_m for name in arm.joints], float)
    armature = effort * ARMATURE_PER_TORQUE
    model, data = arm.model(), posed(arm.model(), arm.held)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    inertia = np.diag(full)[dofs_of(model, arm.joints)] + armature
    w = preset.natural_frequency_rad_s
    return JointDrives(
        stiffness=inertia * w**2,
        damping=2.0 * DAMPING_RATIO * inertia * w,
        torque_n_m=effort * preset.torque_share,
        armature=armature,
        friction=effort * FRICTION_PER_TORQUE,
    )


@dataclass(frozen=True, eq=False)
class ServoSetPoints:
    """Set points of the loops, every CYCLE_S: angles, speeds and feed-forward torques, (K, J) each."""

    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    torque_n_m: np.ndarray


def set_points(arm: Arm, preset: ServoPreset, drive: JointDrives, command: JointTrajectory) -> ServoSetPoints:
    """Return the loops' set points for a command (K, J) every CYCLE_S that begins at rest."""
    delay = round(TRANSPORT_S / CYCLE_S)
    blocks = (command.q_rad, command.qd_rad_s, command.qdd_rad_s2)
    q, qd, qdd = (np.concatenate([x[:1].repeat(delay, axis=0), x[: len(x) - delay]]) for x in blocks)
    if preset.look_ahead_s > 0:
        q, qd, qdd = _smoothed(q, preset.look_ahead_s)
    if preset.feed_forward:
        torques = inverse_torques(posed(arm.model(), arm.held), dofs_of(arm.model(), arm.joints), q, qd, qdd)
        feed_forward = torques + drive.armature * qdd + drive.friction * qd
    else:
        feed_forward = np.zeros_like(q)
    return ServoSetPoints(q, qd, feed_forward)


def _smoothed(q: np.ndarray, lag_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angles, speeds and accelerations after a critically damped filter with a lag of `lag_s`."""
    w = 2.0 / lag_s
    # Implicit midpoint: second order, and at rest exactly the command.
    h = CYCLE_S
    x, v = q[0].copy(), np.zeros(q.shape[1])
    out = np.empty((3, *q.shape))
    for k in range(len(q)):
        target = 0.5 * (q[k] + q[max(k - 1, 0)])
        a = (w * w * (target - x - 0.5 * h * v) - 2.0 * w * v) / (1.0 + w * h + 0.25 * w * w * h * h)
        x, v = x + h * v + 0.5 * h * h * a, v + h * a
        out[:, k] = x, v, a
    return out[0], out[1], out[2]
