"""What the arm can do, and where a motion asks for more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np

if TYPE_CHECKING:
    from strandcast.arm.load import Arm

ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the moving joints, margins taken off: (J,) each, infinite where there is none.

    Attributes
    ----------
    lower_rad, upper_rad, velocity_rad_s, acceleration_rad_s2, jerk_rad_s3, torque_n_m
        Usable range of each joint.
    """

    lower_rad: np.ndarray
    upper_rad: np.ndarray
    velocity_rad_s: np.ndarray
    acceleration_rad_s2: np.ndarray
    jerk_rad_s3: np.ndarray
    torque_n_m: np.ndarray


@dataclass(frozen=True)
class Violation:
    """The worst moment at which a joint is asked for more than its limit of one kind."""

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


def violations(
    arm: Arm, time_s: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> list[Violation]:
    """Return where a motion leaves the arm's limits, margins taken off; empty if nowhere.

    Parameters
    ----------
    time_s
        (T,) [s].
    q, qd, qdd
        (T, J) angles [rad], speeds [rad/s], accelerations [rad/s²] of the moving joints.

    Notes
    -----
    Speed is checked as told and as the positions' differences say, jerk by the accelerations' differences.
    """
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


def peaks(
    arm: Arm, time_s: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> dict[str, np.ndarray]:
    """Return (J,) the largest speed, acceleration, jerk and torque that a motion asks for."""
    jerk = np.diff(qdd, axis=0) / np.diff(time_s)[:, None]
    return {
        "velocity_rad_s": np.abs(qd).max(axis=0),
        "acceleration_rad_s2": np.abs(qdd).max(axis=0),
        "jerk_rad_s3": np.abs(jerk).max(axis=0),
        "torque_n_m": np.abs(torques(arm, q, qd, qdd)).max(axis=0),
    }


def torques(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Return the joints' torques [N m] by inverse dynamics with the payload: (T, J) from (T, J) each."""
    model = arm.burdened_model()
    data = mujoco.MjData(model)
    at = [int(model.joint(name).dofadr[0]) for name in arm.joints]
    resting = arm.coordinates(np.zeros(len(at)))
    answer = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:] = resting
        data.qpos[at] = q[k]
        data.qvel[at] = qd[k]
        data.qacc[at] = qdd[k]
        mujoco.mj_inverse(model, data)
        answer[k] = data.qfrc_inverse[at]
    return answer
