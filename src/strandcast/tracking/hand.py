"""The hand's pose in the motion plane from the ArUco markers it carries."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from strandcast.camera.mapping import metre_to_pixel
from strandcast.camera.marker_pose import marker_pose
from strandcast.camera.markers import corners_of, detect_markers, eight_bit, marker_detector
from strandcast.camera.sampling import bilinear
from strandcast.camera.square import refine_square
from strandcast.records.camera import Camera
from strandcast.tracking.pixelmap import all_from_pixel, tabulate

MARGIN_PX = 28  # around the place where a marker is expected
SMALL_PX = 500  # parts of the picture smaller than this are enlarged before markers are read
CELLS = 6  # of a 4x4 marker's side, border included
FOLLOW_RMS_PX = 0.4  # corners that were followed must fit better than this
BORDER_PLACES = 8  # along each side, at which the border is looked at
LEAST_BORDER = 25.0  # grey levels between a marker's black border and the white around it
AT_ODDS_SHARE = 0.1  # of the frames, in which markers contradict each other, from which that is told
WORST_RMS_PX = 1.0  # corners that fit a rigid hand worse than this are not believed
RIM_SHARE = 0.25  # white rim around a marker's black square, of its side
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
    """The hand in one frame: pose (x_m, y_m, angle_rad), sigmas, residual, corners (4, 2) px by marker."""

    pose: np.ndarray
    sigma_m: float
    sigma_rad: float
    rms_px: float
    corners_px: dict[int, np.ndarray]


class HandFinder:
    """Finds the hand's markers frame after frame.

    Once read, they are followed by their corners and borders alone, which is much quicker than reading them;
    they are read again whenever the corners do not fit a rigid hand.
    """

    def __init__(
        self, camera: Camera, markers: list[HandMarker], dictionary: str, string_offset_m: float
    ) -> None:
        self.camera = camera
        self.string_offset_m = string_offset_m
        self.markers = {marker.marker: marker for marker in sorted(markers, key=lambda m: m.marker)}
        self.maps = {
            marker: tabulate(camera, string_offset_m + shape.offset_m)
            for marker, shape in self.markers.items()
        }
        self.detector = marker_detector(dictionary)
        self._history: list[
            dict[int, np.ndarray]
        ] = []  # corners in the last two frames, all seen or inferred
        self._seen: set[int] = set()
        self._read_ids: set[int] = set()
        self._frames = self._at_odds = 0
        self._last_odds: dict[int, np.ndarray] = {}

    def why_not(self) -> str:
        """Say why the hand is not seen in any frame."""
        if self._read_ids:
            return (
                f"the hand's markers {sorted(self._read_ids)} are seen, but not of the sizes and at the "
                "places that the arm's file gives them"
            )
        return f"none of the hand's markers {sorted(self.markers)} is seen in any frame"

    def contradictions(self) -> list[str]:
        """Warn of markers that were often seen at other distances than the arm's file gives them."""
        if self._at_odds < AT_ODDS_SHARE * max(1, self._frames) or len(self._last_odds) < 2:
            return []
        one, other = sorted(self._last_odds)[:2]
        middles = [self.in_plane(self._last_odds[m], m).mean(axis=0) for m in (one, other)]
        given = np.subtract(self.markers[one].place_m, self.markers[other].place_m)
        seen_mm, given_mm = 1e3 * np.hypot(*(middles[0] - middles[1])), 1e3 * np.hypot(*given)
        return [
            f"markers {one} and {other} of the hand are seen {seen_mm:.1f} mm apart, the arm's file says "
            f"{given_mm:.1f} mm (in {self._at_odds} of {self._frames} frames): one of them is taken for the "
            "hand, perhaps the wrong one; correct their places or sizes in the arm's file"
        ]

    def find(self, image: np.ndarray) -> HandSighting | None:
        """Return the hand as the markers in this frame show it, or None."""
        self._frames += 1
        expected = self._expected()
        sighting = self._follow(image, expected) if expected else None
        if sighting is None:
            found = self._read(image, expected)
            self._read_ids |= set(found)
            sighting = self._pose(found)
            if found and (sighting is None or len(sighting.corners_px) < len(found)):
                self._at_odds += 1
                self._last_odds = found
        self._note(sighting)
        return sighting

    def _expected(self) -> dict[int, np.ndarray]:
        if len(self._history) < 2:
            return self._history[-1] if self._history else {}
        before, last = self._history
        return {marker: 2 * last[marker] - before[marker] for marker in last}

    def _follow(self, image: np.ndarray, expected: dict[int, np.ndarray]) -> HandSighting | None:
        """Refine the corners near where they should be; None where they do not fit a rigid hand well."""
        found = {}
        for marker, corners in expected.items():
            box = _box_around(corners, image)
            if box is None:
                continue
            left, top, right, bottom = box
            crop = eight_bit(image[top:bottom, left:right])
            refined = follow_square(crop, corners - np.array([left, top], dtype=np.float64))
            if np.isfinite(refined[0, 0]):
                found[marker] = refined + np.array([left, top])
        sighting = self._pose(found)
        if sighting is None or len(sighting.corners_px) < len(self._seen):
            return None
        return sighting if sighting.rms_px < FOLLOW_RMS_PX else None

    def _read(self, image: np.ndarray, expected: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Read the markers near where they should be, else anywhere."""
        if expected:
            box = _box_around(np.concatenate(list(expected.values())), image)
            found = self._read_within(image, box) if box is not None else {}
            if found:
                return found
        return self._read_within(image, (0, 0, image.shape[1], image.shape[0]))

    def _read_within(self, image: np.ndarray, box: tuple[int, int, int, int]) -> dict[int, np.ndarray]:
        left, top, right, bottom = box
        part = np.ascontiguousarray(eight_bit(image[top:bottom, left:right]))
        # Cells of less than five pixels are often not read as they are.
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

    def _pose(self, corners_px: dict[int, np.ndarray]) -> HandSighting | None:
        """Fit the rigid hand to all corners; where they do not fit, to the markers but one."""
        if not corners_px:
            return None
        ids = sorted(corners_px)
        model = np.concatenate([self.markers[marker].corners_m() for marker in ids])
        seen = np.concatenate([self.in_plane(corners_px[marker], marker) for marker in ids])
        pose, residual = fit_rigid(model, seen)
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
        return HandSighting(pose, float(sigma_m), float(sigma_rad), rms_px, corners_px)

    def in_plane(self, corners_px: np.ndarray, marker: int) -> np.ndarray:
        """Return where pixels (K, 2) lie in a marker's own plane (m)."""
        pixels = self.maps[marker]
        middle = pixels.origin_m + 0.5 * pixels.step_m * np.array(pixels.uv.shape[1::-1])
        return np.asarray(all_from_pixel(corners_px, middle, pixels))

    def marker_poses(self, marker: int, corners_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return poses (K, 3) and sigmas (K,) of a marker from its corners (K, 4, 2) in K frames."""
        shape = self.markers[marker]
        offset_m = self.string_offset_m + shape.offset_m
        return marker_pose(self.camera, corners_px, shape.size_m, offset_m, CORNER_SIGMA_PX)

    def _note(self, sighting: HandSighting | None) -> None:
        """Remember where every marker of the hand is, seen or inferred."""
        if sighting is None:
            expected = self._expected()
            self._history = [*self._history[-1:], expected] if expected else []
            self._seen = set()
            return
        self._seen = set(sighting.corners_px)
        now = dict(sighting.corners_px)
        for marker, shape in self.markers.items():
            if marker not in now:
                offset_m = self.string_offset_m + shape.offset_m
                now[marker] = metre_to_pixel(self.camera, place(sighting.pose, shape.corners_m()), offset_m)
        self._history = [*self._history[-1:], now]


@njit(cache=True, nogil=True)
def follow_square(crop: np.ndarray, corners_px: np.ndarray) -> np.ndarray:
    """Return a marker's corners (4, 2) from those that are expected; NaN where it is not seen there."""
    refined = refine_square(crop, corners_px, CELLS)
    if np.isfinite(refined).all() and has_border(crop, refined):
        return refined
    return np.full((4, 2), np.nan)


@njit(cache=True)
def has_border(crop: np.ndarray, corners_px: np.ndarray) -> bool:
    """Tell whether a marker's black border and the white around it are seen along most of its sides."""
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


def _box_around(points_px: np.ndarray, image: np.ndarray) -> tuple[int, int, int, int] | None:
    """Return left, top, right, bottom of the picture's part around points (K, 2); None if it is too small."""
    low = np.floor(points_px.min(axis=0)).astype(int) - MARGIN_PX
    high = np.ceil(points_px.max(axis=0)).astype(int) + MARGIN_PX
    left, top = max(int(low[0]), 0), max(int(low[1]), 0)
    right, bottom = min(int(high[0]), image.shape[1]), min(int(high[1]), image.shape[0])
    return (
        (left, top, right, bottom) if right - left > 2 * MARGIN_PX and bottom - top > 2 * MARGIN_PX else None
    )


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


def box_around(markers: list[HandMarker]) -> np.ndarray:
    """Return the box (low x, low y, high x, high y), in the hand's frame, that the markers and rims cover."""
    corners = np.concatenate([marker.corners_m() for marker in markers])
    rim_m = RIM_SHARE * max(marker.size_m for marker in markers)
    low, high = corners.min(axis=0) - rim_m, corners.max(axis=0) + rim_m
    return np.array([low[0], low[1], min(high[0], 0.0) if corners[:, 0].max() < 0 else high[0], high[1]])
