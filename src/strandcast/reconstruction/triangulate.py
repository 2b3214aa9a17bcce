"""Points that several calibrated cameras see at one instant, in space, with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from strandcast.reconstruction.rays import CameraRays

STEPS = 6  # of Gauss-Newton; from the linear start, 3 reach rounding
INCONSISTENT_SIGMA = 5.0  # chosen: reprojection error beyond which cameras do not see the same point
LEAST_ANGLE_RAD = np.radians(5.0)  # chosen: below, an error of a ray counts more than eleven times in depth
# Bits of `SpacePoints.doubts`.
INCONSISTENT = 1  # the reprojection error is larger than the detections' covariance explains
PARALLEL = 2  # the rays are nearly parallel: the depth is poorly known
ONE_CAMERA = 4  # fewer than two cameras see it


class SpacePoints(NamedTuple):
    """Points in space.

    Attributes
    ----------
    points_m
        (..., 3), NaN where they are not known.
    covariance_m2
        (..., 3, 3).
    misfit_sigma
        (...) reprojection error over what the covariance explains; 1 is usual, NaN without redundancy.
    doubts
        (...) bits `INCONSISTENT`, `PARALLEL`, `ONE_CAMERA`.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    misfit_sigma: np.ndarray
    doubts: np.ndarray


def triangulate(views: Sequence[CameraRays]) -> SpacePoints:
    """Return the points in space that explain rays (..., 2) of several cameras best.

    Weighted least squares of the reprojection errors: the linear solution, then Gauss-Newton. Element by
    element, the rays of all cameras are of the same point at the same instant; NaN where one does not see it.
    """
    weights = [weights_of(view) for view in views]
    points_m = _linear(views, weights)
    for _ in range(STEPS):
        information, pull, _ = _normal_equations(views, weights, points_m)
        points_m = points_m + (inverse(information) @ pull[..., None])[..., 0]
    information, _, square = _normal_equations(views, weights, points_m)
    seen = sum(np.isfinite(view.rays).all(axis=-1).astype(int) for view in views)
    points_m = np.where((seen >= 2)[..., None], points_m, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        misfit_sigma = np.where(seen >= 2, np.sqrt(square / (2 * seen - 3)), np.nan)
    doubts = INCONSISTENT * ~(misfit_sigma <= INCONSISTENT_SIGMA) * (seen >= 2)
    doubts = doubts | PARALLEL * ~(largest_angle_rad(views) >= LEAST_ANGLE_RAD) * (seen >= 2)
    covariance_m2 = np.where(np.isfinite(points_m)[..., None], inverse(information), np.nan)
    return SpacePoints(points_m, covariance_m2, misfit_sigma, doubts | ONE_CAMERA * (seen < 2))


def weights_of(view: CameraRays) -> np.ndarray:
    """Return the inverse covariances (..., 2, 2), zero where nothing was detected."""
    seen = np.isfinite(view.rays).all(axis=-1)
    covariance = view.covariance + view.shared[..., :, None] * view.shared[..., None, :]
    return np.where(seen[..., None, None], inverse(covariance), 0.0)


def inverse(matrices: np.ndarray) -> np.ndarray:
    """Return the inverses of matrices (..., k, k), NaN where they have none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        regular = np.abs(np.linalg.det(matrices)) > 0.0
    filled = np.where(regular[..., None, None], matrices, np.eye(matrices.shape[-1]))
    return np.where(regular[..., None, None], np.linalg.inv(filled), np.nan)


def largest_angle_rad(views: Sequence[CameraRays]) -> np.ndarray:
    """Return the largest angle (...) between the rays of two cameras, NaN where fewer see the point."""
    pairs = [(one, other) for k, one in enumerate(views) for other in views[:k]]
    cosines = [np.abs((one.directions() * other.directions()).sum(axis=-1)) for one, other in pairs]
    return np.asarray(np.arccos(np.clip(np.fmin.reduce(cosines), 0.0, 1.0)))


def _linear(views: Sequence[CameraRays], weights: Sequence[np.ndarray]) -> np.ndarray:
    """Return points (..., 3) at the least distance from the rays in each camera's plane at depth one."""
    information, pull = 0.0, 0.0
    for view, weight in zip(views, weights, strict=True):
        rays = np.nan_to_num(view.rays)
        rows = view.rotation[:2] - rays[..., None] * view.rotation[2]
        offset = rays * view.translation_m[2] - view.translation_m[:2]
        turned = np.swapaxes(rows, -1, -2) @ weight
        information, pull = information + turned @ rows, pull + (turned @ offset[..., None])[..., 0]
    return np.asarray((inverse(np.asarray(information)) @ np.asarray(pull)[..., None])[..., 0])


def _normal_equations(
    views: Sequence[CameraRays], weights: Sequence[np.ndarray], points_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the information (..., 3, 3), the gradient (..., 3), and the weighted sum of squares (...)."""
    information, pull, square = 0.0, 0.0, 0.0
    for view, weight in zip(views, weights, strict=True):
        rays, slope = view.projected(points_m)
        seen = np.isfinite(view.rays)
        off, slope = np.where(seen, view.rays - rays, 0.0), np.where(seen[..., None], slope, 0.0)
        turned = np.swapaxes(slope, -1, -2) @ weight
        information = information + turned @ slope
        pull = pull + (turned @ off[..., None])[..., 0]
        square = square + (off[..., None, :] @ weight @ off[..., None])[..., 0, 0]
    return np.asarray(information), np.asarray(pull), np.asarray(square)
