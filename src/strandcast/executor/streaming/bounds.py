"""The bounds within which an arm must stay while set points are streamed to it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.whole_arm import POWER, whole_arm
from strandcast.records.motion import WHOLE_ARM

SOON_S = 1e-4  # over which a place's speed is taken; chosen
OVERSHOOT = 1.1  # chosen: what is measured over the limit (less margins)


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
    beyond
        Returns which limit of the whole arm is exceeded, and by what value, at (J,) measured angles and
        speeds, or None; None: not monitored. A measured state has no acceleration: no power is monitored.
    """

    lag_s: np.ndarray
    tracking_rad: np.ndarray
    velocity_rad_s: np.ndarray
    stop_acceleration_rad_s2: np.ndarray
    stop_jerk_rad_s3: np.ndarray
    outside: Callable[[np.ndarray], bool] | None = None
    beyond: Callable[[np.ndarray, np.ndarray], str | None] | None = None


def safety_bounds(arm: Arm) -> SafetyBounds:
    """Return the bounds from an arm's file: servo lag, limits, stop and workspace."""
    low, high = arm.box_m.T

    def outside(q: np.ndarray) -> bool:
        hand_m = arm.hand_m(q)
        return not ((low <= hand_m) & (hand_m <= high)).all()

    limit, monitored = OVERSHOOT * arm.limits.whole_arm, arm.limits.of_whole_arm
    monitored[POWER] = False

    def beyond(q: np.ndarray, qd: np.ndarray) -> str | None:
        values = whole_arm(arm, np.stack([q, q + SOON_S * qd]), np.array([0.0, SOON_S]), monitored)[0]
        k = int(np.argmax(values / limit))
        name, unit = [*WHOLE_ARM.items()][k]
        return f"{name} {values[k]:.3g} {unit}, limit {limit[k]:.3g}" if values[k] > limit[k] else None

    return SafetyBounds(
        lag_s=arm.servo.lag_s,
        tracking_rad=arm.tracking_rad,
        velocity_rad_s=OVERSHOOT * arm.limits.velocity_rad_s,
        stop_acceleration_rad_s2=arm.stop.acceleration_rad_s2,
        stop_jerk_rad_s3=arm.stop.jerk_rad_s3,
        outside=outside,
        beyond=beyond if monitored.any() else None,
    )
