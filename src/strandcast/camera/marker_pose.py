"""A marker's pose in the motion plane from its four corners in the picture."""

import numpy as np

from strandcast.camera.mapping import distort, metre_per_pixel, pixel_to_metre, undistort
from strandcast.camera.marker_sides import END_SHARE
from strandcast.camera.markers import corners_of
from strandcast.core.pose import rotated
from strandcast.records.camera import Camera, Lens

ALONG_SIDE = np.linspace(END_SHARE, 1.0 - END_SHARE, 9)  # where sides are sampled; chosen


def true_corners(lens: Lens, corners_px: np.ndarray) -> np.ndarray:
    """Return where corners (..., 4, 2) [px] are, given where straight lines through bent sides meet.

    A wide lens bends the sides of a marker, so that lines fitted to them (`marker_sides`) meet outside its
    corners: by 0.2 px for a side of 50 px in a view of 130 degrees. Lenses with five coefficients are left
    as they are: 0.02 px with k1 = -0.12.
    """
    if len(lens.distortion) == 5:
        return corners_px
    rays = undistort(lens, corners_px)
    ahead = np.roll(rays, -1, axis=-2)
    sides = rays[..., None, :] + ALONG_SIDE[:, None] * (ahead - rays)[..., None, :]
    bent_px = distort(lens, sides)  # (..., 4, points, 2)
    middle = bent_px.mean(axis=-2)
    u, v = np.moveaxis(bent_px - middle[..., None, :], -1, 0)
    across = 0.5 * np.arctan2(2.0 * (u * v).sum(-1), (u * u - v * v).sum(-1)) + np.pi / 2.0
    normal = np.stack([np.cos(across), np.sin(across)], axis=-1)
    distance = (normal * middle).sum(axis=-1)
    before, far = np.roll(normal, 1, axis=-2), np.roll(distance, 1, axis=-1)  # of the side that ends there
    determinant = before[..., 0] * normal[..., 1] - before[..., 1] * normal[..., 0]
    met_u = (far * normal[..., 1] - distance * before[..., 1]) / determinant
    met_v = (before[..., 0] * distance - normal[..., 0] * far) / determinant
    met_px = np.stack([met_u, met_v], axis=-1)
    return np.asarray(2.0 * corners_px - met_px)


def marker_pose(
    camera: Camera, corners_px: np.ndarray, size_m: float, offset_m: float, sigma_px: float = 0.1
) -> tuple[np.ndarray, np.ndarray]:
    """Fit the rigid square to its corners in the plane `offset_m` in front of the markers' plane.

    The corners (..., 4, 2) are top left, top right, bottom right, bottom left as printed; `size_m` is the
    side of the black square, `offset_m` its height above the plane's markers, towards the camera. `sigma_px`
    is the lower bound of a corner's error, as residuals may be small by chance.

    Returns the pose (..., 3), x_m, y_m and angle_rad (0: printed upright), and the standard error (...) of
    the position, from the corners' residuals.
    """
    corners_m = pixel_to_metre(camera, true_corners(camera.lens, corners_px), offset_m)
    centre = corners_m.mean(axis=-2)
    model = corners_of(size_m)
    relative = corners_m - centre[..., None, :]
    along = (relative * model).sum(axis=(-2, -1))
    across = (model[:, 0] * relative[..., 1] - model[:, 1] * relative[..., 0]).sum(axis=-1)
    angle = np.arctan2(across, along)
    off_m = relative - rotated(model, angle[..., None])
    rms_m = np.sqrt((off_m**2).sum(axis=(-2, -1)) / 5.0)  # 8 coordinates, 3 fitted
    floor_m = sigma_px * metre_per_pixel(camera, centre, offset_m)
    return np.concatenate([centre, angle[..., None]], axis=-1), np.maximum(rms_m, floor_m) / 2.0
