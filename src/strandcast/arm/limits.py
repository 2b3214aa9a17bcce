"""Where a motion exceeds the arm's limits, its peak values, and what cannot be checked."""

from dataclasses import dataclass

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.urdf import dofs_of, inverse_torques, massless, posed
from strandcast.arm.whole_arm import MOMENTUM, POWER, whole_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.records.motion import WHOLE_ARM

ROUNDING = 1e-9  # relative, of the limit


@dataclass(frozen=True)
class Violation:
    """The instant at which a joint, or the whole arm, exceeds its limit of one kind the most."""

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
    **WHOLE_ARM,
}


def violations(arm: Arm, motion: JointTrajectory) -> list[Violation]:
    """Return where a motion exceeds the arm's limits less their margins; empty if nowhere.

    A controller may take the samples' differences, whatever speeds and accelerations are stated with them, or
    follow the quintic between them: both are checked.
    """
    time_s, limits, finer = motion.time_s, arm.limits, motion.finer()
    at_s, q, qdd = finer.time_s, finer.q_rad, finer.qdd_rad_s2
    middle_s = 0.5 * (time_s[1:] + time_s[:-1])
    jerk = np.diff(motion.qdd_rad_s2, axis=0) / np.diff(time_s)[:, None]
    checks = [
        ("upper position", at_s, q, limits.upper_rad),
        ("lower position", at_s, -q, -limits.lower_rad),
        ("velocity", at_s, np.abs(finer.qd_rad_s), limits.velocity_rad_s),
        ("acceleration", at_s, np.abs(qdd), limits.acceleration_rad_s2),
        ("jerk", middle_s, np.abs(jerk), limits.jerk_rad_s3),
    ]
    derivatives = [(kind, limit) for kind, _, _, limit in checks[2:]]
    for (kind, limit), (when, value) in zip(derivatives, differences(motion), strict=True):
        checks.append((kind, when, np.abs(value), limit))
    if np.isfinite(limits.torque_n_m).any():
        torque = torques(arm, motion.q_rad, motion.qd_rad_s, motion.qdd_rad_s2)
        checks.append(("torque", time_s, np.abs(torque), limits.torque_n_m))
    found: dict[tuple[str, str], Violation] = {}
    for kind, when, value, limit in checks:
        for violation in _beyond(arm.joints, kind, when, value, limit):
            found.setdefault((violation.joint, kind), violation)
    between_s = 0.5 * (at_s[1:] + at_s[:-1])
    of_arm = whole_arm(arm, q, at_s, limits.whole_arm_limited)
    columns = zip(WHOLE_ARM, of_arm.T[:, :, None], limits.whole_arm[:, None], strict=True)
    return [
        *found.values(),
        *(each for name, *column in columns for each in _beyond(("arm",), name, between_s, *column)),
    ]


def differences(motion: JointTrajectory) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return times (K,) and (K, J) speeds, accelerations and jerks, by differences of the angles alone.

    Before the first sample and after the last the arm is held, for as long as the step there.
    """
    first_s, last_s = np.diff(motion.time_s)[[0, -1]]
    before_s, after_s = motion.time_s[0] - first_s * np.array([2, 1]), motion.end_s + last_s * np.arange(1, 3)
    time_s = np.concatenate([before_s, motion.time_s, after_s])
    values = np.pad(motion.q_rad, ((2, 2), (0, 0)), mode="edge")
    found = []
    for order in (1, 2, 3):
        values = np.diff(values, axis=0) * order / (time_s[order:] - time_s[:-order])[:, None]
        found.append((0.5 * (time_s[order:] + time_s[:-order]), values))
    return found


def _beyond(
    joints: tuple[str, ...], kind: str, time_s: np.ndarray, value: np.ndarray, limit: np.ndarray
) -> list[Violation]:
    sign = -1.0 if kind == "lower position" else 1.0
    worst = np.argmax(value, axis=0)
    return [
        Violation(name, kind, float(time_s[k]), float(sign * value[k, j]), float(sign * limit[j]))
        for j, (name, k) in enumerate(zip(joints, worst, strict=True))
        if not value[k, j] <= limit[j] + ROUNDING * max(1.0, abs(limit[j]))  # NaN is beyond any
    ]


def peaks(arm: Arm, motion: JointTrajectory) -> dict[str, np.ndarray]:
    """Return the largest speed, acceleration, jerk and torque of a motion, (J,), and of `WHOLE_ARM`, (8,).

    Power and momentum of an arm without masses are NaN: not known.
    """
    q, qd, qdd = motion.q_rad, motion.qd_rad_s, motion.qdd_rad_s2
    jerk = np.diff(qdd, axis=0) / np.diff(motion.time_s)[:, None]
    of_arm = whole_arm(arm, q, motion.time_s).max(axis=0)
    if massless(arm.model(), arm.joints):
        of_arm[[POWER, MOMENTUM]] = np.nan
    return {
        "velocity_rad_s": np.abs(qd).max(axis=0),
        "acceleration_rad_s2": np.abs(qdd).max(axis=0),
        "jerk_rad_s3": np.abs(jerk).max(axis=0),
        "torque_n_m": np.abs(torques(arm, q, qd, qdd)).max(axis=0),
        "whole_arm": of_arm,
    }


def torque_gap(arm: Arm) -> str | None:
    """Return why torques are not checked, or None if they are."""
    names = massless(arm.model(), arm.joints)
    if names:
        turn = "turns" if len(names) == 1 else "turn"
        return (
            f"torque is not checked: {arm.urdf_path.name} gives no mass to what {', '.join(names)} {turn}; "
            "give it <inertial>, and the arm's file margins.torque"
        )
    if not np.isfinite(arm.limits.torque_n_m).all():
        return f"torque is not checked: {arm.path.name} has no margins.torque"
    return None


def torques(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Return the joints' torques [N m] by inverse dynamics with the payload: (T, J) from (T, J) each."""
    model = arm.model_with_payload()
    return inverse_torques(posed(model, arm.held), dofs_of(model, arm.joints), q, qd, qdd)
