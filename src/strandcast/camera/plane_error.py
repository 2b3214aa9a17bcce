"""Standard error of points in the string's plane from corners, marker positions, lens and offset."""

import cv2
import numpy as np
import scipy

from strandcast.camera.mapping import metre_to_pixel, pixel_to_metre
from strandcast.camera.pose import PoseFit, project
from strandcast.camera.projection import project_points
from strandcast.records.camera import Camera, PlaneError

GRID = (9, 7)  # chosen
MIN_MARKERS = 4  # from which the residuals determine the positions' scatter
DEFAULT_PLACE_SD_M = 5e-4  # chosen: of marker positions, if there are fewer markers
MIN_CORNER_SIGMA_PX = 0.02  # chosen
STEP_M = 1e-5  # chosen: of numerical derivatives

PlaneBox = tuple[tuple[float, float], tuple[float, float]]


def grid_over(box: PlaneBox) -> np.ndarray:
    """Return a grid (rows, columns, 2) [m] over a box (x from, to), (y from, to)."""
    x, y = (np.linspace(*side, count) for side, count in zip(box, GRID, strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1)


def worst_difference_m(one: Camera, other: Camera, box: PlaneBox) -> float:
    """Return the largest distance [m] between positions that two cameras assign to the same pixels.

    Infinite where one of them sees none of the positions.
    """
    places = grid_over(box)
    mapped = pixel_to_metre(other, metre_to_pixel(one, places, one.string_offset_m), one.string_offset_m)
    off_m = np.linalg.norm(mapped - places, axis=-1)
    return float(off_m[np.isfinite(off_m)].max(initial=0.0)) if np.isfinite(off_m).any() else np.inf


def place_sd_m(fit: PoseFit, scale_m_per_px: float) -> float:
    """Return the standard deviation [m] of the markers' positions, from the residuals of their centres.

    The contribution of corner errors is subtracted; six parameters were fitted.
    """
    count = len(fit.residuals_px)
    if count < MIN_MARKERS:
        return DEFAULT_PLACE_SD_M
    centres = fit.residuals_px.mean(axis=1)
    square = (centres**2).sum() / (2 * count - 6) - fit.corner_sigma_px() ** 2 / 4.0
    return float(np.sqrt(max(square, 0.0)) * scale_m_per_px)


def plane_error(
    camera: Camera, fit: PoseFit, box: PlaneBox, place_m: float | None = None, offset_sd_m: float = 0.0
) -> PlaneError:
    """Propagate all uncertainties to the points of the string's plane.

    To first order. An error of the lens displaces a point directly and, in the opposite direction, through
    the pose fitted with that lens; errors of corners and marker positions act through the pose.

    `box` is the workspace [m]. `place_m` is the standard deviation of the markers' measured positions, by
    default from the residuals, and `offset_sd_m` that of the height of the string's plane above the markers'.
    """
    place = place_sd_m(fit, camera.scale_m_per_px) if place_m is None else place_m
    sigma_px = max(fit.corner_sigma_px(), MIN_CORNER_SIGMA_PX)
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
    optics, rotation = camera.lens, cv2.Rodrigues(fit.rotation)[0].reshape(3)
    seen_by = rotation, fit.shift_m, np.array(optics.matrix), np.array(optics.distortion)
    pose, lens = np.hsplit(project_points(fit.world_m, *seen_by)[1], [6])
    to_pose = np.linalg.solve(pose.T @ pose, pose.T)  # from corner errors, (6, 8K)
    world_m = np.dstack([places_m, np.full(places_m.shape[:2], camera.string_offset_m)])
    there = project_points(world_m, *seen_by)[1].reshape(*places_m.shape, -1)
    pose_there, lens_there = there[..., :6], there[..., 6:]
    to_metre = -np.linalg.inv(pixel_slopes(fit, world_m, camera))  # at a fixed pixel: dx = -J⁻¹ dp
    moved = _moved_places(fit, camera)
    paths = {
        "corners": to_metre @ pose_there @ to_pose * sigma_px,
        "places": to_metre @ pose_there @ to_pose @ moved * place_m,
        "offset": to_metre @ pixel_slopes(fit, world_m, camera, (2,)) * offset_sd_m,
    }
    found = {name: path @ np.swapaxes(path, -1, -2) for name, path in paths.items()}
    if camera.lens.covariance:
        path = to_metre @ (lens_there - pose_there @ to_pose @ lens)
        found["lens"] = path @ np.array(camera.lens.covariance) @ np.swapaxes(path, -1, -2)
    return found


def pixel_slopes(
    fit: PoseFit, world_m: np.ndarray, camera: Camera, axes: tuple[int, ...] = (0, 1)
) -> np.ndarray:
    """Return the Jacobian (..., 2, axes) [px/m] of the pixels of points (..., 3) by world axes."""
    steps_m, pose = STEP_M * np.eye(3)[list(axes)], (fit.rotation, fit.shift_m, camera.lens)
    columns = [
        (project(world_m + step, *pose) - project(world_m - step, *pose)) / (2.0 * STEP_M) for step in steps_m
    ]
    return np.stack(columns, axis=-1)


def _moved_places(fit: PoseFit, camera: Camera) -> np.ndarray:
    """Return the Jacobian (8K, 2K) of corners by marker positions: a marker moves its four corners alike."""
    slopes = pixel_slopes(fit, fit.world_m, camera)  # (K, 4, 2, 2)
    return np.asarray(scipy.linalg.block_diag(*slopes.reshape(-1, 8, 2)))
