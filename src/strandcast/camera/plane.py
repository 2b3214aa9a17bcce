"""The plane of motion from one photo of ArUco markers of known size and place."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from strandcast.camera.mapping import metre_per_pixel, pixel_to_metre
from strandcast.camera.markers import corners_of, detect_markers, eight_bit, marker_cells, marker_detector
from strandcast.camera.square import refine_square
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, Lens, MarkerFit

LEAST_MARKERS = 2
SIZE_TOLERANCE = 0.03
MISPLACED_PX = 2.0
OTHER_DICTIONARIES = (
    "DICT_4X4_1000",
    "DICT_5X5_1000",
    "DICT_6X6_1000",
    "DICT_7X7_1000",
    "DICT_ARUCO_ORIGINAL",
    "DICT_APRILTAG_36H11",
)


@dataclass(frozen=True)
class PlaneMarker:
    """A marker of the motion plane: its centre in the world [m], the side of its black square, its turn."""

    marker: int
    x_m: float
    y_m: float
    size_m: float
    angle_rad: float = 0.0


def plane_from_markers(
    grey: np.ndarray,
    lens: Lens,
    markers_world: Sequence[PlaneMarker],
    dictionary: str,
    string_offset_m: float = 0.0,
    file: str | None = None,
) -> Camera:
    """Find the camera's pose over the motion plane by perspective-n-point, through the lens.

    Parameters
    ----------
    grey
        Photo (height, width) of the plane, in the camera's filming position and mode.
    lens
        From `calibrate_lens`.
    markers_world
        The markers as placed: world metres, x right, y up, turn counter-clockwise.
    dictionary
        Their ArUco dictionary.
    string_offset_m
        Height of the string's plane over that of the markers, towards the camera.
    file
        The photo's name, for messages.

    Returns
    -------
    Camera
        With residuals [px] per marker and corner, measured minus model. `scale_m_per_px` is that of the
        string's plane at the middle of the markers.

    Raises
    ------
    StrandcastError
        Another size of picture than the lens', markers missing, twice there, of another dictionary, mirrored,
        of another size, or one in another place than said.
    """
    if grey.shape != (lens.height_px, lens.width_px):
        raise StrandcastError(
            "SC-C020",
            f"is {grey.shape[1]} x {grey.shape[0]} px, the lens was calibrated at {lens.width_px} x "
            f"{lens.height_px}",
            file=file,
            fix="take the photo in the mode that films the throw",
        )
    wanted = {marker.marker: marker for marker in markers_world}
    ids, corners_px = _find_wanted(grey, wanted, dictionary, file)
    world_m = np.array([_corners_m(wanted[marker]) for marker in ids])
    rotation, shift = _pose(world_m, corners_px, lens)
    residuals = corners_px - _project(world_m, rotation, shift, lens)
    camera = _camera(lens, ids, corners_px, rotation, shift, residuals, string_offset_m)
    missing = sorted(set(wanted) - set(ids))
    if missing:
        camera.warnings.append(f"markers {missing} of the plane were not seen")
    camera.scale_m_per_px = float(
        metre_per_pixel(camera, world_m[..., :2].mean(axis=(0, 1)), string_offset_m)
    )
    _check_sizes(camera, ids, corners_px, wanted, file)
    _check_places(ids, corners_px, world_m, residuals, camera, file)
    return camera


def _find_wanted(
    grey: np.ndarray, wanted: dict[int, PlaneMarker], dictionary: str, file: str | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return ids (k,) ascending and corners (k, 4, 2) [px] of the plane's markers."""
    ids, corners_px = detect_markers(grey, marker_detector(dictionary))
    twice = sorted(
        marker for marker, count in Counter(ids.tolist()).items() if count > 1 and marker in wanted
    )
    if twice:
        raise StrandcastError(
            "SC-C021",
            f"markers {twice} are in the picture twice",
            file=file,
            fix="cover or take away the copies; hand and plane markers need different ids",
        )
    mine = np.array([place for place, marker in enumerate(ids) if marker in wanted], int)
    if len(mine) < min(LEAST_MARKERS, len(wanted)) or len(wanted) < LEAST_MARKERS:
        raise _not_found(grey, wanted, dictionary, ids[mine].tolist(), ids.tolist(), file)
    mine = mine[np.argsort(ids[mine])]
    cells = len(marker_cells(dictionary, int(ids[mine][0])))
    return ids[mine], np.array([_refined(grey, corners, cells) for corners in corners_px[mine]])


def _refined(grey: np.ndarray, corners_px: np.ndarray, cells: int) -> np.ndarray:
    """Return a marker's corners (4, 2) [px] from lines along its sides; as found where unclear."""
    refined = refine_square(eight_bit(grey), corners_px, cells)
    return refined if np.isfinite(refined).all() else corners_px


def _not_found(
    grey: np.ndarray,
    wanted: dict[int, PlaneMarker],
    dictionary: str,
    mine: list[int],
    found: list[int],
    file: str | None,
) -> StrandcastError:
    """Say why too few markers were seen: mirrored picture, other dictionary, other ids, or none there."""
    if len(wanted) < LEAST_MARKERS:
        return StrandcastError(
            "SC-C022",
            f"the plane has {len(wanted)} markers, at least {LEAST_MARKERS} are needed",
            field="markers",
            cost="one marker alone leaves about 4 mm of error",
            fix="put markers at the corners of the space of the throw",
        )
    needed = f"needed {sorted(wanted)}, found {sorted(mine)}"
    mirrored, _ = detect_markers(np.ascontiguousarray(grey[:, ::-1]), marker_detector(dictionary))
    if len(set(mirrored.tolist()) & set(wanted)) >= LEAST_MARKERS:
        return StrandcastError(
            "SC-C023",
            f"the picture is mirrored ({needed}; its mirror image shows "
            f"{sorted(set(mirrored.tolist()) & set(wanted))})",
            file=file,
            fix="turn mirroring off in the camera's software, or take the mirror away",
        )
    for other in OTHER_DICTIONARIES:
        seen = set(detect_markers(grey, marker_detector(other))[0].tolist()) if not found else set()
        if len(seen & set(wanted)) >= LEAST_MARKERS:
            return StrandcastError(
                "SC-C024",
                f"the markers are of {other} or a part of it, not of {dictionary}",
                file=file,
                field="dictionary",
                fix="correct the dictionary",
            )
    others = f"; other ids seen: {sorted(set(found) - set(wanted))}" if set(found) - set(wanted) else ""
    return StrandcastError(
        "SC-C025",
        f"too few markers of the plane: {needed}{others}",
        file=file,
        field="markers",
        fix="check ids, focus and light; white paper must surround each black square",
    )


def _corners_m(marker: PlaneMarker) -> np.ndarray:
    """Return a marker's corners (4, 3) [m] in the world, in the order in which they are detected."""
    cosine, sine = np.cos(marker.angle_rad), np.sin(marker.angle_rad)
    turned = corners_of(marker.size_m) @ np.array([[cosine, sine], [-sine, cosine]])
    return np.column_stack([turned + np.array([marker.x_m, marker.y_m]), np.zeros(4)])


def _pose(world_m: np.ndarray, corners_px: np.ndarray, lens: Lens) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation (3, 3) and shift (3,) [m]: the better of IPPE's two, then Levenberg–Marquardt."""
    points, pixels = world_m.reshape(-1, 3), corners_px.reshape(-1, 2)
    matrix, distortion = np.array(lens.matrix), np.array(lens.distortion)
    count, turns, shifts, errors = cv2.solvePnPGeneric(
        points, pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE
    )
    best = min(range(count), key=lambda k: float(np.asarray(errors).reshape(-1)[k]))
    turn, shift = cv2.solvePnPRefineLM(
        points,
        pixels,
        matrix,
        distortion,
        turns[best],
        shifts[best],
        (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-12),
    )
    return np.asarray(cv2.Rodrigues(turn)[0]), np.asarray(shift).reshape(3)


def _project(world_m: np.ndarray, rotation: np.ndarray, shift: np.ndarray, lens: Lens) -> np.ndarray:
    projected, _ = cv2.projectPoints(
        world_m.reshape(-1, 3),
        cv2.Rodrigues(rotation)[0],
        shift,
        np.array(lens.matrix),
        np.array(lens.distortion),
    )
    return np.asarray(projected, float).reshape(*world_m.shape[:-1], 2)


def _camera(
    lens: Lens,
    ids: np.ndarray,
    corners_px: np.ndarray,
    rotation: np.ndarray,
    shift: np.ndarray,
    residuals: np.ndarray,
    string_offset_m: float,
) -> Camera:
    fits = [
        MarkerFit(
            marker=int(marker), rms_px=_rms(off), residuals_px=np.column_stack([place, off]).round(4).tolist()
        )
        for marker, place, off in zip(ids, corners_px, residuals, strict=True)
    ]
    return Camera(
        lens=lens,
        rotation=rotation.tolist(),
        translation_m=shift.tolist(),
        plane_rms_px=_rms(residuals),
        plane_markers=fits,
        string_offset_m=string_offset_m,
        scale_m_per_px=0.0,
        source="markers",
    )


def _rms(residuals_px: np.ndarray) -> float:
    return float(np.sqrt((residuals_px**2).sum(axis=-1).mean()))


def _check_sizes(
    camera: Camera, ids: np.ndarray, corners_px: np.ndarray, wanted: dict[int, PlaneMarker], file: str | None
) -> None:
    """Hold the sides of the markers, measured in the plane, against the sizes given."""
    corners_m = pixel_to_metre(camera, corners_px)
    sides_m = np.linalg.norm(np.roll(corners_m, -1, axis=1) - corners_m, axis=2).mean(axis=1)
    ratios = sides_m / np.array([wanted[marker].size_m for marker in ids])
    if abs(np.median(ratios) - 1.0) > SIZE_TOLERANCE:
        raise StrandcastError(
            "SC-C026",
            f"the markers measure {np.median(sides_m) * 1e3:.1f} mm against each other's places, "
            f"{np.median(ratios) - 1.0:+.1%} from the size given",
            file=file,
            field="size_m",
            cost="every length in the result would be off by as much",
            fix="measure the printed black squares and the distances of their centres; sizes are metres",
        )


def _check_places(
    ids: np.ndarray,
    corners_px: np.ndarray,
    world_m: np.ndarray,
    residuals: np.ndarray,
    camera: Camera,
    file: str | None,
) -> None:
    """Name the marker that lies elsewhere than said: the one without which the others agree."""
    if camera.plane_rms_px < MISPLACED_PX:
        return
    without = []
    for left_out in range(len(ids) if len(ids) > LEAST_MARKERS else 0):
        others = np.delete(np.arange(len(ids)), left_out)
        rotation, shift = _pose(world_m[others], corners_px[others], camera.lens)
        off = corners_px[others] - _project(world_m[others], rotation, shift, camera.lens)
        without.append((_rms(off), left_out, rotation, shift))
    best = min(without, key=lambda trial: trial[0], default=None)
    if best is None or best[0] > 0.5 * camera.plane_rms_px:
        worst = ids[int(np.argmax((residuals**2).sum(axis=(1, 2))))]
        raise StrandcastError(
            "SC-C027",
            f"the markers fit their places with {camera.plane_rms_px:.1f} px rms only, marker {worst} worst",
            file=file,
            field="markers",
            fix="measure the markers' places and turns again; is the lens this camera's?",
        )
    _, left_out, rotation, shift = best
    honest = camera.model_copy(update={"rotation": rotation.tolist(), "translation_m": shift.tolist()})
    seen = pixel_to_metre(honest, corners_px[left_out]).mean(axis=0)
    raise StrandcastError(
        "SC-C027",
        f"marker {ids[left_out]} lies at ({seen[0]:.4f}, {seen[1]:.4f}) m by the others, "
        f"{np.linalg.norm(seen - world_m[left_out, :, :2].mean(axis=0)) * 1e3:.1f} mm from the place given",
        file=file,
        field="markers",
        fix="correct its place or turn in the experiment",
    )
