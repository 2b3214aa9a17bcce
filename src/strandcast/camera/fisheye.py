"""Lenses wider than a pinhole's polynomials reach: the fisheye model of OpenCV (Kannala and Brandt 2006).

A ray at the angle θ to the optical axis is at the distance θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) from the
picture's centre, in focal lengths. A lens with four coefficients is one of these.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import scipy

# First focal lengths, over the picture's width: from a view of 180 degrees across to one of 60; chosen.
FOCAL_OVER_WIDTH = np.geomspace(0.3, 1.0, 8)
NEWTON_STEPS = 20  # chosen: 4 to 6 are usual
CONVERGED = 1e-9  # chosen: in focal lengths, about 1e-6 px
REFINED = 1e-12  # chosen: relative change of unknowns or squares at which a fit ends
WIDEST_RAD = np.radians(89.0)  # chosen: rays are stored as X/Z and Y/Z, which grow without bound


def bent_angle(distortion: np.ndarray, angle_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances from the centre [focal lengths] of rays at angles to the axis, and the slope."""
    square = angle_rad * angle_rad
    k1, k2, k3, k4 = distortion
    factor = 1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4)))
    slope = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4)))
    return angle_rad * factor, slope


def radial(distortion: np.ndarray, square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the factor on rays (X/Z, Y/Z), and its slope by their squared length, (...) each."""
    safe = np.maximum(square, 1e-8)  # below, a series: the differences cancel
    ray = np.sqrt(safe)
    bent, slope = bent_angle(distortion, np.arctan(ray))
    by_square = (slope * ray / (1.0 + safe) - bent) / (2.0 * safe * ray)
    first = distortion[0] - 1.0 / 3.0
    near = square < 1e-8
    return np.where(near, 1.0 + first * square, bent / ray), np.where(near, first, by_square)


def rays(distortion: np.ndarray, bent: np.ndarray) -> np.ndarray:
    """Return the rays (..., 2) of places (..., 2) [focal lengths]; NaN beyond 89 degrees, or if none fits."""
    radius = np.linalg.norm(bent, axis=-1, keepdims=True)
    angle = np.minimum(radius, WIDEST_RAD)
    for _ in range(NEWTON_STEPS):
        reached, slope = bent_angle(distortion, angle)
        angle = np.clip(angle - (reached - radius) / slope, 0.0, np.pi)
    found = (angle < WIDEST_RAD) & (np.abs(bent_angle(distortion, angle)[0] - radius) < CONVERGED)
    ray = np.tan(np.where(found, angle, np.nan))
    return bent * np.where(radius > 0, ray / np.maximum(radius, 1e-12), 1.0)


def folds(distortion: np.ndarray, far: float) -> bool:
    """Return whether the distance from the centre stops growing before `far` [focal lengths]."""
    radius, slope = bent_angle(distortion, np.linspace(0.0, np.pi, 1000))
    rising = np.logical_and.accumulate(slope > 0)
    return not bool((radius[rising] >= far).any())


def project(
    world_m: np.ndarray, turn: np.ndarray, shift_m: np.ndarray, matrix: np.ndarray, distortion: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels (m, 2) of points (m, 3), and their Jacobian (2m, 14), as `project_points`."""
    points = np.asarray(world_m, float).reshape(1, -1, 3)
    turn, shift = (np.asarray(each, float).reshape(1, 1, 3) for each in (turn, shift_m))
    pixels, jacobian = cv2.fisheye.projectPoints(points, turn, shift, matrix, distortion)
    columns = [*range(8, 14), *range(8)]  # OpenCV: f, c, k, rotation, translation, skew
    return pixels.reshape(-1, 2), np.asarray(jacobian)[:, columns]


def solve_pose(
    world_m: np.ndarray, pixels: np.ndarray, matrix: np.ndarray, distortion: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation vector (3,) and translation (3,) [m] of coplanar points (m, 3) at pixels (m, 2)."""

    def residuals(pose: np.ndarray) -> np.ndarray:
        seen, _ = project(world_m, pose[:3], pose[3:], matrix, distortion)
        return np.ravel(seen - pixels)

    def slopes(pose: np.ndarray) -> np.ndarray:
        return project(world_m, pose[:3], pose[3:], matrix, distortion)[1][:, :6]

    start = _first_pose(world_m, pixels, matrix, distortion)
    found = scipy.optimize.least_squares(
        residuals, start, jac=slopes, x_scale="jac", xtol=REFINED, ftol=REFINED
    )
    return found.x[:3], found.x[3:]


def calibrate(
    views: Sequence[tuple[np.ndarray, np.ndarray]],
    width_px: int,
    height_px: int,
    start: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fit a fisheye lens and the poses of a flat board to its corners in several pictures.

    OpenCV's own calibration needs a good focal length to begin with; here several are tried, unless `start`
    has a matrix (3, 3) and coefficients (4,). `views` are corners on the board (m, 3) [m] and in the picture
    (m, 2) [px]. Returns matrix, coefficients, poses (views, 6) and standard errors (8,).
    """
    middle = [(width_px - 1) / 2.0, (height_px - 1) / 2.0]
    lenses = [[each * width_px, each * width_px, *middle, 0.0, 0.0, 0.0, 0.0] for each in FOCAL_OVER_WIDTH]
    if start is not None:
        lenses = [[*np.diag(start[0])[:2], *start[0][:2, 2], *start[1]]]
    starts = [
        np.concatenate([lens, *(_first_pose(*view, *_lens(lens)) for view in views)])
        for lens in np.array(lenses)
    ]
    best = min(starts, key=lambda unknowns: float((_residuals(unknowns, views) ** 2).sum()))
    fit = scipy.optimize.least_squares(
        _residuals, best, jac=_slopes, args=(views,), method="lm", x_scale="jac", xtol=REFINED, ftol=REFINED
    )
    variance = (fit.fun**2).sum() / max(len(fit.fun) - len(fit.x), 1)
    slopes = np.asarray(fit.jac)
    errors = np.sqrt(np.diag(np.linalg.pinv(slopes.T @ slopes))[:8] * variance)
    matrix, distortion = _lens(fit.x)
    return matrix, distortion, fit.x[8:].reshape(-1, 6), errors


def _lens(unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    fx, fy, cx, cy = unknowns[:4]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), unknowns[4:8]


def _first_pose(
    world_m: np.ndarray, pixels: np.ndarray, matrix: np.ndarray, distortion: np.ndarray
) -> np.ndarray:
    """Return the pose (6,) of coplanar points by a pinhole that sees the same rays."""
    ray = rays(distortion, (pixels - matrix[:2, 2]) / np.diag(matrix)[:2])
    seen = np.isfinite(ray).all(axis=1)
    if seen.sum() < 4:
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    _, turn, shift = cv2.solvePnP(world_m[seen], ray[seen], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    return np.concatenate([turn.ravel(), shift.ravel()])


def _each(
    unknowns: np.ndarray, views: Sequence[tuple[np.ndarray, np.ndarray]]
) -> list[tuple[np.ndarray, np.ndarray]]:
    matrix, distortion = _lens(unknowns)
    poses = unknowns[8:].reshape(-1, 6)
    return [
        project(board_m, pose[:3], pose[3:], matrix, distortion)
        for (board_m, _), pose in zip(views, poses, strict=True)
    ]


def _residuals(unknowns: np.ndarray, views: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    each = zip(_each(unknowns, views), views, strict=True)
    return np.concatenate([(pixels - seen).ravel() for (pixels, _), (_, seen) in each])


def _slopes(unknowns: np.ndarray, views: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    poses, lenses = zip(*(np.hsplit(slopes, [6]) for _, slopes in _each(unknowns, views)), strict=True)
    return np.hstack([np.vstack(lenses), scipy.linalg.block_diag(*poses)])
