"""The lab's camera: its pose, its lens, and the projection from the plane of the throw to pixels."""

from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np

from strandcast.arm.load import PlanarArm
from strandcast.config.experiment import Experiment
from strandcast.seeds import rng

# Chosen.
FOCAL_SHARE = 1.55  # focal length over the picture's width
DISTORTION = (-0.10, 0.03, 4e-4, -3e-4, 0.0)
OBLIQUE_RAD = (0.055, -0.07, 0.008)  # about the picture's x, y and z axes: a tripod is never quite square
MARGIN_SHARE = 0.02
FACING = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True, eq=False)
class LabView:
    """A camera facing the plane of the throw; world z points towards the camera.

    Attributes
    ----------
    matrix
        (3, 3) pinhole [px].
    distortion
        k1, k2, p1, p2, k3.
    rotation, translation_m
        camera = rotation · world + translation.
    """

    width_px: int
    height_px: int
    matrix: np.ndarray
    distortion: np.ndarray
    rotation: np.ndarray
    translation_m: np.ndarray

    def pixels(self, xy_m: np.ndarray, height_m: float = 0.0) -> np.ndarray:
        """Return the pixels (..., 2) of positions (..., 2) in the plane, or `height_m` in front of it."""
        xy = np.asarray(xy_m, float)
        flat = np.column_stack([xy.reshape(-1, 2), np.full(xy.size // 2, height_m)])
        turn, _ = cv2.Rodrigues(self.rotation)
        uv, _ = cv2.projectPoints(flat, turn, self.translation_m, self.matrix, self.distortion)
        return np.asarray(uv, float).reshape(xy.shape)

    def scale_px_m(self, xy_m: np.ndarray, height_m: float = 0.0) -> float:
        """Return pixels per metre around a position (2,) in the plane."""
        step = 0.005
        corners = np.asarray(xy_m) + step * np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
        left, right, low, high = self.pixels(corners, height_m)
        sides = (right - left) / (2 * step), (high - low) / (2 * step)
        return float(np.sqrt(abs(sides[0][0] * sides[1][1] - sides[0][1] * sides[1][0])))

    def rays(self, uv: np.ndarray) -> np.ndarray:
        """Return the rays (..., 2) at depth 1 in the camera's frame, for pixels (..., 2)."""
        flat = np.asarray(uv, float).reshape(-1, 1, 2)
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 12, 1e-9)
        out = cv2.undistortPoints(flat, self.matrix, self.distortion, criteria=criteria)
        return np.asarray(out, float).reshape(np.shape(uv))


def make_view(experiment: Experiment, name: str, arm: PlanarArm) -> LabView:
    """Place the camera for an experiment: slightly oblique, with the whole workspace in the picture."""
    assert experiment.lab is not None
    camera = experiment.lab.camera
    random = rng(name, experiment.seed, 0, "lab-camera")
    width, height = camera.size_px
    focal = FOCAL_SHARE * width * (1.0 + 0.02 * random.uniform(-1, 1))
    centre = np.array([width, height]) / 2 + random.uniform(-8, 8, 2)
    matrix = np.array([[focal, 0.0, centre[0]], [0.0, focal * 1.001, centre[1]], [0.0, 0.0, 1.0]])
    tilt, _ = cv2.Rodrigues(np.array(OBLIQUE_RAD) * (1.0 + 0.3 * random.uniform(-1, 1, 3)))
    rotation = tilt @ FACING
    own = experiment.workspace_m
    box_m = arm.box_m if own is None else (own.x_m, own.y_m)
    corners = np.array(list(product(*box_m)))
    return _move_back(LabView(width, height, matrix, np.array(DISTORTION), rotation, np.zeros(3)), corners)


def _move_back(view: LabView, corners_m: np.ndarray) -> LabView:
    """Move the camera back along its axis until all the corners are in the picture."""
    middle = np.append(corners_m.mean(axis=0), 0.0)
    margin = MARGIN_SHARE * view.width_px
    limit = np.array([view.width_px, view.height_px]) - margin
    distance_m = 0.3
    while True:
        # Put the centre of the box, not the world's origin, on the axis; then centre it in the picture.
        ahead = np.array([0.0, 0.0, distance_m]) - view.rotation @ middle
        for _ in range(3):
            moved = replace(view, translation_m=ahead)
            uv = moved.pixels(corners_m)
            off = 0.5 * (uv.min(axis=0) + uv.max(axis=0)) - 0.5 * (limit + margin)
            ahead = ahead - np.append(off * distance_m / np.diag(view.matrix)[:2], 0.0)
        if (uv > margin).all() and (uv < limit).all():
            return moved
        distance_m *= 1.01
