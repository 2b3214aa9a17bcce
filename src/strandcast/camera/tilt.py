"""Whether the motion lies in the plane that is meant: the height of a moving marker of known size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from strandcast.camera.mapping import pixel_to_metre, undistort
from strandcast.camera.plane_error import Box, grid_over
from strandcast.camera.pose import project
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

LEAST_SIGHTINGS = 20
SMOOTH = 10  # neighbouring frames share the errors of their corners: so many count as one
ERROR_M, WARNING_M = 10e-3, 2e-3
SURE = 4.0


@dataclass(frozen=True)
class Tilt:
    """The plane in which a marker moves, against the plane that is meant.

    Attributes
    ----------
    height_m
        Of the marker's plane over the plane meant, towards the camera, at the middle of its path.
    slope_x, slope_y
        How that height grows over x and y (tangents of the tilt).
    sigma_m, sigma_x, sigma_y
        Standard errors.
    cost_m
        By how much a point of the workspace would be off, at the worst place of the marker's path.
    """

    height_m: float
    slope_x: float
    slope_y: float
    sigma_m: float
    sigma_x: float
    sigma_y: float
    cost_m: float

    @property
    def significance(self) -> float:
        """Return the largest of the three numbers over its standard error."""
        return max(
            abs(self.height_m) / self.sigma_m,
            abs(self.slope_x) / self.sigma_x,
            abs(self.slope_y) / self.sigma_y,
        )


def find_tilt(camera: Camera, corners_px: np.ndarray, size_m: float, offset_m: float) -> Tilt | None:
    """Fit the plane in which a marker moved to how large it was seen at each place.

    A marker nearer to the camera is seen larger: by 0.44 % per 10 mm at 2.3 m. One sighting tells its height
    to centimetres, hundreds over the whole path tell a plane to millimetres.

    Parameters
    ----------
    camera
        Lens and pose.
    corners_px
        (F, 4, 2), the marker's corners in frames; NaN where it was not seen.
    size_m
        Side of its black square.
    offset_m
        Its height over the plane of the plane's markers, as it is meant.

    Returns
    -------
    Tilt or None
        None for fewer than 20 sightings.
    """
    good = np.isfinite(corners_px).all(axis=(1, 2))
    if good.sum() < LEAST_SIGHTINGS:
        return None
    corners = corners_px[good]
    middle_m = pixel_to_metre(camera, corners, offset_m).mean(axis=1)
    origin = middle_m.mean(axis=0)
    numbers, covariance = _fit(camera, corners, size_m, offset_m, origin)
    sigma = np.sqrt(np.diag(covariance))
    (left, low), (right, high) = middle_m.min(axis=0), middle_m.max(axis=0)
    cost_m = _cost_m(camera, numbers, origin, ((left, right), (low, high)), offset_m)
    height_m, slope_x, slope_y = map(float, numbers)
    sigma_m, sigma_x, sigma_y = map(float, sigma)
    return Tilt(height_m, slope_x, slope_y, sigma_m, sigma_x, sigma_y, cost_m)


def _fit(
    camera: Camera, corners_px: np.ndarray, size_m: float, offset_m: float, origin: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return height and slopes (3,) of the plane in which all the sides are of the marker's size."""
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
    fit = least_squares(off, np.zeros(3), loss="soft_l1", f_scale=2.0 * rough, x_scale="jac")
    slopes = np.asarray(fit.jac)
    residuals = off(fit.x)
    variance = (1.4826 * np.median(np.abs(residuals))) ** 2 * SMOOTH
    return np.asarray(fit.x), np.linalg.pinv(slopes.T @ slopes) * variance


def _cost_m(camera: Camera, numbers: np.ndarray, origin: np.ndarray, box: Box, offset_m: float) -> float:
    """Return the largest error of places on the tilted plane that are read as if they were in the plane."""
    places = grid_over(box)
    height = numbers[0] + (places - origin) @ numbers[1:]
    rotation, shift = np.array(camera.rotation), np.array(camera.translation_m)
    pixels = project(np.dstack([places, offset_m + height]), rotation, shift, camera.lens)
    read = pixel_to_metre(camera, pixels, offset_m)
    stretched = np.sqrt(1.0 + numbers[1:] ** 2)  # along the tilted plane
    return float(np.linalg.norm(read - origin - (places - origin) * stretched, axis=-1).max())


def refuse_tilt(tilt: Tilt, file: str | Path | None = None) -> list[str]:
    """Say whether the motion's plane is the one meant; returns warnings.

    Raises
    ------
    StrandcastError
        SC-C041: by more than 10 mm at the string.
    """
    if tilt.significance < SURE or tilt.cost_m < WARNING_M:
        return []
    angle = np.degrees(np.arctan([tilt.slope_x, tilt.slope_y]))
    what = (
        f"the hand moves in a plane {tilt.height_m * 1e3:+.0f} mm before the one meant, leaning by "
        f"{angle[0]:+.1f} degrees along x and {angle[1]:+.1f} along y"
    )
    if tilt.cost_m > ERROR_M:
        raise StrandcastError(
            "SC-C041",
            what,
            file=file,
            field="camera.string_offset_m",
            cost=f"up to {tilt.cost_m * 1e3:.0f} mm at the string",
            fix="lay the plane's markers parallel to the arm's motion, and measure string_offset_m; "
            "is the size of the hand's markers right?",
        )
    return [f"{what}: up to {tilt.cost_m * 1e3:.1f} mm at the string"]
