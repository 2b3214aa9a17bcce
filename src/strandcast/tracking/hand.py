"""The hand's pose in the motion plane from the ArUco markers it carries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.camera.mapping import metre_to_pixel, pixel_to_metre
from strandcast.camera.marker_pose import marker_pose
from strandcast.camera.markers import corners_of, detect_markers, eight_bit, marker_detector
from strandcast.records.camera import Camera

MARGIN_PX = 28  # around the place where a marker is expected
WORST_RMS_PX = 1.0  # corners that fit a rigid hand worse than this are not believed
CORNER_SIGMA_PX = 0.1  # least error of a corner; several share the errors of the camera's map


@dataclass(frozen=True)
class HandMarker:
    """One marker on the hand: id, side of its black square, place and turn in the hand's frame.

    The hand's frame has its origin where the string leaves the clamp, and x along the string as clamped.
    `offset_m` is the marker's height over the string's plane, towards the camera.
    """

    marker: int
    size_m: float
    place_m: tuple[float, float]
    angle_rad: float = 0.0
    offset_m: float = 0.0

    def corners_m(self) -> np.ndarray:
        """Return the corners (4, 2) in the hand's frame, in the order of detection."""
        cosine, sine = np.cos(self.angle_rad), np.sin(self.angle_rad)
        turned = corners_of(self.size_m) @ np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray(turned + np.asarray(self.place_m))


@dataclass(frozen=True)
class HandSighting:
    """The hand in one frame: pose (x_m, y_m, angle_rad), its sigmas, and the corners (4, 2) px by marker."""

    pose: np.ndarray
    sigma_m: float
    sigma_rad: float
    corners_px: dict[int, np.ndarray]


class HandFinder:
    """Finds the hand's markers frame after frame, near where they were last."""

    def __init__(
        self, camera: Camera, markers: list[HandMarker], dictionary: str, string_offset_m: float
    ) -> None:
        self.camera = camera
        self.markers = {marker.marker: marker for marker in markers}
        self.string_offset_m = string_offset_m
        self.detector = marker_detector(dictionary)
        self.expected_px: dict[int, np.ndarray] = {}
        self.motion_px: dict[int, np.ndarray] = {}

    def find(self, image: np.ndarray) -> HandSighting | None:
        """Return the hand as the markers in this frame show it, or None."""
        corners = self._near_last(image) if self.expected_px else {}
        if not corners:
            corners = self._within(image, (0, 0, image.shape[1], image.shape[0]))
        sighting = self._pose(corners)
        self._expect(sighting)
        return sighting

    def _near_last(self, image: np.ndarray) -> dict[int, np.ndarray]:
        """Look where the markers should be now; a marker too blurred to read is followed by its corners."""
        expected = {marker: px + self.motion_px[marker] for marker, px in self.expected_px.items()}
        everywhere = np.concatenate(list(expected.values()))
        low = np.maximum(np.floor(everywhere.min(axis=0)).astype(int) - MARGIN_PX, 0)
        high = np.ceil(everywhere.max(axis=0)).astype(int) + MARGIN_PX
        return self._within(image, (low[0], low[1], high[0], high[1]))

    def _within(self, image: np.ndarray, box: tuple[int, int, int, int]) -> dict[int, np.ndarray]:
        left, top, right, bottom = box
        crop = np.ascontiguousarray(eight_bit(image[top:bottom, left:right]))
        if min(crop.shape) < 16:
            return {}
        ids, corners = detect_markers(crop, self.detector)
        shift = np.array([left, top], dtype=np.float64)
        found: dict[int, np.ndarray] = {}
        for marker, four in zip(ids.tolist(), corners, strict=True):
            if marker in self.markers and marker not in found:
                found[marker] = four + shift
        return found

    def _pose(self, corners_px: dict[int, np.ndarray]) -> HandSighting | None:
        """Fit the rigid hand to all corners; a marker that does not fit the others is left out."""
        if not corners_px:
            return None
        ids = sorted(corners_px)
        model = np.concatenate([self.markers[marker].corners_m() for marker in ids])
        seen = np.concatenate([self.to_plane(corners_px[marker], marker) for marker in ids])
        pose, residual = fit_rigid(model, seen)
        rms_m = float(np.sqrt((residual**2).sum() / max(1, 2 * len(model) - 3)))
        scale = float(self.scale_m_per_px(corners_px[ids[0]], ids[0]))
        if rms_m > WORST_RMS_PX * scale:
            kept = {marker: corners_px[marker] for marker in ids[:-1]}
            return self._pose(kept)
        corner_m = max(rms_m, CORNER_SIGMA_PX * scale)
        about = model - model.mean(axis=0)
        sigma_rad = corner_m / np.sqrt((about**2).sum())
        lever_m = float(np.linalg.norm(model.mean(axis=0)))
        sigma_m = float(np.hypot(corner_m / np.sqrt(len(model)), lever_m * sigma_rad))
        return HandSighting(pose, sigma_m, float(sigma_rad), corners_px)

    def to_plane(self, corners_px: np.ndarray, marker: int) -> np.ndarray:
        """Return where corners (4, 2) px of a marker lie in its own plane (m)."""
        return pixel_to_metre(self.camera, corners_px, self.string_offset_m + self.markers[marker].offset_m)

    def marker_in_plane(self, corners_px: np.ndarray, marker: int) -> tuple[float, float, float, float]:
        """Return x_m, y_m, angle_rad and sigma_m of a marker in its plane."""
        shape = self.markers[marker]
        offset_m = self.string_offset_m + shape.offset_m
        pose, sigma_m = marker_pose(self.camera, corners_px, shape.size_m, offset_m, CORNER_SIGMA_PX)
        return float(pose[0]), float(pose[1]), float(pose[2]), float(sigma_m)

    def scale_m_per_px(self, corners_px: np.ndarray, marker: int) -> float:
        """Return metres per pixel at a marker."""
        side_px = np.linalg.norm(np.diff(corners_px[[0, 1, 2, 3, 0]], axis=0), axis=1).mean()
        return float(self.markers[marker].size_m / side_px)

    def _expect(self, sighting: HandSighting | None) -> None:
        """Note where every marker of the hand is, seen or inferred, and how it moved."""
        if sighting is None:
            self.expected_px = {
                marker: px + self.motion_px[marker] for marker, px in self.expected_px.items()
            }
            return
        now = {}
        for marker, shape in self.markers.items():
            if marker in sighting.corners_px:
                now[marker] = sighting.corners_px[marker]
            else:
                offset_m = self.string_offset_m + shape.offset_m
                now[marker] = metre_to_pixel(self.camera, place(sighting.pose, shape.corners_m()), offset_m)
        self.motion_px = {marker: px - self.expected_px.get(marker, px) for marker, px in now.items()}
        self.expected_px = now


def place(pose: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return points (K, 2) of the hand's frame in the world."""
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(points_m @ np.array([[cosine, sine], [-sine, cosine]]) + pose[:2])


def fit_rigid(model_m: np.ndarray, seen_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose (x, y, angle) that carries `model_m` (K, 2) onto `seen_m`, and the residuals (K, 2)."""
    model_mean, seen_mean = model_m.mean(axis=0), seen_m.mean(axis=0)
    a, b = model_m - model_mean, seen_m - seen_mean
    angle = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    pose = np.array([0.0, 0.0, angle])
    pose[:2] = seen_mean - place(pose, model_mean[None])[0]
    return pose, seen_m - place(pose, model_m)
