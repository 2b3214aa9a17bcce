"""Pixel to metre and back through the lens distortion, for points in the plane or in front of it."""

import numpy as np

from strandcast.camera import fisheye
from strandcast.camera.fisheye import NEWTON_STEPS
from strandcast.records.camera import Camera, Lens, is_fisheye

CONVERGED = 1e-12  # chosen: in normalised picture coordinates, about 1e-9 px


def metre_to_pixel(camera: Camera, xy_m: np.ndarray, offset_m: float = 0.0) -> np.ndarray:
    """Return the pixels (..., 2) of points (..., 2) [m] of the motion plane; NaN behind the camera.

    `offset_m` is the height of the points above the plane of the markers, towards the camera.
    """
    xy_m = np.asarray(xy_m, float)
    rotation, shift = np.array(camera.rotation), np.array(camera.translation_m)
    in_camera = xy_m @ rotation[:, :2].T + rotation[:, 2] * offset_m + shift
    depth = np.where(in_camera[..., 2:] > 0, in_camera[..., 2:], np.nan)
    return distort(camera.lens, in_camera[..., :2] / depth)


def pixel_to_metre(camera: Camera, uv_px: np.ndarray, offset_m: float = 0.0) -> np.ndarray:
    """Return the positions (..., 2) [m] of pixels (..., 2) in the motion plane, or `offset_m` in front of it.

    The inverse of `metre_to_pixel`; NaN if the pixel's ray does not meet the plane.
    """
    rays = undistort(camera.lens, np.asarray(uv_px, float))
    rotation, shift = np.array(camera.rotation), np.array(camera.translation_m)
    directions = rays @ rotation[:2] + rotation[2]
    eye = -rotation.T @ shift
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (offset_m - eye[2]) / directions[..., 2:]
    return np.where(reach > 0, eye[:2] + reach * directions[..., :2], np.nan)


def leaves_picture(camera: Camera, points_m: np.ndarray) -> np.ndarray:
    """Return the rows of a string's points (F, n + 1, 2) in which the first that is not seen is outside.

    Where the string goes straight on from the last points that are seen.
    """
    seen = np.isfinite(points_m).all(axis=2)
    last = np.argmin(seen, axis=1) - 1
    rows = np.flatnonzero(~seen[:, -1] & (last > 0))
    next_m = 2.0 * points_m[rows, last[rows]] - points_m[rows, last[rows] - 1]
    pixel = metre_to_pixel(camera, next_m, camera.string_offset_m)
    inside = (pixel >= 0.0) & (pixel < [camera.lens.width_px, camera.lens.height_px])
    return rows[~inside.all(axis=1)]


def pixel_per_metre(camera: Camera, xy_m: np.ndarray, offset_m: float = 0.0) -> np.ndarray:
    """Return the Jacobian (..., 2, 2) [px/m] of `metre_to_pixel` at points (..., 2): d(u, v) / d(x, y)."""
    xy_m, step_m = np.asarray(xy_m, float), 1e-5
    columns = [
        (metre_to_pixel(camera, xy_m + step, offset_m) - metre_to_pixel(camera, xy_m - step, offset_m))
        / (2 * step_m)
        for step in step_m * np.eye(2)
    ]
    return np.stack(columns, axis=-1)


def metre_per_pixel(camera: Camera, xy_m: np.ndarray, offset_m: float = 0.0) -> np.ndarray:
    """Return the local scale (...) [m/px] at points (..., 2): the side of a square as large as a pixel."""
    jacobian = pixel_per_metre(camera, xy_m, offset_m)
    area = jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0]
    return np.asarray(1.0 / np.sqrt(np.abs(area)))


def distort(lens: Lens, rays: np.ndarray) -> np.ndarray:
    """Return the pixels (..., 2) of undistorted rays (..., 2) = X/Z, Y/Z."""
    matrix = np.array(lens.matrix)
    return np.asarray(_distorted(np.array(lens.distortion), rays)[0] @ matrix[:2, :2].T + matrix[:2, 2])


def undistort(lens: Lens, uv_px: np.ndarray) -> np.ndarray:
    """Return the undistorted rays (..., 2) of pixels (..., 2) by Newton's method; NaN if it diverges."""
    matrix = np.array(lens.matrix)
    wanted = (uv_px - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T
    coefficients = np.array(lens.distortion)
    if is_fisheye(coefficients):
        return fisheye.rays(coefficients, wanted)
    rays = wanted.copy()
    for _ in range(NEWTON_STEPS):
        bent, slope = _distorted(coefficients, rays)
        miss = wanted - bent
        if not np.nanmax(np.abs(miss), initial=0.0) > CONVERGED:
            break
        determinant = slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] * slope[..., 1, 0]
        step_x = (slope[..., 1, 1] * miss[..., 0] - slope[..., 0, 1] * miss[..., 1]) / determinant
        step_y = (slope[..., 0, 0] * miss[..., 1] - slope[..., 1, 0] * miss[..., 0]) / determinant
        rays = rays + np.stack([step_x, step_y], axis=-1)
    off = np.abs(wanted - _distorted(coefficients, rays)[0]).max(axis=-1, keepdims=True)
    return np.where(off < 1e3 * CONVERGED, rays, np.nan)


def ray_per_pixel(lens: Lens, rays: np.ndarray) -> np.ndarray:
    """Return the Jacobian (..., 2, 2) [1/px] of `undistort` at the rays (..., 2) that it returns."""
    slope = np.array(lens.matrix)[:2, :2] @ _distorted(np.array(lens.distortion), rays)[1]
    return np.linalg.inv(slope)


def _distorted(coefficients: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rays (..., 2) distorted by OpenCV's k1, k2, p1, p2, k3[, k4, k5, k6], and the Jacobian.

    The radial factor is (1 + k1 s + k2 s² + k3 s³) / (1 + k4 s + k5 s² + k6 s³), s the squared ray. Four
    coefficients are a fisheye lens'.
    """
    p1, p2 = (0.0, 0.0) if is_fisheye(coefficients) else coefficients[2:4]
    x, y = rays[..., 0], rays[..., 1]
    square = x * x + y * y
    radial, radial_slope = _radial(coefficients, square)
    bent_x = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
    bent_y = y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
    cross = 2.0 * x * y * radial_slope + 2.0 * p1 * x + 2.0 * p2 * y
    slope_x = radial + 2.0 * x * x * radial_slope + 2.0 * p1 * y + 6.0 * p2 * x
    slope_y = radial + 2.0 * y * y * radial_slope + 6.0 * p1 * y + 2.0 * p2 * x
    slope = np.stack([np.stack([slope_x, cross], -1), np.stack([cross, slope_y], -1)], -2)
    return np.stack([bent_x, bent_y], axis=-1), slope


def _radial(coefficients: np.ndarray, square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the radial factor and its slope by the squared ray, (...) each."""
    if is_fisheye(coefficients):
        return fisheye.radial(coefficients, square)
    k1, k2, _, _, k3 = coefficients[:5]
    above = 1.0 + square * (k1 + square * (k2 + square * k3))
    above_slope = k1 + square * (2.0 * k2 + square * 3.0 * k3)
    if len(coefficients) < 8:
        return above, above_slope
    k4, k5, k6 = coefficients[5:8]
    below = 1.0 + square * (k4 + square * (k5 + square * k6))
    below_slope = k4 + square * (2.0 * k5 + square * 3.0 * k6)
    return above / below, (above_slope - above / below * below_slope) / below
