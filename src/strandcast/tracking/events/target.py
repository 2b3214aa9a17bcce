"""The target in the image: its detected place, and the distance from its declared place.

It must be distinct: a marker, or one closed, roundish outline near the declared place. None of several equal
candidates is taken.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from skimage.measure import CircleModel

from strandcast.camera.mapping import metre_per_pixel, metre_to_pixel, pixel_to_metre
from strandcast.camera.markers import detect_markers, eight_bit, marker_detector
from strandcast.records.camera import Camera
from strandcast.records.track import DetectedTarget

SEARCH_M, SEARCH_PX = 0.03, 12.0  # largest distance of its middle from the declared place
LARGEST_M, SMALLEST_M = 0.04, 0.002  # radius
SMALLEST_PX, LARGEST_PX = 2.5, 60.0
RAYS = 48
TURNS = 2 * np.pi * np.arange(RAYS) / RAYS
RAY_DIRECTIONS = np.stack([np.cos(TURNS), np.sin(TURNS)], axis=1)
CLOSED = 0.9  # of the rays must meet the outline: crossing lines look closed to three quarters of them
ROUND = 0.12  # largest rms deviation from a circle, relative to the radius; a square's is 0.1
ROUND_PX = 0.5
OUTLIER_PX = 0.8  # a ray's edge farther off the circle belongs to something else
VOTES = 0.35  # least share of a circle's circumference that points at its middle
CANDIDATES = 12
RIVAL = 0.5  # of the clearest outline's contrast; another one as clear makes the target doubtful
OUTER = 0.15  # and from which an outline around it is the target's
LEAST_EDGE = 4.0  # grey levels per pixel
EDGE_TIMES = 4.0  # least gradient of an outline, in the patch's usual gradients
FLOOR_PX = 0.15  # least standard deviation of a place, for the camera's map
WARN_M = 0.005
DICTIONARIES = ("DICT_4X4_50", "DICT_5X5_100", "DICT_6X6_250", "DICT_APRILTAG_36h11", "DICT_ARUCO_ORIGINAL")


@dataclass(frozen=True)
class Outline:
    """A closed outline: middle (2,), radius, residual of the circle [px], share of rays that met it."""

    middle_px: np.ndarray
    radius_px: float
    rms_px: float
    closed: float
    contrast: float


def locate_target(background: np.ndarray, camera: Camera, target_m: np.ndarray) -> DetectedTarget | None:
    """Locate the target in the empty scene (H, W) near its declared place (2,) [m]; None if not distinct.

    The target is assumed to lie in the string's plane.
    """
    target_m = np.asarray(target_m, float)
    middle_px = metre_to_pixel(camera, target_m, camera.string_offset_m)
    scale = float(metre_per_pixel(camera, target_m, camera.string_offset_m))
    search_px = max(SEARCH_M / scale, SEARCH_PX)
    largest_px = float(np.clip(LARGEST_M / scale, 2 * SMALLEST_PX, LARGEST_PX))
    patch, corner = cut(background, middle_px, search_px + 1.5 * largest_px)
    if min(patch.shape) < 2 * SEARCH_PX:
        return None
    at = middle_px - corner
    smallest_px = max(SMALLEST_M / scale, SMALLEST_PX)
    marker = find_marker(patch, at, search_px)
    found = marker or find_outline(patch, at, search_px, smallest_px, largest_px)
    if found is None or _carries_scale(found.middle_px + corner, camera):
        return None
    place_m = pixel_to_metre(camera, found.middle_px + corner, camera.string_offset_m)
    sigma_px = np.hypot(found.rms_px / np.sqrt(0.5 * RAYS * found.closed), FLOOR_PX)
    return DetectedTarget(
        place_m=place_m.tolist(),
        sigma_m=float(sigma_px * scale),
        offset_m=(place_m - target_m).tolist(),
        radius_m=found.radius_px * scale,
        kind="round" if marker is None else "marker",
    )


def target_warnings(target: DetectedTarget | None) -> list[str]:
    """Return a warning about a target that is detected elsewhere than declared."""
    if target is None or np.hypot(target.offset_m[0], target.offset_m[1]) <= max(WARN_M, 3 * target.sigma_m):
        return []
    x, y = 1e3 * target.offset_m[0], 1e3 * target.offset_m[1]
    return [
        f"target_m: the target is detected {np.hypot(x, y):.1f} mm from there ({x:+.1f} mm in x, "
        f"{y:+.1f} mm in y): the miss is measured from target_m"
    ]


def cut(picture: np.ndarray, middle_px: np.ndarray, reach_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the part of a picture around a pixel, and the pixel (2,) of its corner; empty if outside."""
    if not np.isfinite(middle_px).all():
        return picture[:0, :0], np.zeros(2)
    left, top = np.maximum(np.floor(middle_px - reach_px).astype(int), 0)
    right, bottom = np.maximum(np.ceil(middle_px + reach_px).astype(int) + 1, 0)
    return picture[top:bottom, left:right], np.array([left, top], float)


def _carries_scale(middle_px: np.ndarray, camera: Camera) -> bool:
    """Return whether a place is on one of the plane's markers, which are not the target."""
    for marker in camera.plane_markers:
        corners = np.array([corner[:2] for corner in marker.residuals_px])
        middle = corners.mean(axis=0)
        if np.hypot(*(middle_px - middle)) < np.hypot(*(corners - middle).T).max():
            return True
    return False


def find_marker(patch: np.ndarray, at_px: np.ndarray, search_px: float) -> Outline | None:
    """Return the one ArUco or AprilTag marker with its middle near a pixel; None for none or many."""
    grey = np.ascontiguousarray(eight_bit(patch))
    enlarged = cv2.resize(grey, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    found = []
    for dictionary in DICTIONARIES:
        _, corners = detect_markers(enlarged, marker_detector(dictionary))
        for four in (corners + 0.5) / 2 - 0.5:
            middle = _crossing(four)
            if np.hypot(*(middle - at_px)) < search_px:
                side = np.linalg.norm(four - np.roll(four, 1, axis=0), axis=1).mean()
                found.append(Outline(middle, 0.5 * float(side), 0.2, 1.0, 0.0))
        if found:
            break
    return found[0] if len(found) == 1 else None


def _crossing(four: np.ndarray) -> np.ndarray:
    """Return where the diagonals of four corners (4, 2) cross: the middle, in perspective too."""
    along, other = four[2] - four[0], four[3] - four[1]
    share = np.linalg.solve(np.column_stack([along, -other]), four[1] - four[0])[0]
    return np.asarray(four[0] + share * along)


def find_outline(
    patch: np.ndarray, at_px: np.ndarray, search_px: float, smallest_px: float, largest_px: float
) -> Outline | None:
    """Return the one closed, roundish outline whose middle lies near a pixel; None if there are none or many.

    Edges vote for the middles of the circles that they could be part of (fast radial symmetry, Loy and
    Zelinsky 2003); around the best middles, the outline is then measured along rays.
    """
    smooth = cv2.GaussianBlur(patch.astype(np.float32), (0, 0), 1.0)
    gx, gy = (cv2.Scharr(smooth, cv2.CV_32F, *axis) / 32 for axis in ((1, 0), (0, 1)))
    strength = np.hypot(gx, gy)
    least = max(LEAST_EDGE, EDGE_TIMES * float(np.median(strength)))
    v, u = np.nonzero(strength > least)
    if not len(u):
        return None
    inward = np.column_stack([gx[v, u], gy[v, u]]) / strength[v, u, None]
    rows, columns = np.mgrid[: patch.shape[0], : patch.shape[1]]
    near = np.hypot(columns - at_px[0], rows - at_px[1]) <= search_px
    candidates: list[tuple[float, float, float, float]] = []
    for radius in np.geomspace(smallest_px, largest_px, 24):
        for sign in (-1.0, 1.0):
            candidates += _voted(near, np.column_stack([u, v]) + sign * radius * inward, radius)
    best = sorted(candidates, reverse=True)[: 4 * CANDIDATES]
    outlines = [ray_outline(smooth, np.array([x, y]), radius, least) for _, x, y, radius in best]
    found = _only_one([o for o in outlines if o is not None and np.hypot(*(o.middle_px - at_px)) < search_px])
    return None if found is None else replace(found, radius_px=outer_radius(smooth, found, largest_px, least))


def _voted(near: np.ndarray, votes_px: np.ndarray, radius: float) -> list[tuple[float, float, float, float]]:
    """Return the pixel in the mask `near` with most votes (K, 2): share of the circle, u, v, radius."""
    shape, (x, y) = near.shape, np.rint(votes_px).astype(int).T
    inside = (x >= 0) & (x < shape[1]) & (y >= 0) & (y < shape[0])
    votes = np.bincount(y[inside] * shape[1] + x[inside], minlength=shape[0] * shape[1])
    spread = cv2.GaussianBlur(votes.reshape(shape).astype(np.float32), (0, 0), 1.0 + 0.08 * radius)
    # All votes of a perfect circle fall on its middle, blurred by that much; edges are two pixels thick.
    spread *= 2 * np.pi * (1.0 + 0.08 * radius) ** 2 / (2 * 2 * np.pi * radius)
    spread[~near] = 0.0
    best = int(np.argmax(spread))
    share = float(spread.flat[best])
    return [(share, float(best % shape[1]), float(best // shape[1]), radius)] if share > VOTES else []


def ray_outline(smooth: np.ndarray, middle_px: np.ndarray, radius_px: float, least: float) -> Outline | None:
    """Return the outline about a middle, the steepest place along each ray; None where it is not closed."""
    middle, radius = middle_px.copy(), radius_px
    for _ in range(4):
        reach = np.arange(max(0.5, 0.55 * radius), 1.45 * radius + 1.5, 0.25)
        slope = np.gradient(along_rays(smooth, middle, reach), 0.25, axis=0)
        sign = np.sign(np.median(slope[np.abs(slope).argmax(axis=0), np.arange(RAYS)])) or 1.0
        steep = (sign * slope).argmax(axis=0)
        met = (sign * slope)[steep, np.arange(RAYS)] > least
        if met.mean() < CLOSED:
            return None
        edge = middle + reach[steep, None] * RAY_DIRECTIONS
        off = np.abs(CircleModel.from_estimate(edge[met]).residuals(edge))
        kept = met & (off < max(OUTLIER_PX, 2.5 * 1.48 * float(np.median(off[met]))))
        if kept.mean() < CLOSED:
            return None
        circle = CircleModel.from_estimate(edge[kept])
        middle, radius = circle.center, float(circle.radius)
        if not 0.5 * radius_px < radius < 2.0 * radius_px:
            return None
    rms = float(np.sqrt((circle.residuals(edge[kept]) ** 2).mean()))
    if rms > max(ROUND * radius, ROUND_PX):
        return None
    contrast = float(np.median((sign * slope).max(axis=0)[kept]))
    return Outline(middle, radius, rms, float(kept.mean()), contrast)


def _only_one(outlines: list[Outline]) -> Outline | None:
    """Return the clearest of outlines; None where there are others, as clear, about another middle."""
    if not outlines:
        return None
    clearest = max(outlines, key=lambda o: o.contrast * o.closed)
    for other in outlines:
        apart = np.hypot(*(other.middle_px - clearest.middle_px))
        inside = apart < 0.6 * max(other.radius_px, clearest.radius_px)
        if not inside and other.contrast > RIVAL * clearest.contrast:
            return None
    return clearest


def outer_radius(smooth: np.ndarray, inner: Outline, largest_px: float, least: float) -> float:
    """Return the radius [px] of the outermost closed outline about one's middle: a disc may have a rim."""
    reach = np.arange(0.8 * inner.radius_px, min(3.0 * inner.radius_px, largest_px), 0.25)
    slope = np.gradient(along_rays(smooth, inner.middle_px, reach), 0.25, axis=0)
    mean = slope.mean(axis=1)
    radius = inner.radius_px
    for k in range(1, len(reach) - 1):
        peak = abs(mean[k]) >= max(abs(mean[k - 1]), abs(mean[k + 1]))
        clear = abs(mean[k]) > OUTER * inner.contrast
        if peak and clear and (np.sign(mean[k]) * slope[k] > 0.5 * least).mean() > CLOSED:
            radius = float(reach[k])
    return radius


def along_rays(smooth: np.ndarray, middle_px: np.ndarray, reach_px: np.ndarray) -> np.ndarray:
    """Return grey levels (K, RAYS) at distances (K,) from a middle."""
    places = (middle_px + reach_px[:, None, None] * RAY_DIRECTIONS).astype(np.float32)
    border = cv2.BORDER_REPLICATE
    return np.asarray(cv2.remap(smooth, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=border))
