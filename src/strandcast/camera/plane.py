"""The plane of motion from one photo of ArUco markers, or of a ChArUco board, of known size and position."""

from collections.abc import Sequence

import numpy as np

from strandcast.camera.find_markers import find_markers
from strandcast.camera.mapping import metre_per_pixel, metre_to_pixel, pixel_to_metre
from strandcast.camera.marker_pose import true_corners
from strandcast.camera.markers import opencv_board
from strandcast.camera.plane_checks import MarkerLayout, check_markers
from strandcast.camera.plane_error import PlaneBox, place_sd_m, plane_error
from strandcast.camera.pose import PlacedMarker, PoseFit, fit_pose, posed, rms
from strandcast.config.camera import Board
from strandcast.core.pose import rotated
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, Lens, MarkerFit, PlaneError

LENS_ERROR_M = 5e-3  # chosen: largest standard error in the string's plane from the lens alone
LENS_WARNING_M = 5e-4  # chosen
WORST_WARNING_M = 2e-3  # chosen
LIKELY_OFFSET_M = 0.01  # chosen: of a string's plane from the markers'; a hand's plate is as thick
UNEQUAL_FOCAL_LENGTHS = 0.02  # chosen: relative difference; cameras with square pixels stay below 0.01
SOURCES = {
    "corners": "markers' corners: use larger markers, or more, all around the workspace",
    "places": "markers' positions: measure them again",
    "lens": "lens",
    "offset": "string's offset: measure it again",
}


def plane_from_markers(
    grey: np.ndarray,
    lens: Lens,
    markers_world: Sequence[PlacedMarker],
    dictionary: str,
    *,
    file: str | None = None,
    string_offset_m: float = 0.0,
    string_offset_sd_m: float = 0.0,
    place_sd_m: float | None = None,
    workspace_m: PlaneBox | None = None,
    on_board: bool = False,
) -> Camera:
    """Estimate the camera's pose relative to the motion plane by perspective-n-point, through the lens.

    Parameters
    ----------
    grey, file
        Photo (height, width) of the plane, taken with the position and mode used for filming; its name.
    markers_world, on_board
        The markers as placed: world metres, x right, y up, rotation counter-clockwise. Whether they are those
        of a board: messages name its settings.
    string_offset_m, string_offset_sd_m
        Height of the string's plane above that of the markers, towards the camera; its standard deviation.
    place_sd_m
        Standard deviation of the markers' measured positions; by default from the residuals.
    workspace_m
        Region of the string: (x from, to), (y from, to); by default between the markers.

    Returns
    -------
    Camera
        With residuals [px] per marker and corner, measured minus model, and the standard error over the
        workspace. `scale_m_per_px` is that of the string's plane at the middle of the markers.

    Raises
    ------
    StrandcastError
        SC-C012 the photo's size is not the lens calibration's; SC-C016, SC-C021 to SC-C025 as `find_markers`;
        SC-C027 as `plane_checks`; SC-C013 the lens is too uncertain.
    """
    if grey.shape != (lens.height_px, lens.width_px):
        sizes = f"{grey.shape[1]} x {grey.shape[0]} px", f"{lens.width_px} x {lens.height_px}"
        what = f"is {sizes[0]}; the lens was calibrated at {sizes[1]}"
        raise StrandcastError("SC-C012", what, file=file)
    wanted = {marker.marker: marker for marker in markers_world}
    ids, corners_px, warnings = find_markers(grey, wanted, dictionary, file)
    corners_px = true_corners(lens, corners_px)
    detected = [wanted[int(marker)] for marker in ids]
    fit = fit_pose(np.array([marker.corners_m() for marker in detected]), corners_px, lens)
    camera = _camera(lens, fit, string_offset_m, dictionary)
    box = workspace_m or _around(detected)
    layout = MarkerLayout(detected, corners_px, camera, fit, box, file, on_board)
    size, marker_warnings = check_markers(layout)
    camera.marker_size_ratio, camera.marker_size_ratio_se = size.ratio, size.error
    camera.plane_markers = _marker_fits(layout)
    camera.plane_error = plane_error(camera, fit, box, place_sd_m, string_offset_sd_m)
    camera.warnings = (
        warnings
        + marker_warnings
        + _lens_warnings(camera)
        + _aspect_warnings(lens)
        + _error_warnings(camera.plane_error)
    )
    return camera


def unmeasured_offset_warnings(camera: Camera) -> list[str]:
    """Return a warning about a string's plane that is taken for the markers', if that matters."""
    error = camera.plane_error
    assert error is not None  # of a plane from markers
    places_m = np.stack(np.meshgrid(error.x_m, error.y_m), axis=-1)
    seen_m = pixel_to_metre(camera, metre_to_pixel(camera, places_m, LIKELY_OFFSET_M), 0.0)
    most_m = float(np.nanmax(np.linalg.norm(seen_m - places_m, axis=-1)))
    if most_m < WORST_WARNING_M:
        return []
    return [
        f"camera.string_offset_m is not given: {1e3 * LIKELY_OFFSET_M:g} mm of it move the string by up to "
        f"{1e3 * most_m:.1f} mm; it is taken to be 0: measure the distance and set it, 0.0 if there is none"
    ]


def board_markers(board: Board, x_m: float, y_m: float, angle_rad: float = 0.0) -> list[PlacedMarker]:
    """Return the markers of a ChArUco board lying in the plane.

    `x_m`, `y_m` is the position of the board's lower left corner (as printed), `angle_rad` its rotation.
    """
    pattern = opencv_board(board)
    height_m = board.squares_y * board.square_m
    markers = []
    for marker, corners in zip(np.asarray(pattern.getIds()).reshape(-1), pattern.getObjPoints(), strict=True):
        across, down = np.asarray(corners, float).reshape(4, 3)[:, :2].mean(axis=0)
        right, up = rotated(np.array([across, height_m - down]), np.asarray(angle_rad))
        markers.append(PlacedMarker(int(marker), x_m + right, y_m + up, board.marker_m, angle_rad))
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


def _around(markers: Sequence[PlacedMarker]) -> PlaneBox:
    """Return the box between the markers' centres."""
    x, y = [marker.x_m for marker in markers], [marker.y_m for marker in markers]
    return (min(x), max(x)), (min(y), max(y))


def _marker_fits(layout: MarkerLayout) -> list[MarkerFit]:
    """Return each marker's residuals, and its position as predicted by the others."""
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
            scale = camera.scale_m_per_px
            sigma_m = np.hypot(0.5 * fit.corner_sigma_px() * scale, place_sd_m(fit, scale))
            record.off_m, record.off_sigma_m = place.tolist(), float(sigma_m)
        fits.append(record)
    return fits


def _lens_warnings(camera: Camera) -> list[str]:
    """Return a warning about the error at the string from weak lens photos, or refuse it."""
    error = camera.plane_error
    cost_m = error.sources_m.get("lens", 0.0) if error is not None else 0.0
    weaknesses = "; ".join(camera.lens.weaknesses)
    if cost_m > LENS_ERROR_M:
        raise StrandcastError(
            "SC-C013",
            f"the lens photos do not determine the lens: {weaknesses or 'its standard errors are large'}",
            field="camera.lens",
            cost=f"{cost_m * 1e3:.1f} mm (standard error) at the worst position of the string",
        )
    if weaknesses or cost_m > LENS_WARNING_M:
        return [
            f"the lens costs up to {cost_m * 1e3:.2f} mm (standard error) at the string"
            + (f"; its photos are weak: {weaknesses}" if weaknesses else "")
        ]
    return []


def _aspect_warnings(lens: Lens) -> list[str]:
    """Return a warning about a lens for pixels that are not square."""
    fx_px, fy_px = lens.matrix[0][0], lens.matrix[1][1]
    if abs(fy_px / fx_px - 1.0) < UNEQUAL_FOCAL_LENGTHS:
        return []
    return [
        f"the lens' focal lengths differ, fx = {fx_px:.1f} and fy = {fy_px:.1f} px: its pixels are "
        f"{fy_px / fx_px:.4g} times as wide as high; the throws must be filmed with the same pixels"
    ]


def _error_warnings(error: PlaneError) -> list[str]:
    """Return a warning if the plane is uncertain somewhere, with the main source."""
    if error.worst_m < WORST_WARNING_M:
        return []
    most = max(error.sources_m, key=lambda name: error.sources_m[name])
    return [
        f"the standard error of a point of the string reaches {error.worst_m * 1e3:.1f} mm in the "
        f"workspace, mostly from the {SOURCES[most]}"
    ]
