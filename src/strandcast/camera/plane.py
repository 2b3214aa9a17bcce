"""The plane of motion from one photo of ArUco markers, or of a ChArUco board, of known size and place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strandcast.camera.find_markers import find_markers
from strandcast.camera.mapping import metre_per_pixel, pixel_to_metre
from strandcast.camera.markers import CharucoBoard, opencv_board
from strandcast.camera.plane_checks import Layout, check_markers
from strandcast.camera.plane_error import Box, place_sd_m, plane_error
from strandcast.camera.pose import PlaneMarker, PoseFit, fit_pose, posed, rms
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, Lens, MarkerFit, PlaneError

__all__ = ["PlaneKnowledge", "PlaneMarker", "board_markers", "plane_from_markers"]

LENS_ERROR_M = 5e-3  # what the lens alone may cost in the string's plane
LENS_WARNING_M = 5e-4
WORST_WARNING_M = 2e-3
SOURCES = {
    "corners": "markers' corners: take larger ones, or more, all around the workspace",
    "places": "markers' places: measure them again",
    "lens": "lens",
    "offset": "string's offset: measure it again",
}


@dataclass(frozen=True)
class PlaneKnowledge:
    """What is known of the plane besides its photo.

    Attributes
    ----------
    string_offset_m, string_offset_sd_m
        Height of the string's plane over that of the markers, towards the camera, and how well it is known.
    place_sd_m
        How well the markers' places were measured; by default found from how well they fit.
    workspace_m
        Where the string may be: (x from, to), (y from, to); by default between the markers.
    """

    string_offset_m: float = 0.0
    string_offset_sd_m: float = 0.0
    place_sd_m: float | None = None
    workspace_m: Box | None = None


def plane_from_markers(
    grey: np.ndarray,
    lens: Lens,
    markers_world: Sequence[PlaneMarker],
    dictionary: str,
    string_offset_m: float = 0.0,
    file: str | None = None,
    knowledge: PlaneKnowledge | None = None,
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
        Height of the string's plane over that of the markers, where `knowledge` is not given.
    file
        The photo's name, for messages.
    knowledge
        What else is known of the plane.

    Returns
    -------
    Camera
        With residuals [px] per marker and corner, measured minus model, and the standard error over the
        workspace. `scale_m_per_px` is that of the string's plane at the middle of the markers.

    Raises
    ------
    StrandcastError
        SC-C020 another size of picture than the lens'; SC-C021 to SC-C025 as `find_markers`; SC-C026 to
        SC-C028 as `plane_checks`; SC-C015 the lens is too little known.
    """
    known = knowledge or PlaneKnowledge(string_offset_m)
    if grey.shape != (lens.height_px, lens.width_px):
        raise StrandcastError(
            "SC-C020",
            f"is {grey.shape[1]} x {grey.shape[0]} px, the lens was calibrated at {lens.width_px} x "
            f"{lens.height_px}",
            file=file,
            fix="take the photo in the mode that films the throw",
        )
    wanted = {marker.marker: marker for marker in markers_world}
    ids, corners_px, warnings = find_markers(grey, wanted, dictionary, file)
    seen = [wanted[int(marker)] for marker in ids]
    fit = fit_pose(np.array([marker.corners_m() for marker in seen]), corners_px, lens)
    camera = _camera(lens, fit, known.string_offset_m, dictionary)
    box = known.workspace_m or _around(seen)
    layout = Layout(seen, corners_px, camera, fit, box, file)
    size, told = check_markers(layout)
    camera.marker_size_ratio, camera.marker_size_ratio_se = size.ratio, size.error
    camera.plane_markers = _marker_fits(layout)
    camera.plane_error = plane_error(camera, fit, box, known.place_sd_m, known.string_offset_sd_m)
    camera.warnings = warnings + told + _lens_warnings(camera) + _error_warnings(camera.plane_error)
    return camera


def board_markers(board: CharucoBoard, x_m: float, y_m: float, angle_rad: float = 0.0) -> list[PlaneMarker]:
    """Return the markers of a ChArUco board that lies in the plane.

    `x_m`, `y_m` is the place of the board's lower left corner (as printed), `angle_rad` its turn.
    """
    pattern = opencv_board(board)
    height_m = board.rows * board.square_m
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    markers = []
    for marker, corners in zip(np.asarray(pattern.getIds()).reshape(-1), pattern.getObjPoints(), strict=True):
        across, down = np.asarray(corners, float).reshape(4, 3)[:, :2].mean(axis=0)
        up = height_m - down
        markers.append(
            PlaneMarker(
                int(marker),
                x_m + cosine * across - sine * up,
                y_m + sine * across + cosine * up,
                board.marker_m,
                angle_rad,
            )
        )
    return markers


def _camera(lens: Lens, fit: PoseFit, string_offset_m: float, dictionary: str) -> Camera:
    camera = Camera(
        lens=lens,
        rotation=fit.rotation.tolist(),
        translation_m=fit.shift_m.tolist(),
        plane_rms_px=fit.rms_px,
        plane_markers=[],
        string_offset_m=string_offset_m,
        scale_m_per_px=0.0,
        source="markers",
        dictionary=dictionary,
    )
    middle_m = fit.world_m[..., :2].mean(axis=(0, 1))
    camera.scale_m_per_px = float(metre_per_pixel(camera, middle_m, string_offset_m))
    return camera


def _around(markers: Sequence[PlaneMarker]) -> Box:
    """Return the box between the markers' centres."""
    x, y = [marker.x_m for marker in markers], [marker.y_m for marker in markers]
    return (min(x), max(x)), (min(y), max(y))


def _marker_fits(layout: Layout) -> list[MarkerFit]:
    """Return each marker's residuals, and its place by the others."""
    fit, camera = layout.fit, layout.camera
    count = len(layout.markers)
    fits = []
    for k, (marker, corners_px, off) in enumerate(
        zip(layout.markers, layout.corners_px, fit.residuals_px, strict=True)
    ):
        others = np.delete(np.arange(count), k)
        record = MarkerFit(
            marker=marker.marker,
            rms_px=rms(off),
            residuals_px=np.column_stack([corners_px, off]).round(4).tolist(),
        )
        if count > 2:
            without = posed(camera, fit_pose(fit.world_m[others], layout.corners_px[others], camera.lens))
            place = pixel_to_metre(without, corners_px).mean(axis=0) - (marker.x_m, marker.y_m)
            sigma_m = np.hypot(
                0.5 * fit.corner_sigma_px() * camera.scale_m_per_px, place_sd_m(fit, camera.scale_m_per_px)
            )
            record.off_m, record.off_sigma_m = place.tolist(), float(sigma_m)
        fits.append(record)
    return fits


def _lens_warnings(camera: Camera) -> list[str]:
    """Say what the weaknesses of the lens photos cost at the string."""
    error = camera.plane_error
    cost_m = error.sources_m.get("lens", 0.0) if error is not None else 0.0
    told = "; ".join(camera.lens.weaknesses)
    if cost_m > LENS_ERROR_M:
        raise StrandcastError(
            "SC-C015",
            f"the lens photos do not tell the lens: {told or 'its standard errors are large'}",
            field="camera.lens_photos",
            cost=f"{cost_m * 1e3:.1f} mm (standard error) at the string's worst place",
            fix="take ten photos, the board large, tilted 30-45 degrees each way, all over the picture",
        )
    if told or cost_m > LENS_WARNING_M:
        return [
            f"the lens costs up to {cost_m * 1e3:.2f} mm (standard error) at the string"
            + (f"; its photos are weak: {told}" if told else "")
        ]
    return []


def _error_warnings(error: PlaneError) -> list[str]:
    """Tell of a plane that is poorly known somewhere, and what makes most of it."""
    if error.worst_m < WORST_WARNING_M:
        return []
    most = max(error.sources_m, key=lambda name: error.sources_m[name])
    return [
        f"a point of the string is known to ±{error.worst_m * 1e3:.1f} mm only at the workspace's worst "
        f"place, mostly for the {SOURCES[most]}"
    ]
