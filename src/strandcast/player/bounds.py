"""Within which bounds an arm must stay while it is being streamed to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import Arm

FASTER = 1.1  # than the limit, margins taken off: what an overshoot may add


@dataclass(frozen=True, eq=False)
class Bounds:
    """What is watched in every cycle, and how the arm is stopped.

    Attributes
    ----------
    lag_s
        (J,) how far each joint is known to trail its command [s].
    tracking_rad
        (J,) how far it may be off the command of that long ago [rad].
    velocity_rad_s
        (J,) how fast it may be measured [rad/s].
    stop_acceleration_rad_s2, stop_jerk_rad_s3
        (J,) of the soft stop.
    outside
        Whether (J,) measured angles are where the arm must not be; None where nothing is known.
    """

    lag_s: np.ndarray
    tracking_rad: np.ndarray
    velocity_rad_s: np.ndarray
    stop_acceleration_rad_s2: np.ndarray
    stop_jerk_rad_s3: np.ndarray
    outside: Callable[[np.ndarray], bool] | None = None


def bounds_of(arm: Arm) -> Bounds:
    """Return the bounds that an arm's file tells: its servo's lag, its limits, its stop, its workspace."""
    box = arm.workspace

    def outside(q: np.ndarray) -> bool:
        x, y, _ = hand_pose(arm.chain, arm.clamp, q)
        return not (box.x_m[0] <= x <= box.x_m[1] and box.y_m[0] <= y <= box.y_m[1])

    return Bounds(
        lag_s=arm.servo.lag_s,
        tracking_rad=arm.tracking_rad,
        velocity_rad_s=FASTER * arm.limits.velocity_rad_s,
        stop_acceleration_rad_s2=arm.stop.acceleration_rad_s2,
        stop_jerk_rad_s3=arm.stop.jerk_rad_s3,
        outside=outside,
    )
