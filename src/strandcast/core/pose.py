"""Poses of a frame, such as the hand's, in the plane of the throw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Pose:
    """One pose, or an array of poses."""

    position_m: np.ndarray  # (..., 2) origin of the frame in the world
    angle_rad: np.ndarray  # (...) direction of the frame's x axis

    @classmethod
    def from_array(cls, values: np.ndarray) -> Pose:
        """Return the poses in the rows x [m], y [m], angle [rad] of an array (..., 3)."""
        return cls(values[..., :2], values[..., 2])

    def array(self) -> np.ndarray:
        """Return the poses as an array (..., 3): x [m], y [m], angle [rad]. Kernels take poses so."""
        return np.concatenate([self.position_m, np.asarray(self.angle_rad)[..., None]], axis=-1)

    def __getitem__(self, index: Any) -> Pose:
        """Return the poses at an index of the leading axes."""
        return Pose(self.position_m[index], self.angle_rad[index])

    def __len__(self) -> int:
        """Return the length of the first axis."""
        return len(self.position_m)

    def place(self, points_m: np.ndarray) -> np.ndarray:
        """Return points of the frame in the world: (..., 2) [m] from (..., 2) [m]."""
        return np.asarray(self.position_m + rotated(points_m, self.angle_rad))

    def near(self, reference_rad: np.ndarray) -> Pose:
        """Return the poses with whole turns added, so that the angles are nearest to reference angles."""
        turns = np.round((reference_rad - self.angle_rad) / (2.0 * np.pi))
        return Pose(self.position_m, self.angle_rad + 2.0 * np.pi * turns)

    def interpolated(self, time_s: np.ndarray, wanted_s: np.ndarray) -> Pose:
        """Return the poses at times (K,), linear between the times (T,) of these, constant beyond them."""
        x, y, angle = (np.interp(wanted_s, time_s, column) for column in (*self.position_m.T, self.angle_rad))
        return Pose(np.stack([x, y], axis=-1), angle)


def rotated(vectors: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """Return vectors (..., 2) turned counter-clockwise by angles (...) [rad]."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def wrapped(angle_rad: np.ndarray) -> np.ndarray:
    """Return angles in [-π, π) [rad]."""
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
