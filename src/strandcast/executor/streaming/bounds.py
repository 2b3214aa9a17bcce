"""The bounds within which an arm must stay while set points are streamed to it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.whole_arm import SPEEDS, whole_arm
from strandcast.records.motion import WHOLE_ARM

SOON_S = 1e-4  # over which a place's speed is taken; chosen
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
    too_fast
        Returns which of flange, clamp and elbow is too fast at (J,) measured angles and speeds, or None;
        None: not monitored.
    """

    lag_s: np.ndarray
    tracking_rad: np.ndarray
    velocity_rad_s: np.ndarray
    stop_acceleration_rad_s2: np.ndarray
    stop_jerk_rad_s3: np.ndarray
    outside: Callable[[np.ndarray], bool] | None = None
    too_fast: Callable[[np.ndarray, np.ndarray], str | None] | None = None


def safety_bounds(arm: Arm) -> SafetyBounds:
    """Return the bounds from an arm's file: servo lag, limits, stop and workspace."""
    low, high = arm.box_m.T

    def outside(q: np.ndarray) -> bool:
        hand_m = arm.hand_m(q)
        return not ((low <= hand_m) & (hand_m <= high)).all()

    limit = OVERSHOOT * arm.limits.whole_arm[SPEEDS]
    # Power, momentum and stop are those of the checked command: to compute them takes a cycle's time.
    monitored = np.zeros(len(WHOLE_ARM), dtype=bool)
    monitored[SPEEDS] = True

    def too_fast(q: np.ndarray, qd: np.ndarray) -> str | None:
        values = whole_arm(arm, np.stack([q, q + SOON_S * qd]), np.array([0.0, SOON_S]), monitored)[0, SPEEDS]
        k = int(np.argmax(values / limit))
        if values[k] <= limit[k]:
            return None
        name, unit = [*WHOLE_ARM.items()][k]
        return f"{name} {values[k]:.3g} {unit}, allowed {limit[k]:.3g} {unit}"

    return SafetyBounds(
        lag_s=arm.servo.lag_s,
        tracking_rad=arm.tracking_rad,
        velocity_rad_s=OVERSHOOT * arm.limits.velocity_rad_s,
        stop_acceleration_rad_s2=arm.stop.acceleration_rad_s2,
        stop_jerk_rad_s3=arm.stop.jerk_rad_s3,
        outside=outside,
        too_fast=too_fast if np.isfinite(limit).any() else None,
    )
