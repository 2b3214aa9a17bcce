"""Actions as joint trajectories that an arm can play: Bezier control heights, or velocities at 100 Hz."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from strandcast.arm.dynamics import chain_torques
from strandcast.arm.load import PlanarArm
from strandcast.config.plan import PlanSettings
from strandcast.core.trajectory import JointTrajectory
from strandcast.planning.bezier import Curve, rest_heights, sample, whole_steps
from strandcast.planning.draw import FREE_HEIGHTS
from strandcast.planning.paths import WITHIN

# A Bezier curve stays below its heights: the planner's go up to 1.75 times the limit of the speed.
HEIGHT_PER_LIMIT = 2.0
SHORTEST_S, LONGEST_S = PlanSettings().duration_s
RATE_HZ = 100
# A motion that asks for too much torque is slowed by this factor, so often at most; chosen.
SLOWED, SLOWING = 0.8, 12


class ActionKind(NamedTuple):
    """The shape of an action for an arm, and the trajectory that an action within -1 and 1 asks for."""

    shape: Callable[[PlanarArm], tuple[int, ...]]
    asked: Callable[[PlanarArm, np.ndarray], JointTrajectory]


def curve_shape(arm: PlanarArm) -> tuple[int, ...]:
    """Return (J * 6 + J + 1,): free heights joint by joint, posture, duration."""
    return (len(arm.joints) * (FREE_HEIGHTS + 1) + 1,)


def curve_asked(arm: PlanarArm, action: np.ndarray) -> JointTrajectory:
    """Return the rest-to-rest Bezier curve of an action of `curve_shape`."""
    step_s, joints = 1.0 / arm.log_rate_hz, len(arm.joints)
    heights, posture, time = np.split(action.astype(float), [joints * FREE_HEIGHTS, -1])
    duration_s = whole_steps(SHORTEST_S + 0.5 * (time[0] + 1.0) * (LONGEST_S - SHORTEST_S), step_s)
    scale = HEIGHT_PER_LIMIT * arm.limits.velocity_rad_s[:, None]
    free = heights.reshape(joints, FREE_HEIGHTS) * scale
    return sample(Curve(_posture(arm, posture), duration_s, rest_heights(free)), step_s)


def curve_action(arm: PlanarArm, curve: Curve) -> np.ndarray:
    """Return the action that asks for a rest-to-rest curve; the inverse of `curve_asked`."""
    heights = curve.heights_rad_s[:, 2:-2] / (HEIGHT_PER_LIMIT * arm.limits.velocity_rad_s[:, None])
    low, high = arm.limits.lower_rad, arm.limits.upper_rad
    posture = (2.0 * curve.q0_rad - low - high) / (high - low)
    time = 2.0 * (curve.duration_s - SHORTEST_S) / (LONGEST_S - SHORTEST_S) - 1.0
    return np.concatenate([heights.ravel(), posture, [time]]).astype(np.float32)


def velocities_shape(arm: PlanarArm) -> tuple[int, ...]:
    """Return (90, J): the posture, then velocities 10, 20, … 890 ms after the start."""
    return (round(LONGEST_S * RATE_HZ), len(arm.joints))


def velocities_asked(arm: PlanarArm, action: np.ndarray) -> JointTrajectory:
    """Return the trajectory of an action of `velocities_shape`, at rest at 0 and 900 ms.

    The velocities are linear between the action's; they change no faster than the limit of the acceleration.
    """
    rest = np.zeros((1, len(arm.joints)))
    asked = np.concatenate([rest, action[1:] * arm.limits.velocity_rad_s, rest])
    change = WITHIN * arm.limits.acceleration_rad_s2 / RATE_HZ
    brake = change * np.arange(len(asked))[::-1, None]  # from more than this the arm cannot stop in time
    for k in range(1, len(asked)):
        low, high = np.maximum(asked[k - 1] - change, -brake[k]), np.minimum(asked[k - 1] + change, brake[k])
        asked[k] = np.clip(asked[k], low, high)
    step_s = 1.0 / arm.log_rate_hz
    time_s = np.arange(round(LONGEST_S / step_s) + 1) * step_s
    qd = np.stack([np.interp(time_s, np.arange(len(asked)) / RATE_HZ, column) for column in asked.T], axis=1)
    turned = np.concatenate([rest, np.cumsum(0.5 * (qd[1:] + qd[:-1]) * step_s, axis=0)])
    qdd = np.gradient(qd, step_s, axis=0)
    qdd[[0, -1]] = 0.0
    return JointTrajectory(time_s, _posture(arm, action[0]) + turned, qd, qdd)


KINDS = {
    "curve": ActionKind(curve_shape, curve_asked),
    "velocities": ActionKind(velocities_shape, velocities_asked),
}


def within_limits(arm: PlanarArm, asked: JointTrajectory) -> tuple[JointTrajectory, float] | None:
    """Return the motion within the arm's limits that is nearest in kind, None if there is none.

    Each joint's motion is scaled down to its limits, all of them until the torques suffice; then the posture
    moves until the motion lies between the joints' stops.

    Returns
    -------
    The motion, and the least share of a joint's motion that is left (1: as asked).
    """
    limits, step_s, dynamics = arm.limits, 1.0 / arm.log_rate_hz, arm.dynamics
    path = asked.q_rad - asked.q_rad[0]
    largest = (
        (limits.upper_rad - limits.lower_rad, np.ptp(path, axis=0)),
        (WITHIN * limits.velocity_rad_s, np.abs(asked.qd_rad_s).max(axis=0)),
        (WITHIN * limits.acceleration_rad_s2, np.abs(asked.qdd_rad_s2).max(axis=0)),
        (WITHIN * limits.jerk_rad_s3, np.abs(np.diff(asked.qdd_rad_s2, axis=0)).max(axis=0) / step_s),
    )
    share = np.minimum(1.0, np.min([limit / np.maximum(most, 1e-9) for limit, most in largest], axis=0))
    for _ in range(SLOWING):
        low, high = limits.lower_rad - share * path.min(axis=0), limits.upper_rad - share * path.max(axis=0)
        q = np.clip(asked.q_rad[0], low, np.maximum(low, high)) + share * path
        qd, qdd = share * asked.qd_rad_s, share * asked.qdd_rad_s2
        torque = chain_torques(q, qd, qdd, dynamics.links, dynamics.gravity_m_s2)
        if (np.abs(torque) <= WITHIN * limits.torque_n_m).all():
            return JointTrajectory(asked.time_s, q, qd, qdd), float(share.min())
        share = SLOWED * share
    return None


def _posture(arm: PlanarArm, action: np.ndarray) -> np.ndarray:
    low, high = arm.limits.lower_rad, arm.limits.upper_rad
    return np.asarray(low + 0.5 * (action + 1.0) * (high - low))
