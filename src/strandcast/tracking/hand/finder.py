"""The hand's pose in the plane of motion, from the ArUco markers it carries."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from strandcast.camera.mapping import metre_to_pixel
from strandcast.camera.marker_pose import marker_pose
from strandcast.camera.marker_sides import bilinear, refine_square
from strandcast.camera.markers import detect_markers, eight_bit, marker_detector
from strandcast.core.hand_marker import HandMarker
from strandcast.core.pose import Pose
from strandcast.records.camera import Camera
from strandcast.tracking.hand.rigid import corners_in_hand, fit_rigid, place
from strandcast.tracking.pixel_map import all_from_pixel, tabulate

MARGIN_PX = 28  # chosen: around the place where a marker is expected
SMALL_PX = 500  # chosen: smaller parts of the image are enlarged before markers are read
FOLLOW_RMS_PX = 0.4  # chosen: tracked corners must fit a rigid hand better than this
CONTRADICTION_SHARE = 0.1  # chosen: share of frames with contradicting markers from which the user is warned
WORST_RMS_PX = 1.0  # chosen: corners that fit a rigid hand worse than this are rejected
CELLS = 6  # along the side of a 4x4 marker, border included
BORDER_PLACES = 8  # chosen: along each side, where the border is sampled
LEAST_BORDER = 25.0  # chosen: grey levels between a marker's black border and the white around it
CORNER_SIGMA_PX = 0.1  # chosen: least error of a corner; several share the errors of the camera's map


@dataclass(frozen=True, eq=False)
class HandDetection:
    """The hand in one frame."""

    pose: Pose
    sigma_m: float
    rms_px: float  # of the corners from the rigid hand
    corners_px: dict[int, np.ndarray]  # (4, 2) by marker


class HandFinder:
    """Finds the hand's markers frame by frame.

    Once decoded, markers are tracked by their corners and borders alone, which is much faster than decoding
    them; they are decoded again whenever the corners do not fit a rigid hand.
    """

    def __init__(
        self, camera: Camera, markers: Sequence[HandMarker], dictionary: str, string_offset_m: float
    ) -> None:
        self.camera = camera
        self.string_offset_m = string_offset_m
        self.markers = {marker.id: marker for marker in sorted(markers, key=lambda m: m.id)}
        self.maps = {
            marker: tabulate(camera, string_offset_m + shape.offset_m)
            for marker, shape in self.markers.items()
        }
        self._corners_in_hand_m = {marker: corners_in_hand(shape) for marker, shape in self.markers.items()}
        self._middles_m = {
            marker: pixels.origin_m + 0.5 * pixels.step_m * np.array(pixels.uv.shape[1::-1])
            for marker, pixels in self.maps.items()
        }
        self.detector = marker_detector(dictionary)
        # Corners of all markers in the last two frames, detected or inferred.
        self._history: list[dict[int, np.ndarray]] = []
        self._visible: set[int] = set()
        self._read_ids: set[int] = set()
        self._frames = self._contradicting = 0
        self._last_contradicting: dict[int, np.ndarray] = {}

    def why_not(self) -> str:
        """Return why the hand is not found in any frame."""
        if self._read_ids:
            return (
                f"the hand's markers {sorted(self._read_ids)} are detected, but not of the sizes and at the "
                "places that the arm's file gives"
            )
        return f"none of the hand's markers {sorted(self.markers)} is detected in any frame"

    def contradictions(self) -> list[str]:
        """Return warnings about markers that are often at other distances than the arm's file gives."""
        if (
            self._contradicting < CONTRADICTION_SHARE * max(1, self._frames)
            or len(self._last_contradicting) < 2
        ):
            return []
        one, other = sorted(self._last_contradicting)[:2]
        middles = [self.in_plane(self._last_contradicting[m], m).mean(axis=0) for m in (one, other)]
        given = np.subtract(self.markers[one].place_m, self.markers[other].place_m)
        is_mm, given_mm = 1e3 * np.hypot(*(middles[0] - middles[1])), 1e3 * np.hypot(*given)
        return [
            f"markers {one} and {other} of the hand are detected {is_mm:.1f} mm apart, the arm's file says "
            f"{given_mm:.1f} mm (in {self._contradicting} of {self._frames} frames): one of them is used, "
            "perhaps the wrong one; correct their places or sizes in the arm's file"
        ]

    def find(self, image: np.ndarray) -> HandDetection | None:
        """Return the hand as the markers in this frame show it, or None."""
        self._frames += 1
        expected = self._expected()
        detection = self._follow(image, expected) if expected else None
        if detection is None:
            found = self._read(image, expected)
            self._read_ids |= set(found)
            detection = self._pose(found)
            if found and (detection is None or len(detection.corners_px) < len(found)):
                self._contradicting += 1
                self._last_contradicting = found
        self._note(detection)
        return detection

    def _expected(self) -> dict[int, np.ndarray]:
        if len(self._history) < 2:
            return self._history[-1] if self._history else {}
        before, last = self._history
        return {marker: 2 * last[marker] - before[marker] for marker in last}

    def _follow(self, image: np.ndarray, expected: dict[int, np.ndarray]) -> HandDetection | None:
        """Refine the corners near where they are expected; None if they do not fit a rigid hand well."""
        found = {}
        for marker, corners in expected.items():
            box = _box_around(corners, image)
            if box is None:
                continue
            left, top, right, bottom = box
            crop = np.ascontiguousarray(eight_bit(image[top:bottom, left:right]))
            refined = follow_square(crop, corners - np.array([left, top], dtype=np.float64))
            if np.isfinite(refined[0, 0]):
                found[marker] = refined + np.array([left, top])
        detection = self._pose(found)
        if detection is None or len(detection.corners_px) < len(self._visible):
            return None
        return detection if detection.rms_px < FOLLOW_RMS_PX else None

    def _read(self, image: np.ndarray, expected: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Decode the markers near where they are expected, or else anywhere."""
        if expected:
            box = _box_around(np.concatenate(list(expected.values())), image)
            found = self._read_within(image, box) if box is not None else {}
            if found:
                return found
        return self._read_within(image, (0, 0, image.shape[1], image.shape[0]))

    def _read_within(self, image: np.ndarray, box: tuple[int, int, int, int]) -> dict[int, np.ndarray]:
        left, top, right, bottom = box
        part = np.ascontiguousarray(eight_bit(image[top:bottom, left:right]))
        # Cells of less than five pixels often fail to decode as they are.
        enlarge = 2 if max(part.shape) < SMALL_PX else 1
        if enlarge > 1:
            part = cv2.resize(part, None, fx=enlarge, fy=enlarge, interpolation=cv2.INTER_CUBIC)
        ids, corners = detect_markers(part, self.detector)
        found: dict[int, np.ndarray] = {}
        for marker, four in zip(ids.tolist(), corners, strict=True):
            if marker in self.markers and marker not in found:
                rough = (four + 0.5) / enlarge - 0.5 + np.array([left, top], dtype=np.float64)
                refined = refine_square(image, rough, CELLS)
                found[marker] = refined if np.isfinite(refined).all() else rough
        return found

    def _pose(self, corners_px: dict[int, np.ndarray]) -> HandDetection | None:
        """Fit the rigid hand to all corners; if they do not fit, to all markers but one."""
        if not corners_px:
            return None
        ids = sorted(corners_px)
        model = np.concatenate([self._corners_in_hand_m[marker] for marker in ids])
        measured = np.concatenate([self.in_plane(corners_px[marker], marker) for marker in ids])
        pose, residual = fit_rigid(model, measured)
        scale = self.maps[ids[0]].metre_per_pixel
        rms_px = float(np.sqrt((residual**2).sum() / (2 * len(model) - 3))) / scale
        if not rms_px < WORST_RMS_PX:
            fewer = [{m: corners_px[m] for m in ids if m != left_out} for left_out in ids]
            fits = [fit for fit in map(self._pose, fewer) if fit is not None]
            return min(fits, key=lambda fit: fit.rms_px) if fits else None
        corner_m = max(rms_px, CORNER_SIGMA_PX) * scale
        centre = model.mean(axis=0)
        sigma_rad = corner_m / np.sqrt(((model - centre) ** 2).sum())
        sigma_m = np.hypot(corner_m / np.sqrt(len(model)), np.linalg.norm(centre) * sigma_rad)
        return HandDetection(pose, float(sigma_m), rms_px, corners_px)

    def in_plane(self, corners_px: np.ndarray, marker: int) -> np.ndarray:
        """Return where pixels (K, 2) lie in a marker's own plane (m)."""
        return np.asarray(all_from_pixel(corners_px, self._middles_m[marker], self.maps[marker]))

    def marker_poses(self, marker: int, corners_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return poses (K, 3) and sigmas (K,) of a marker from its corners (K, 4, 2) in K frames."""
        shape = self.markers[marker]
        offset_m = self.string_offset_m + shape.offset_m
        return marker_pose(self.camera, corners_px, shape.size_m, offset_m, CORNER_SIGMA_PX)

    def _note(self, detection: HandDetection | None) -> None:
        """Remember where every marker of the hand is, detected or inferred."""
        if detection is None:
            expected = self._expected()
            self._history = [*self._history[-1:], expected] if expected else []
            self._visible = set()
            return
        self._visible = set(detection.corners_px)
        now = dict(detection.corners_px)
        for marker, shape in self.markers.items():
            if marker not in now:
                offset_m = self.string_offset_m + shape.offset_m
                now[marker] = metre_to_pixel(
                    self.camera, place(detection.pose, self._corners_in_hand_m[marker]), offset_m
                )
        self._history = [*self._history[-1:], now]


def _box_around(points_px: np.ndarray, image: np.ndarray) -> tuple[int, int, int, int] | None:
    """Return left, top, right, bottom of the image's part around points (K, 2); None if it is too small."""
    low = np.floor(points_px.min(axis=0)).astype(int) - MARGIN_PX
    high = np.ceil(points_px.max(axis=0)).astype(int) + MARGIN_PX
    left, top = max(int(low[0]), 0), max(int(low[1]), 0)
    right, bottom = min(int(high[0]), image.shape[1]), min(int(high[1]), image.shape[0])
    return (
        (left, top, right, bottom) if right - left > 2 * MARGIN_PX and bottom - top > 2 * MARGIN_PX else None
    )


@njit(cache=True, nogil=True)
def follow_square(crop: np.ndarray, corners_px: np.ndarray) -> np.ndarray:
    """Return a marker's corners (4, 2) near the expected ones; NaN if it is not there."""
    refined: np.ndarray = refine_square(crop, corners_px, CELLS)
    if np.isfinite(refined).all() and has_border(crop, refined):
        return refined
    return np.full((4, 2), np.nan)


@njit(cache=True)
def has_border(crop: np.ndarray, corners_px: np.ndarray) -> bool:
    """Return whether a marker's black border and the white around it show along most of its sides."""
    centre_u, centre_v = corners_px[:, 0].mean(), corners_px[:, 1].mean()
    shown = 0
    for side in range(4):
        start, end = corners_px[side], corners_px[(side + 1) % 4]
        for k in range(BORDER_PLACES):
            share = (k + 0.5) / BORDER_PLACES
            u, v = start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])
            in_u, in_v = (centre_u - u) / (0.5 * CELLS), (centre_v - v) / (0.5 * CELLS)  # a cell, mid-side
            black = bilinear(crop, u + 0.5 * in_u, v + 0.5 * in_v)
            shown += bilinear(crop, u - 0.4 * in_u, v - 0.4 * in_v) - black > LEAST_BORDER
    return shown > 0.8 * 4 * BORDER_PLACES
