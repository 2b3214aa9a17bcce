"""The bounds within which an arm must stay while set points are streamed to it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strandcast.arm.load import Arm

OVERSHOOT = 1.1  # chosen: measured speed over the limit (less margins)


@dataclass(frozen=True, eq=False)
class SafetyBounds:
    """The bounds monitored in every cycle, and the limits of the soft stop.

    Attributes
    ----------
    lag_s
        (J,) known lag of each joint behind its command [s].
    tracking_rad
        (J,) allowed distance from the command of one lag ago [rad].
    velocity_rad_s
        (J,) allowed measured speed [rad/s].
    stop_acceleration_rad_s2, stop_jerk_rad_s3
        (J,) of the soft stop.
    outside
        Returns whether the arm is outside the workspace at (J,) measured angles; None: not monitored.
    """

    lag_s: np.ndarray
    tracking_rad: np.ndarray
    velocity_rad_s: np.ndarray
    stop_acceleration_rad_s2: np.ndarray
    stop_jerk_rad_s3: np.ndarray
    outside: Callable[[np.ndarray], bool] | None = None


def safety_bounds(arm: Arm) -> SafetyBounds:
    """Return the bounds from an arm's file: servo lag, limits, stop and workspace."""
    low, high = arm.box_m.T

    def outside(q: np.ndarray) -> bool:
        hand_m = arm.hand_m(q)
        return not ((low <= hand_m) & (hand_m <= high)).all()

    return SafetyBounds(
        lag_s=arm.servo.lag_s,
        tracking_rad=arm.tracking_rad,
        velocity_rad_s=OVERSHOOT * arm.limits.velocity_rad_s,
        stop_acceleration_rad_s2=arm.stop.acceleration_rad_s2,
        stop_jerk_rad_s3=arm.stop.jerk_rad_s3,
        outside=outside,
    )
