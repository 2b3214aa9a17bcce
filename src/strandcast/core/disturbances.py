"""Disturbances: differences between throws of the same string."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

# One standard deviation each on a typical rig (chosen; the lab has its own): angle and length of the string
# in the clamp, sway at the start, zero positions of the joints.
GRASP_ANGLE_RAD = float(np.radians(3.0))
GRASP_LENGTH_M = 0.002
SWAY_RAD = 0.010
SWAY_RAD_S = 0.050
JOINT_ZERO_RAD = 0.001
# The same as one row: what `Disturbances` holds, column by column; all joints share the last.
DISTURBING = ("grasp_angle_rad", "grasp_length_m", "sway_rad", "sway_rad_s", "joint_zero_rad")
TYPICAL_SIZES = np.array([[GRASP_ANGLE_RAD, GRASP_LENGTH_M, SWAY_RAD, SWAY_RAD_S, JOINT_ZERO_RAD]])


@dataclass(frozen=True, eq=False)
class Disturbances:
    """Disturbances of B throws."""

    clamp_turn_rad: np.ndarray  # (B,) turn of the string in the clamp
    longer_m: np.ndarray  # (B,) length that hangs out of the clamp beyond the nominal one
    sway: np.ndarray  # (B, 2) turn of the string about the hand at the start [rad], and its rate [rad/s]
    joint_zero_rad: np.ndarray  # (B, J) error of the joints' zeros, added to their angles; (B, 0) for none

    @classmethod
    def none(cls, count: int) -> Disturbances:
        """Return `count` undisturbed throws."""
        return cls(np.zeros(count), np.zeros(count), np.zeros((count, 2)), np.zeros((count, 0)))

    def __len__(self) -> int:
        return len(self.clamp_turn_rad)

    def take(self, rows: np.ndarray) -> Disturbances:
        """Return the disturbances of some throws."""
        return Disturbances(*(getattr(self, column.name)[rows] for column in fields(self)))
