"""Servos by name: smoothing of the command, feed-forward, a stiff or soft loop, limited torque."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.urdf import read_joint_limits

CYCLE_S = 5e-4  # of the joints' controller
TRANSPORT_S = 0.004
DAMPING_RATIO = 0.9
# Rotor inertia and friction of a geared joint, taken in proportion to the torque that it can give.
ARMATURE_PER_TORQUE = 1.0 / 1200.0
FRICTION_PER_TORQUE = 1.0 / 150.0


@dataclass(frozen=True)
class Preset:
    """A kind of servo.

    Attributes
    ----------
    look_ahead_s
        By how much the smoothing of the command delays it [s].
    feed_forward
        Whether the arm's own dynamics are put in ahead (the string's never are).
    natural_frequency_rad_s
        Of the loop, with the arm stretched out.
    torque_share
        Of the URDF's effort that the motors can give.
    """

    look_ahead_s: float
    feed_forward: bool
    natural_frequency_rad_s: float
    torque_share: float = 1.0


PRESETS = {
    "servoj": Preset(0.030, True, 65.0),
    "stiff": Preset(0.0, True, 65.0),
    "pd": Preset(0.0, False, 65.0),
    "soft": Preset(0.0, False, 25.0),
    "weak": Preset(0.030, True, 65.0, torque_share=0.4),
}


@dataclass(frozen=True, eq=False)
class Drive:
    """The joints' motors, (J,) each: loop gains, torque limit, rotor inertia and friction, SI units."""

    stiffness: np.ndarray
    damping: np.ndarray
    torque_n_m: np.ndarray
    armature: np.ndarray
    friction: np.ndarray


def drive_of(arm: Arm, preset: Preset) -> Drive:
    """Return the motors of an arm whose loops have the preset's frequency with the arm stretched out."""
    said = read_joint_limits(arm.urdf_path)
    effort = np.array([said[name].effort_n_m for name in arm.joints], float)
    armature = effort * ARMATURE_PER_TORQUE
    inertia = np.diag(_mass_matrix(arm)) + armature
    w = preset.natural_frequency_rad_s
    return Drive(
        stiffness=inertia * w**2,
        damping=2.0 * DAMPING_RATIO * inertia * w,
        torque_n_m=effort * preset.torque_share,
        armature=armature,
        friction=effort * FRICTION_PER_TORQUE,
    )


def _mass_matrix(arm: Arm) -> np.ndarray:
    model = arm.model()
    data = mujoco.MjData(model)
    data.qpos[:] = arm.coordinates(np.zeros(len(arm.joints)))
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    at = [int(model.joint(name).dofadr[0]) for name in arm.joints]
    return full[np.ix_(at, at)]


@dataclass(frozen=True, eq=False)
class SetPoints:
    """What the loops aim at, every CYCLE_S: angles and speeds (K, J), torque put in ahead (K, J)."""

    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    torque_n_m: np.ndarray


def set_points(
    arm: Arm, preset: Preset, drive: Drive, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> SetPoints:
    """Return what the loops aim at from the command, (K, J) each, every CYCLE_S, at rest at the beginning."""
    late = round(TRANSPORT_S / CYCLE_S)
    q, qd, qdd = (np.concatenate([x[:1].repeat(late, axis=0), x[: len(x) - late]]) for x in (q, qd, qdd))
    if preset.look_ahead_s > 0:
        q, qd, qdd = _smoothed(q, preset.look_ahead_s)
    if preset.feed_forward:
        ahead = _torques(arm, q, qd, qdd) + drive.armature * qdd + drive.friction * qd
    else:
        ahead = np.zeros_like(q)
    return SetPoints(q, qd, ahead)


def _smoothed(q: np.ndarray, lag_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angles, speeds and accelerations behind a critically damped filter that lags by `lag_s`."""
    w = 2.0 / lag_s
    # Implicit midpoint: second order, and its rest is exactly the command's.
    h = CYCLE_S
    x, v = q[0].copy(), np.zeros(q.shape[1])
    out = np.empty((3, *q.shape))
    for k in range(len(q)):
        target = 0.5 * (q[k] + q[max(k - 1, 0)])
        a = (w * w * (target - x - 0.5 * h * v) - 2.0 * w * v) / (1.0 + w * h + 0.25 * w * w * h * h)
        x, v = x + h * v + 0.5 * h * h * a, v + h * a
        out[:, k] = x, v, a
    return out[0], out[1], out[2]


def _torques(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    model = arm.model()
    data = mujoco.MjData(model)
    at = [int(model.joint(name).dofadr[0]) for name in arm.joints]
    data.qpos[:] = arm.coordinates(np.zeros(len(at)))
    answer = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[at], data.qvel[at], data.qacc[at] = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(model, data)
        answer[k] = data.qfrc_inverse[at]
    return answer
