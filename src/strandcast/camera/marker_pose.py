"""A marker's pose in the motion plane from its four corners in the picture."""

import numpy as np

from strandcast.camera.mapping import metre_per_pixel, pixel_to_metre
from strandcast.camera.markers import corners_of
from strandcast.records.camera import Camera


def marker_pose(
    camera: Camera, corners_px: np.ndarray, size_m: float, offset_m: float, sigma_px: float = 0.1
) -> tuple[np.ndarray, np.ndarray]:
    """Fit the rigid square to its corners in the plane `offset_m` in front of the markers' plane.

    Parameters
    ----------
    camera
        Lens and pose.
    corners_px
        (..., 4, 2), top left, top right, bottom right, bottom left as printed.
    size_m
        Side of the black square.
    offset_m
        Height of this marker above the plane's markers, towards the camera.
    sigma_px
        Lower bound of a corner's error, as residuals may be small by chance.

    Returns
    -------
    pose : ndarray (..., 3)
        x_m, y_m, angle_rad of the marker (0: printed upright).
    sigma_m : ndarray (...)
        Standard error of the position, from the corners' residuals.
    """
    corners_m = pixel_to_metre(camera, corners_px, offset_m)
    centre = corners_m.mean(axis=-2)
    model = corners_of(size_m)
    relative = corners_m - centre[..., None, :]
    along = (relative * model).sum(axis=(-2, -1))
    across = (model[:, 0] * relative[..., 1] - model[:, 1] * relative[..., 0]).sum(axis=-1)
    angle = np.arctan2(across, along)
    cosine, sine = np.cos(angle)[..., None], np.sin(angle)[..., None]
    rotated = np.stack(
        [cosine * model[:, 0] - sine * model[:, 1], sine * model[:, 0] + cosine * model[:, 1]], axis=-1
    )
    rms_m = np.sqrt(((relative - rotated) ** 2).sum(axis=(-2, -1)) / 5.0)  # 8 coordinates, 3 fitted
    floor_m = sigma_px * metre_per_pixel(camera, centre, offset_m)
    return np.concatenate([centre, angle[..., None]], axis=-1), np.maximum(rms_m, floor_m) / 2.0
