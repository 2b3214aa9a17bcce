"""Move slowly to a motion's start: straight in joint space, never blended into the motion."""

from collections.abc import Sequence

import numpy as np
import ruckig

from strandcast.arm.load import Arm
from strandcast.arm.whole_arm import SPEEDS, whole_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import ABORTED, STOPPED_BY_CONTROLLER, StrandcastError
from strandcast.executor.streaming.bounds import SafetyBounds
from strandcast.executor.streaming.clock import Clock
from strandcast.executor.streaming.link import StreamLink
from strandcast.executor.streaming.loop import stream

# Chosen.
SPEED_RAD_S = 0.25
ACCELERATION_RAD_S2 = 0.5
JERK_RAD_S3 = 2.5
TRACKING_RAD = 0.1
REACHED_RAD = 0.01
SETTLING_S = 0.5
SLOWER = 1.01  # than the limits of the whole arm need it: other samples are a little faster


def slow_trajectory(
    arm: Arm, names: Sequence[str], q_from: np.ndarray, q_to: np.ndarray, rate_hz: float
) -> JointTrajectory:
    """Return the straight path from rest to rest between (N,) angles of joints `names`, at `rate_hz`.

    The joint with the longest way moves at 0.25 rad/s at most, or slower, as the limits of the whole arm need
    it; of joints that throws hold, their part in the speeds counts.
    """
    path = _straight(q_from, q_to, rate_hz, 1.0)
    limited = arm.limits.whole_arm_limited
    if not limited.any():
        return path
    moving = [list(names).index(name) for name in arm.joints]
    peak = whole_arm(arm, path.q_rad[:, moving], path.time_s, limited).max(axis=0)
    origin_m, far_m = arm.reach()
    held_rad_s = np.delete(np.abs(path.qd_rad_s).max(axis=0), moving).sum()
    peak[SPEEDS] += held_rad_s * (np.linalg.norm(origin_m) + far_m)
    slower = SLOWER * float((peak / arm.limits.whole_arm).max())
    return path if slower <= 1.0 else _straight(q_from, q_to, rate_hz, slower)


def _straight(q_from: np.ndarray, q_to: np.ndarray, rate_hz: float, slower: float) -> JointTrajectory:
    """Return the path, `slower` times slower than usual."""
    count = len(q_from)
    wanted = ruckig.InputParameter(count)
    wanted.current_position, wanted.target_position = list(map(float, q_from)), list(map(float, q_to))
    wanted.max_velocity = [SPEED_RAD_S / slower] * count
    wanted.max_acceleration = [ACCELERATION_RAD_S2 / slower**2] * count
    wanted.max_jerk = [JERK_RAD_S3 / slower**3] * count
    wanted.synchronization = ruckig.Synchronization.Phase
    trajectory = ruckig.Trajectory(count)
    ruckig.Ruckig(count).calculate(wanted, trajectory)
    steps = max(1, int(np.ceil(trajectory.duration * rate_hz)))
    time_s = np.arange(steps + 1) / rate_hz
    q, qd, qdd = np.moveaxis(np.array([trajectory.at_time(t) for t in time_s]), 1, 0)
    return JointTrajectory(time_s, q, qd, qdd)


def move_to_start(
    link: StreamLink,
    arm: Arm,
    q_from: np.ndarray,
    q_to: np.ndarray,
    rate_hz: float,
    joint_names: list[str],
    clock: Clock | None = None,
) -> None:
    """Stream the slow path over a link to all joints of the controller, from and to (N,) angles [rad].

    Raises
    ------
    StrandcastError
        SC-X011 stopped on the way, or the arm did not reach the start.
    """
    count = len(q_to)
    bounds = SafetyBounds(
        lag_s=np.zeros(count),
        tracking_rad=np.full(count, TRACKING_RAD),
        velocity_rad_s=np.full(count, 6.0 * SPEED_RAD_S),
        stop_acceleration_rad_s2=np.full(count, 2.0 * ACCELERATION_RAD_S2),
        stop_jerk_rad_s3=np.full(count, 10.0 * JERK_RAD_S3),
    )
    command = slow_trajectory(arm, joint_names, q_from, q_to, rate_hz)
    done = stream(link, command, bounds, rate_hz, joint_names, hold_s=(0.0, SETTLING_S), clock=clock)
    if done.status != "ok":
        raise StrandcastError(
            "SC-X011",
            f"the move to the start was stopped ({done.reason})",
            cost="the motion was not played",
            exit_code=ABORTED if done.status == "aborted" else STOPPED_BY_CONTROLLER,
        )
    error = np.abs(done.log.q_rad[-1] - q_to)
    if error.max() > REACHED_RAD:
        worst = int(np.argmax(error))
        raise StrandcastError(
            "SC-X011",
            f"{joint_names[worst]} came to rest {error[worst]:.4f} rad from the start",
            cost="the motion was not played",
            fix="check the arm's servo, payload and brakes",
        )
