"""A marker's place and turn in the motion plane from its four corners in the picture."""

from __future__ import annotations

import numpy as np

from strandcast.camera.mapping import metre_per_pixel, pixel_to_metre
from strandcast.camera.markers import corners_of
from strandcast.records.camera import Camera


def marker_pose(
    camera: Camera, corners_px: np.ndarray, size_m: float, offset_m: float, sigma_px: float = 0.1
) -> tuple[np.ndarray, np.ndarray]:
    """Fit the square to its corners, rigidly, in the plane `offset_m` in front of the markers' plane.

    Parameters
    ----------
    camera
        Lens and pose.
    corners_px
        (..., 4, 2), top left, top right, bottom right, bottom left as printed.
    size_m
        Side of the black square.
    offset_m
        Height of this marker over the plane's markers, towards the camera.
    sigma_px
        Least error of a corner, where its residual is smaller by chance.

    Returns
    -------
    pose : ndarray (..., 3)
        x_m, y_m, angle_rad of the marker (0: printed upright).
    sigma_m : ndarray (...)
        Standard error of the place, from the corners' residuals.
    """
    corners_m = pixel_to_metre(camera, corners_px, offset_m)
    centre = corners_m.mean(axis=-2)
    model = corners_of(size_m)
    about = corners_m - centre[..., None, :]
    along = (about * model).sum(axis=(-2, -1))
    across = (model[:, 0] * about[..., 1] - model[:, 1] * about[..., 0]).sum(axis=-1)
    angle = np.arctan2(across, along)
    cosine, sine = np.cos(angle)[..., None], np.sin(angle)[..., None]
    placed = np.stack(
        [cosine * model[:, 0] - sine * model[:, 1], sine * model[:, 0] + cosine * model[:, 1]], axis=-1
    )
    rms_m = np.sqrt(((about - placed) ** 2).sum(axis=(-2, -1)) / 5.0)  # 8 numbers, 3 fitted
    floor_m = sigma_px * metre_per_pixel(camera, centre, offset_m)
    return np.concatenate([centre, angle[..., None]], axis=-1), np.maximum(rms_m, floor_m) / 2.0
