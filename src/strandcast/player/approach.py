"""The slow way to a motion's start: straight in joint space, never blended into the motion."""

from __future__ import annotations

import numpy as np
import ruckig

from strandcast.errors import ABORTED, STOPPED_BY_CONTROLLER, StrandcastError
from strandcast.player.bounds import Bounds
from strandcast.player.clock import Clock
from strandcast.player.protocol import Command
from strandcast.player.stream import Link, stream

SPEED_RAD_S = 0.25
ACCELERATION_RAD_S2 = 0.5
JERK_RAD_S3 = 2.5
TRACKING_RAD = 0.1
REACHED_RAD = 0.01
SETTLING_S = 0.5


def slow_path(q_from: np.ndarray, q_to: np.ndarray, rate_hz: float) -> Command:
    """Return the way from rest to rest, the joint that has furthest to go at 0.25 rad/s.

    Parameters
    ----------
    q_from, q_to
        (N,) angles [rad].
    rate_hz
        Of the set points.
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
    return Command(time_s, q, qd, qdd)


def approach(
    link: Link,
    q_from: np.ndarray,
    q_to: np.ndarray,
    rate_hz: float,
    joint_names: list[str],
    clock: Clock | None = None,
) -> None:
    """Stream the slow way over a link of all N joints of the controller.

    Parameters
    ----------
    link
        Not started yet.
    q_from, q_to
        (N,) measured angles and where to go [rad].
    rate_hz, joint_names, clock
        As for `stream`.

    Raises
    ------
    StrandcastError
        SC-X051 it was stopped on the way, SC-X052 the arm did not get there.
    """
    count = len(q_to)
    bounds = Bounds(
        lag_s=np.zeros(count),
        tracking_rad=np.full(count, TRACKING_RAD),
        velocity_rad_s=np.full(count, 6.0 * SPEED_RAD_S),
        stop_acceleration_rad_s2=np.full(count, 2.0 * ACCELERATION_RAD_S2),
        stop_jerk_rad_s3=np.full(count, 10.0 * JERK_RAD_S3),
    )
    command = slow_path(np.asarray(q_from, float), np.asarray(q_to, float), rate_hz)
    done = stream(link, command, bounds, rate_hz, joint_names, lead_s=0.0, tail_s=SETTLING_S, clock=clock)
    if done.status != "ok":
        code = ABORTED if done.status == "aborted" else STOPPED_BY_CONTROLLER
        raise StrandcastError(
            "SC-X051", f"the move to the start was stopped ({done.reason})", cost="the motion was not played",
            fix="mend the reason and play again", exit_code=code)  # fmt: skip
    away = np.abs(done.log.q_rad[-1] - q_to)
    if away.max() > REACHED_RAD:
        worst = int(np.argmax(away))
        raise StrandcastError(
            "SC-X052", f"{joint_names[worst]} came to rest {away[worst]:.4f} rad from the start",
            cost="the motion was not played", fix="look at the arm's servo, payload and brakes")  # fmt: skip
