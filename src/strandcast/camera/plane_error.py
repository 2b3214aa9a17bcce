"""How well a point of the string's plane is known: corners, markers' places, lens and offset, propagated."""

from __future__ import annotations

import cv2
import numpy as np

from strandcast.camera.lens_error import jacobians
from strandcast.camera.mapping import metre_to_pixel, pixel_to_metre
from strandcast.camera.pose import PoseFit, project
from strandcast.records.camera import Camera, PlaneError

GRID = (9, 7)
FEW_MARKERS = 4
USUAL_PLACE_SD_M = 5e-4  # of markers whose places too few others can check
LEAST_CORNER_SIGMA_PX = 0.02
STEP_M = 1e-5

Box = tuple[tuple[float, float], tuple[float, float]]


def grid_over(box: Box, shape: tuple[int, int] = GRID) -> np.ndarray:
    """Return places (rows, columns, 2) [m] spread over a box (x from, to), (y from, to)."""
    x, y = (np.linspace(*side, count) for side, count in zip(box, shape, strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1)


def worst_difference_m(one: Camera, other: Camera, box: Box) -> float:
    """Return the largest distance [m] between what two cameras make of the same pixels of the string."""
    places = grid_over(box)
    seen = pixel_to_metre(other, metre_to_pixel(one, places, one.string_offset_m), one.string_offset_m)
    return float(np.nanmax(np.linalg.norm(seen - places, axis=-1)))


def place_sd_m(fit: PoseFit, scale_m_per_px: float) -> float:
    """Return the standard deviation [m] of the markers' places, by how well their centres fit.

    What the corners' own errors leave is taken off; six numbers were fitted.
    """
    count = len(fit.residuals_px)
    if count < FEW_MARKERS:
        return USUAL_PLACE_SD_M
    centres = fit.residuals_px.mean(axis=1)
    square = (centres**2).sum() / (2 * count - 6) - fit.corner_sigma_px() ** 2 / 4.0
    return float(np.sqrt(max(square, 0.0)) * scale_m_per_px)


def plane_error(
    camera: Camera, fit: PoseFit, box: Box, place_m: float | None = None, offset_sd_m: float = 0.0
) -> PlaneError:
    """Propagate all that is not known to the points of the string's plane.

    To first order: an error of the lens moves a point directly and, the other way, through the pose, which
    was fitted with that lens to the markers; the corners' and the places' errors come through the pose.

    Parameters
    ----------
    camera, fit
        As fitted; the lens with its covariance.
    box
        The workspace [m].
    place_m
        How well the markers' places were measured (one standard deviation); by default from the fit.
    offset_sd_m
        How well the height of the string's plane over the markers' is known.
    """
    place = place_sd_m(fit, camera.scale_m_per_px) if place_m is None else place_m
    sigma_px = max(fit.corner_sigma_px(), LEAST_CORNER_SIGMA_PX)
    places = grid_over(box)
    sources = _covariances(camera, fit, places, sigma_px, place, offset_sd_m)
    sigma = _sigma(np.sum(list(sources.values()), axis=0))
    return PlaneError(
        x_m=places[0, :, 0].tolist(),
        y_m=places[:, 0, 1].tolist(),
        sigma_m=sigma.tolist(),
        median_m=float(np.median(sigma)),
        worst_m=float(sigma.max()),
        sources_m={name: float(_sigma(each).max()) for name, each in sources.items()},
        corner_sigma_px=sigma_px,
        place_sd_m=place,
        string_offset_sd_m=offset_sd_m,
    )


def _sigma(covariances: np.ndarray) -> np.ndarray:
    """Return the root of the mean of both variances, (..., 2, 2) -> (...)."""
    return np.asarray(np.sqrt(np.trace(covariances, axis1=-2, axis2=-1) / 2.0))


def _covariances(
    camera: Camera, fit: PoseFit, places_m: np.ndarray, sigma_px: float, place_m: float, offset_sd_m: float
) -> dict[str, np.ndarray]:
    """Return the covariance (rows, columns, 2, 2) [m²] that each source gives a point of the plane."""
    matrix, distortion = np.array(camera.lens.matrix), np.array(camera.lens.distortion)
    turn = cv2.Rodrigues(fit.rotation)[0].reshape(3)
    pose, lens = jacobians(fit.world_m, turn, fit.shift_m, matrix, distortion)
    to_pose = np.linalg.solve(pose.T @ pose, pose.T)  # of errors of the corners (6, 8K)
    world_m = np.dstack([places_m, np.full(places_m.shape[:2], camera.string_offset_m)])
    pose_there, lens_there = (
        each.reshape(*places_m.shape, -1)
        for each in jacobians(world_m, turn, fit.shift_m, matrix, distortion)
    )
    to_metre = -np.linalg.inv(pixel_slopes(fit, world_m, camera))  # a pixel that stays: dx = -J⁻¹ dp
    moved = _moved_places(fit, camera)
    ways = {
        "corners": to_metre @ pose_there @ to_pose * sigma_px,
        "places": to_metre @ pose_there @ to_pose @ moved * place_m,
        "offset": to_metre @ pixel_slopes(fit, world_m, camera, (2,)) * offset_sd_m,
    }
    found = {name: way @ np.swapaxes(way, -1, -2) for name, way in ways.items()}
    if camera.lens.covariance:
        way = to_metre @ (lens_there - pose_there @ to_pose @ lens)
        found["lens"] = way @ np.array(camera.lens.covariance) @ np.swapaxes(way, -1, -2)
    return found


def pixel_slopes(
    fit: PoseFit, world_m: np.ndarray, camera: Camera, axes: tuple[int, ...] = (0, 1)
) -> np.ndarray:
    """Return the slopes (..., 2, axes) [px/m] of the pixels of points (..., 3) over axes of the world."""
    steps_m = STEP_M * np.eye(3)[list(axes)]
    columns = [
        (_seen(fit, world_m + step, camera) - _seen(fit, world_m - step, camera)) / (2.0 * STEP_M)
        for step in steps_m
    ]
    return np.stack(columns, axis=-1)


def _seen(fit: PoseFit, world_m: np.ndarray, camera: Camera) -> np.ndarray:
    return project(world_m, fit.rotation, fit.shift_m, camera.lens)


def _moved_places(fit: PoseFit, camera: Camera) -> np.ndarray:
    """Return how corners (8K) follow the places of the markers (2K): each moves its four alike."""
    slopes = pixel_slopes(fit, fit.world_m, camera)  # (K, 4, 2, 2)
    count = len(slopes)
    follow = np.zeros((count, 4, 2, count, 2))
    for marker in range(count):
        follow[marker, :, :, marker, :] = slopes[marker]
    return follow.reshape(8 * count, 2 * count)
