"""Pixels of one camera as undistorted rays with covariance, and points in space as such rays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from strandcast.camera.mapping import ray_per_pixel, undistort
from strandcast.records.camera import Camera


class CameraRays(NamedTuple):
    """Detections of one camera as rays X/Z, Y/Z in its own frame, NaN where nothing was detected.

    Attributes
    ----------
    rays
        (..., 2).
    covariance
        (..., 2, 2) of the rays.
    rotation, translation_m
        (3, 3) and (3,): camera = rotation · world + translation.
    shared
        (..., 2), by how much an error that all points of an instant share, such as the clock's, moves the
        rays: one standard deviation.
    """

    rays: np.ndarray
    covariance: np.ndarray
    rotation: np.ndarray
    translation_m: np.ndarray
    shared: np.ndarray

    def at(self, index: Any) -> CameraRays:
        """Return the rays at an index of the leading axes."""
        return self._replace(
            rays=self.rays[index], covariance=self.covariance[index], shared=self.shared[index]
        )

    def directions(self) -> np.ndarray:
        """Return the rays' directions (..., 3) in the world, of length one."""
        ahead = np.concatenate([self.rays, np.ones_like(self.rays[..., :1])], axis=-1) @ self.rotation
        return np.asarray(ahead / np.linalg.norm(ahead, axis=-1, keepdims=True))

    def projected(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rays (..., 2) of points (..., 3), and their Jacobian (..., 2, 3); NaN behind it."""
        in_camera = points_m @ self.rotation.T + self.translation_m
        depth = np.where(in_camera[..., 2:] > 0.0, in_camera[..., 2:], np.nan)
        rays = in_camera[..., :2] / depth
        slope = (self.rotation[:2] - rays[..., None] * self.rotation[2]) / depth[..., None]
        return rays, slope


def rays_of(
    points_px: np.ndarray, covariance_px2: np.ndarray, camera: Camera, shared_px: np.ndarray | None = None
) -> CameraRays:
    """Return pixels (..., 2) with covariances (..., 2, 2) and a shared error (..., 2) as a camera's rays."""
    rays = undistort(camera.lens, points_px)
    slope = ray_per_pixel(camera.lens, rays)
    covariance = slope @ covariance_px2 @ np.swapaxes(slope, -1, -2)
    shared = np.zeros_like(rays) if shared_px is None else (slope @ shared_px[..., None])[..., 0]
    return CameraRays(rays, covariance, np.array(camera.rotation), np.array(camera.translation_m), shared)
