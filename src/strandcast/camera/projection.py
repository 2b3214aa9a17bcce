"""Points in space to pixels through any lens, and a flat object's pose from its pixels."""

import cv2
import numpy as np

from strandcast.camera import fisheye
from strandcast.records.camera import is_fisheye


def project_points(
    world_m: np.ndarray, turn: np.ndarray, shift_m: np.ndarray, matrix: np.ndarray, distortion: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels (m, 2) of points (..., 3) [m] through a lens, and their Jacobian.

    `turn` (3,), a rotation vector, and `shift_m` (3,) are from the world to the camera; `distortion` has 4, 5
    or 8 coefficients. The Jacobian (2m, 10 + coefficients) is by rotation, translation, fx, fy, cx, cy and
    the coefficients.
    """
    if is_fisheye(distortion):
        return fisheye.project(world_m, turn, shift_m, matrix, distortion)
    pixels, jacobian = cv2.projectPoints(world_m.reshape(-1, 3), turn, shift_m, matrix, distortion)
    return np.asarray(pixels, float).reshape(-1, 2), np.asarray(jacobian)[:, : 10 + len(distortion)]


def straightened(
    pixels: np.ndarray, matrix: np.ndarray, distortion: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pixels (m, 2), matrix and distortion as OpenCV's solvers of poses take them.

    A fisheye lens is replaced by the pinhole that sees the same rays.
    """
    if not is_fisheye(distortion):
        return pixels, matrix, distortion
    rays = fisheye.rays(distortion, (pixels - matrix[:2, 2]) / np.diag(matrix)[:2])
    return rays * np.diag(matrix)[:2] + matrix[:2, 2], matrix, np.zeros(5)
