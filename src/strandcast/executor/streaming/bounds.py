"""The bounds within which an arm must stay while set points are streamed to it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strandcast.arm.limits import place_speeds
from strandcast.arm.load import Arm
from strandcast.records.motion import PLACES

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
        Returns which place on the arm is faster than allowed, and how fast [m/s], at (J,) measured angles and
        speeds, or None; None: not monitored.
    """

    lag_s: np.ndarray
    tracking_rad: np.ndarray
    velocity_rad_s: np.ndarray
    stop_acceleration_rad_s2: np.ndarray
    stop_jerk_rad_s3: np.ndarray
    outside: Callable[[np.ndarray], bool] | None = None
    too_fast: Callable[[np.ndarray, np.ndarray], tuple[str, float] | None] | None = None


def safety_bounds(arm: Arm) -> SafetyBounds:
    """Return the bounds from an arm's file: servo lag, limits, stop and workspace."""
    low, high = arm.box_m.T

    def outside(q: np.ndarray) -> bool:
        hand_m = arm.hand_m(q)
        return not ((low <= hand_m) & (hand_m <= high)).all()

    most_m_s = OVERSHOOT * arm.limits.places_m_s

    def too_fast(q: np.ndarray, qd: np.ndarray) -> tuple[str, float] | None:
        speeds_m_s = place_speeds(arm, np.stack([q, q + SOON_S * qd]), np.array([0.0, SOON_S]))[0]
        k = int(np.argmax(speeds_m_s - most_m_s))
        return (PLACES[k], float(speeds_m_s[k])) if speeds_m_s[k] > most_m_s[k] else None

    return SafetyBounds(
        lag_s=arm.servo.lag_s,
        tracking_rad=arm.tracking_rad,
        velocity_rad_s=OVERSHOOT * arm.limits.velocity_rad_s,
        stop_acceleration_rad_s2=arm.stop.acceleration_rad_s2,
        stop_jerk_rad_s3=arm.stop.jerk_rad_s3,
        outside=outside,
        too_fast=too_fast if arm.limits.of_places else None,
    )
