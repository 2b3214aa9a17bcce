"""A camera with the division model of distortion: pixels are rays, and rays meet planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Optics:
    """A camera: undistorted radius = distorted radius / (1 + division * its square), both at depth 1.

    Attributes
    ----------
    width_px, height_px
        Size of the picture.
    focal_px, centre_px
        (2,) each: pixels need not be square.
    division
        Of the distortion; negative for a barrel.
    rotation, position_m
        camera = rotation · (world - position).
    """

    width_px: int
    height_px: int
    focal_px: np.ndarray
    centre_px: np.ndarray
    division: float
    rotation: np.ndarray
    position_m: np.ndarray

    def rays(self, uv: np.ndarray) -> np.ndarray:
        """Return directions (..., 3) in the camera's frame, for pixels (..., 2)."""
        bent = (uv - self.centre_px) / self.focal_px
        straight = bent / (1.0 + self.division * (bent**2).sum(axis=-1, keepdims=True))
        return np.concatenate([straight, np.ones((*straight.shape[:-1], 1))], axis=-1)

    def on_plane(self, uv: np.ndarray, height_m: float = 0.0) -> np.ndarray:
        """Return where the rays of pixels (..., 2) meet the plane z = height: (..., 2) [m]."""
        ways = self.rays(uv) @ self.rotation
        far = (height_m - self.position_m[2]) / ways[..., 2:]
        return np.asarray(self.position_m[:2] + far * ways[..., :2])

    def pixels(self, xy_m: np.ndarray, height_m: float = 0.0) -> np.ndarray:
        """Return the pixels (..., 2) of places (..., 2) in the plane z = height."""
        z_m = np.full((*xy_m.shape[:-1], 1), height_m)
        seen = (np.concatenate([xy_m, z_m], axis=-1) - self.position_m) @ self.rotation.T
        straight = seen[..., :2] / seen[..., 2:]
        square = (straight**2).sum(axis=-1, keepdims=True)
        root = np.sqrt(1.0 - 4.0 * self.division * square)
        return np.asarray(self.centre_px + self.focal_px * straight * 2.0 / (1.0 + root))

    def grid(self, offset_px: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """Return all pixels' centres, moved by an offset: (H, W, 2)."""
        v, u = np.mgrid[: self.height_px, : self.width_px].astype(float)
        return np.stack([u + offset_px[0], v + offset_px[1]], axis=-1)


def facing(middle_m: np.ndarray, distance_m: float, tilt_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and position of a camera that looks at a place in the plane, turned by (3,) angles."""
    x, y, z = tilt_rad
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    rotation = about_z @ about_y @ about_x @ np.diag([1.0, -1.0, -1.0])
    return rotation, np.append(middle_m, 0.0) - rotation.T @ np.array([0.0, 0.0, distance_m])
