"""The camera's pose relative to a plane of markers by perspective-n-point, and the markers' size."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
import scipy

from strandcast.camera.fisheye import solve_pose
from strandcast.camera.markers import corners_of
from strandcast.camera.projection import project_points, straightened
from strandcast.core.pose import rotated
from strandcast.records.camera import Camera, Lens, is_fisheye

CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-12)


@dataclass(frozen=True)
class PlacedMarker:
    """A marker in the motion plane: centre in the world [m], side of the black square [m], rotation."""

    marker: int
    x_m: float
    y_m: float
    size_m: float
    angle_rad: float = 0.0

    def corners_m(self) -> np.ndarray:
        """Return the corners (4, 3) [m] in the world, in detection order."""
        turned = rotated(corners_of(self.size_m), np.asarray(self.angle_rad))
        return np.column_stack([turned + np.array([self.x_m, self.y_m]), np.zeros(4)])


@dataclass(frozen=True)
class PoseFit:
    """A fitted pose: the markers' corners in the world (K, 4, 3), R, t, and residuals [px]."""

    world_m: np.ndarray
    rotation: np.ndarray
    shift_m: np.ndarray
    residuals_px: np.ndarray  # (K, 4, 2), measured minus model
    rms_px: float

    def corner_sigma_px(self) -> float:
        """Return the standard deviation of a corner in u or v, from the scatter within each marker.

        A misplaced marker displaces its four corners alike, which has no effect here.
        """
        about = self.residuals_px - self.residuals_px.mean(axis=1, keepdims=True)
        return float(np.sqrt((about**2).sum() / (6.0 * len(about))))


def fit_pose(world_m: np.ndarray, corners_px: np.ndarray, lens: Lens) -> PoseFit:
    """Fit the pose to markers' corners: the better of IPPE's two, then Levenberg–Marquardt."""
    seen = (
        *(world_m.reshape(-1, 3), corners_px.reshape(-1, 2)),
        *(np.array(lens.matrix), np.array(lens.distortion)),
    )
    if is_fisheye(lens.distortion):
        turn, shift = solve_pose(*seen)
    else:
        count, turns, shifts, errors = cv2.solvePnPGeneric(*seen, flags=cv2.SOLVEPNP_IPPE)
        best = min(range(count), key=lambda k: float(np.asarray(errors).reshape(-1)[k]))
        turn, shift = cv2.solvePnPRefineLM(*seen, turns[best], shifts[best], CRITERIA)
    rotation, shift = np.asarray(cv2.Rodrigues(turn)[0]), np.asarray(shift).reshape(3)
    residuals = corners_px - project(world_m, rotation, shift, lens)
    return PoseFit(world_m, rotation, shift, residuals, rms(residuals))


def project(world_m: np.ndarray, rotation: np.ndarray, shift_m: np.ndarray, lens: Lens) -> np.ndarray:
    """Return the pixels (..., 2) of points (..., 3) of the world."""
    turn = cv2.Rodrigues(rotation)[0]
    pixels, _ = project_points(world_m, turn, shift_m, np.array(lens.matrix), np.array(lens.distortion))
    return pixels.reshape(*world_m.shape[:-1], 2)


def rms(residuals_px: np.ndarray) -> float:
    """Return the root mean square length of residuals (..., 2)."""
    return float(np.sqrt((residuals_px**2).sum(axis=-1).mean()))


def posed(camera: Camera, fit: PoseFit) -> Camera:
    """Return the camera in the pose of a fit."""
    return camera.model_copy(
        update={"rotation": fit.rotation.tolist(), "translation_m": fit.shift_m.tolist()}
    )


@dataclass(frozen=True)
class SizeFit:
    """Measured over declared size of the markers, its standard error, and the rms of the fit."""

    ratio: float
    error: float
    rms_px: float


def fit_size(markers: Sequence[PlacedMarker], corners_px: np.ndarray, lens: Lens) -> SizeFit:
    """Measure the markers' size relative to the distances of their centres, jointly with the pose."""
    world_m = np.array([marker.corners_m() for marker in markers])
    centres = world_m.mean(axis=1, keepdims=True)
    start = _rough_ratio(markers, corners_px, lens)
    pose = fit_pose(centres + start * (world_m - centres), corners_px, lens)

    def off(numbers: np.ndarray) -> np.ndarray:
        sized = centres + start * np.exp(numbers[6]) * (world_m - centres)
        rotation, _ = cv2.Rodrigues(numbers[:3])
        return np.asarray(corners_px - project(sized, rotation, numbers[3:6], lens)).ravel()

    begin = np.concatenate([cv2.Rodrigues(pose.rotation)[0].ravel(), pose.shift_m, [0.0]])
    fit = scipy.optimize.least_squares(off, begin, x_scale="jac", xtol=1e-12)
    slopes = np.asarray(fit.jac)
    variance = (fit.fun**2).sum() / max(len(fit.fun) - 7, 1)
    error = np.sqrt((np.linalg.pinv(slopes.T @ slopes) * variance)[6, 6])
    ratio = float(start * np.exp(fit.x[6]))
    return SizeFit(ratio, float(ratio * error), rms(fit.fun.reshape(-1, 2)))


def _rough_ratio(markers: Sequence[PlacedMarker], corners_px: np.ndarray, lens: Lens) -> float:
    """Return the size ratio to within 2 %, whatever it is, from the pose of each single marker."""
    unit = np.column_stack([corners_of(1.0), np.zeros(4)])
    matrix, distortion = np.array(lens.matrix), np.array(lens.distortion)
    places_m = []
    for four in corners_px:
        seen = straightened(four, matrix, distortion)
        _, _, shift = cv2.solvePnP(unit, *seen, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        places_m.append(np.asarray(shift).reshape(3))
    ratios = [
        np.hypot(markers[i].x_m - markers[j].x_m, markers[i].y_m - markers[j].y_m)
        / np.linalg.norm(places_m[i] - places_m[j])
        / np.sqrt(markers[i].size_m * markers[j].size_m)
        for i, j in combinations(range(len(markers)), 2)
    ]
    return float(np.median(ratios))
