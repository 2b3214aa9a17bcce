"""Detection of motion outside the declared plane, from the apparent size of a moving marker."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from strandcast.camera.mapping import pixel_to_metre, undistort
from strandcast.camera.plane_error import PlaneBox, grid_over
from strandcast.camera.pose import project
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

MIN_DETECTIONS = 20  # chosen
CORRELATED_FRAMES = 10  # chosen: neighbouring frames with common corner errors that count as one
ERROR_M, WARNING_M = 10e-3, 2e-3  # chosen
SIGNIFICANT = 4.0  # chosen: standard errors


class PlaneTilt(NamedTuple):
    """The plane in which a marker moves, relative to the declared plane."""

    # (3,) height [m] over the declared plane, towards the camera, at the path's centre, and slopes along x, y
    plane: np.ndarray
    sigma: np.ndarray  # (3,) standard errors of these
    cost_m: float  # largest error of a point in the box around the marker's path

    @property
    def significance(self) -> float:
        """Return the largest ratio of the three numbers to their standard errors."""
        return float(np.max(np.abs(self.plane) / self.sigma))


def fit_plane_tilt(
    camera: Camera, corners_px: np.ndarray, size_m: float, offset_m: float
) -> PlaneTilt | None:
    """Fit the plane in which a marker moved to its apparent size along the path.

    A marker appears larger by 0.44 % per 10 mm at 2.3 m. One detection gives its height to centimetres,
    hundreds along the path give a plane to millimetres; fewer than 20 give none.

    `corners_px` (F, 4, 2) are the marker's in each frame, NaN if not detected; `size_m` is the side of its
    black square, `offset_m` its declared height above the plane's markers.
    """
    good = np.isfinite(corners_px).all(axis=(1, 2))
    if good.sum() < MIN_DETECTIONS:
        return None
    corners = corners_px[good]
    middle_m = pixel_to_metre(camera, corners, offset_m).mean(axis=1)
    origin = middle_m.mean(axis=0)
    plane, covariance = _fit(camera, corners, size_m, offset_m, origin)
    (left, low), (right, high) = middle_m.min(axis=0), middle_m.max(axis=0)
    cost_m = _cost_m(camera, plane, origin, ((left, right), (low, high)), offset_m)
    return PlaneTilt(plane, np.sqrt(np.diag(covariance)), cost_m)


def _fit(
    camera: Camera, corners_px: np.ndarray, size_m: float, offset_m: float, origin: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return height and slopes (3,) of the plane in which all sides have the marker's size."""
    rotation = np.array(camera.rotation)
    eye = -rotation.T @ np.array(camera.translation_m)
    rays = undistort(camera.lens, corners_px)
    directions = rays @ rotation[:2] + rotation[2]

    def off(numbers: np.ndarray) -> np.ndarray:
        height, slopes = offset_m + numbers[0], numbers[1:]
        # eye + reach · direction on z = height + slopes · ((x, y) − origin)
        gap = height + slopes @ (eye[:2] - origin) - eye[2]
        reach = gap / (directions[..., 2] - directions[..., :2] @ slopes)
        corners_m = eye + reach[..., None] * directions
        sides_m = np.linalg.norm(np.roll(corners_m, -1, axis=1) - corners_m, axis=2)
        return np.asarray(sides_m - size_m).ravel()

    rough = 1.4826 * np.median(np.abs(off(np.zeros(3)) - np.median(off(np.zeros(3))))) + 1e-9
    fit = scipy.optimize.least_squares(off, np.zeros(3), loss="soft_l1", f_scale=2.0 * rough, x_scale="jac")
    slopes = np.asarray(fit.jac)
    residuals = off(fit.x)
    variance = (1.4826 * np.median(np.abs(residuals))) ** 2 * CORRELATED_FRAMES
    return np.asarray(fit.x), np.linalg.pinv(slopes.T @ slopes) * variance


def _cost_m(camera: Camera, numbers: np.ndarray, origin: np.ndarray, box: PlaneBox, offset_m: float) -> float:
    """Return the largest error of points in the tilted plane that are mapped to the declared plane."""
    places = grid_over(box)
    height = numbers[0] + (places - origin) @ numbers[1:]
    rotation, shift = np.array(camera.rotation), np.array(camera.translation_m)
    pixels = project(np.dstack([places, offset_m + height]), rotation, shift, camera.lens)
    read = pixel_to_metre(camera, pixels, offset_m)
    stretched = np.sqrt(1.0 + numbers[1:] ** 2)  # along the tilted plane
    return float(np.linalg.norm(read - origin - (places - origin) * stretched, axis=-1).max())


def check_plane_tilt(tilt: PlaneTilt, file: str | Path | None = None) -> list[str]:
    """Check that the motion lies in the declared plane; return warnings.

    Raises
    ------
    StrandcastError
        SC-C041 the error at the string exceeds 10 mm.
    """
    if tilt.significance < SIGNIFICANT or tilt.cost_m < WARNING_M:
        return []
    height_m, angle = tilt.plane[0], np.degrees(np.arctan(tilt.plane[1:]))
    what = (
        f"the hand moves in a plane {height_m * 1e3:+.0f} mm in front of the declared one, tilted by "
        f"{angle[0]:+.1f} degrees along x and {angle[1]:+.1f} along y"
    )
    if tilt.cost_m > ERROR_M:
        cost = f"up to {tilt.cost_m * 1e3:.0f} mm at the string"
        field = "camera.string_offset_m"
        raise StrandcastError("SC-C041", what, file=file, field=field, cost=cost)
    return [f"{what}: up to {tilt.cost_m * 1e3:.1f} mm at the string"]
