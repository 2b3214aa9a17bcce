"""Limits of the moving joints, of the arm as a whole, and of a stop before the motion's end."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the moving joints, less their margins: (J,) each, infinite if there is none.

    Attributes
    ----------
    lower_rad, upper_rad, velocity_rad_s, acceleration_rad_s2, jerk_rad_s3, torque_n_m
        Usable range of each joint.
    whole_arm
        (8,) of `strandcast.records.motion.WHOLE_ARM`.
    """

    lower_rad: np.ndarray
    upper_rad: np.ndarray
    velocity_rad_s: np.ndarray
    acceleration_rad_s2: np.ndarray
    jerk_rad_s3: np.ndarray
    torque_n_m: np.ndarray
    whole_arm: np.ndarray

    @property
    def whole_arm_limited(self) -> np.ndarray:
        """(8,) which quantities of the whole arm are limited."""
        return np.asarray(np.isfinite(self.whole_arm))


@dataclass(frozen=True, eq=False)
class Stop:
    """How the arm stops before the motion's end.

    Attributes
    ----------
    acceleration_rad_s2, jerk_rad_s3
        (J,) of the player's soft stop, finite.
    distance_rad, time_s
        (J,) how far each joint still turns, and how long, while the controller itself stops it from full
        speed, or zero.
    """

    acceleration_rad_s2: np.ndarray
    jerk_rad_s3: np.ndarray
    distance_rad: np.ndarray
    time_s: np.ndarray
