"""Move slowly to a motion's start: straight in joint space, never blended into the motion."""

import numpy as np
import ruckig

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


def slow_trajectory(q_from: np.ndarray, q_to: np.ndarray, rate_hz: float) -> JointTrajectory:
    """Return the straight path from rest to rest between (N,) angles, sampled at `rate_hz`.

    The joint with the longest way moves at 0.25 rad/s at most.
    """
    count = len(q_from)
    wanted = ruckig.InputParameter(count)
    wanted.current_position, wanted.target_position = q_from.tolist(), q_to.tolist()
    wanted.max_velocity = [SPEED_RAD_S] * count
    wanted.max_acceleration = [ACCELERATION_RAD_S2] * count
    wanted.max_jerk = [JERK_RAD_S3] * count
    wanted.synchronization = ruckig.Synchronization.Phase
    trajectory = ruckig.Trajectory(count)
    ruckig.Ruckig(count).calculate(wanted, trajectory)
    steps = max(1, int(np.ceil(trajectory.duration * rate_hz)))
    time_s = np.arange(steps + 1) / rate_hz
    q, qd, qdd = np.moveaxis(np.array([trajectory.at_time(t) for t in time_s]), 1, 0)
    return JointTrajectory(time_s, q, qd, qdd)


def move_to_start(
    link: StreamLink,
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
    command = slow_trajectory(np.asarray(q_from, float), np.asarray(q_to, float), rate_hz)
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
