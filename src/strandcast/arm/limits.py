"""Where a motion exceeds the arm's limits, and its peak values."""

from dataclasses import dataclass

import mujoco
import numpy as np

from strandcast.arm.load import AnyArm
from strandcast.core.trajectory import JointTrajectory

ROUNDING = 1e-9  # relative, of the limit


@dataclass(frozen=True)
class Violation:
    """The instant at which a joint exceeds its limit of one kind the most."""

    joint: str
    kind: str
    time_s: float
    value: float
    limit: float

    def __str__(self) -> str:
        unit = UNITS[self.kind]
        value = f"{self.kind} {self.value:.3g} {unit}"
        return f"{self.joint}: {value} at {self.time_s:.3f} s, limit {self.limit:.3g} {unit}"


UNITS = {
    "lower position": "rad",
    "upper position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s²",
    "jerk": "rad/s³",
    "torque": "N m",
}


def violations(arm: AnyArm, motion: JointTrajectory) -> list[Violation]:
    """Return where a motion exceeds the arm's limits less their margins; empty if nowhere.

    Speed is checked as given and by the differences of the positions, jerk by those of the accelerations.
    """
    time_s, q, qd, qdd = motion.time_s, motion.q_rad, motion.qd_rad_s, motion.qdd_rad_s2
    step = np.diff(time_s)[:, None]
    middle = 0.5 * (time_s[1:] + time_s[:-1])
    limits = arm.limits
    checks = [
        ("upper position", time_s, q, limits.upper_rad),
        ("lower position", time_s, -q, -limits.lower_rad),
        ("velocity", time_s, np.abs(qd), limits.velocity_rad_s),
        ("velocity", middle, np.abs(np.diff(q, axis=0) / step), limits.velocity_rad_s),
        ("acceleration", time_s, np.abs(qdd), limits.acceleration_rad_s2),
        ("jerk", middle, np.abs(np.diff(qdd, axis=0) / step), limits.jerk_rad_s3),
    ]
    if np.isfinite(limits.torque_n_m).any():
        checks.append(("torque", time_s, np.abs(torques(arm, q, qd, qdd)), limits.torque_n_m))
    found: dict[tuple[str, str], Violation] = {}
    for kind, when, value, limit in checks:
        for violation in _beyond(arm.joints, kind, when, value, limit):
            found.setdefault((violation.joint, kind), violation)
    return list(found.values())


def _beyond(
    joints: tuple[str, ...], kind: str, time_s: np.ndarray, value: np.ndarray, limit: np.ndarray
) -> list[Violation]:
    sign = -1.0 if kind == "lower position" else 1.0
    worst = np.argmax(value, axis=0)
    return [
        Violation(name, kind, float(time_s[k]), float(sign * value[k, j]), float(sign * limit[j]))
        for j, (name, k) in enumerate(zip(joints, worst, strict=True))
        if value[k, j] > limit[j] + ROUNDING * max(1.0, abs(limit[j]))
    ]


def peaks(arm: AnyArm, motion: JointTrajectory) -> dict[str, np.ndarray]:
    """Return the largest speed, acceleration, jerk and torque of a motion, (J,) each."""
    q, qd, qdd = motion.q_rad, motion.qd_rad_s, motion.qdd_rad_s2
    jerk = np.diff(qdd, axis=0) / np.diff(motion.time_s)[:, None]
    return {
        "velocity_rad_s": np.abs(qd).max(axis=0),
        "acceleration_rad_s2": np.abs(qdd).max(axis=0),
        "jerk_rad_s3": np.abs(jerk).max(axis=0),
        "torque_n_m": np.abs(torques(arm, q, qd, qdd)).max(axis=0),
    }


def torques(arm: AnyArm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Return the joints' torques [N m] by inverse dynamics with the payload: (T, J) from (T, J) each."""
    model = arm.model_with_payload()
    data = mujoco.MjData(model)
    at = [int(model.joint(name).dofadr[0]) for name in arm.joints]
    at_zero = arm.coordinates(np.zeros(len(at)))
    torque = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:] = at_zero
        data.qpos[at] = q[k]
        data.qvel[at] = qd[k]
        data.qacc[at] = qdd[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse[at]
    return torque
