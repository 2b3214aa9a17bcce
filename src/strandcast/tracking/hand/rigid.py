"""The hand as a rigid body: its markers' corners, its pose, and the box it covers."""

from collections.abc import Sequence

import numpy as np

from strandcast.camera.markers import corners_of
from strandcast.core.hand_marker import HandMarker
from strandcast.core.pose import Pose

RIM_SHARE = 0.25  # chosen: white rim around a marker's black square, relative to its side


def corners_in_hand(marker: HandMarker) -> np.ndarray:
    """Return a marker's corners (4, 2) in the hand's frame, in the order of detection."""
    return np.asarray(turned(corners_of(marker.size_m), marker.angle_rad) + np.asarray(marker.place_m))


def place(pose: Pose, points_m: np.ndarray) -> np.ndarray:
    """Return points (K, 2) of the hand's frame in the world; `Pose.place` rounds differently."""
    return np.asarray(turned(points_m, float(pose.angle_rad)) + pose.position_m)


def turned(points_m: np.ndarray, angle_rad: float) -> np.ndarray:
    """Return points (K, 2) turned counter-clockwise."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.asarray(points_m @ np.array([[cosine, sine], [-sine, cosine]]))


def fit_rigid(model_m: np.ndarray, found_m: np.ndarray) -> tuple[Pose, np.ndarray]:
    """Return the pose that maps `model_m` (K, 2) onto `found_m`, and the residuals (K, 2)."""
    model_mean, found_mean = model_m.mean(axis=0), found_m.mean(axis=0)
    a, b = model_m - model_mean, found_m - found_mean
    angle_rad = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    pose = Pose(found_mean - turned(model_mean[None], angle_rad)[0], angle_rad)
    return pose, found_m - place(pose, model_m)


def box_around(markers: Sequence[HandMarker]) -> np.ndarray:
    """Return low x, low y, high x, high y, in the hand's frame, of the markers and their rims."""
    corners = np.concatenate([corners_in_hand(marker) for marker in markers])
    rim_m = RIM_SHARE * max(marker.size_m for marker in markers)
    low, high = corners.min(axis=0) - rim_m, corners.max(axis=0) + rim_m
    return np.array([low[0], low[1], min(high[0], 0.0) if corners[:, 0].max() < 0 else high[0], high[1]])
