"""cameras/<name>.json: lens, pose of the motion plane, residuals, and accuracy."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from strandcast.records.record import Part, Record

FISHEYE = ("k1", "k2", "k3", "k4")
DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


class BoardView(Part):
    """One board photo: how many corners it gave, and whether it was used."""

    file: str
    corners: int
    rms_px: float | None
    used: bool
    reason: str | None = None
    tilt_rad: float | None = None  # between the board's normal and the line of sight
    residuals_px: list[list[float]] = []  # per corner: u, v, du, dv


class ModelTrial(Part):
    """One distortion model that was tried: rms residual over photos that had no part in its fit."""

    model: str
    held_out_px: float | None
    reason: str | None = None  # why it was rejected


class Coverage(Part):
    """Where in the picture the board's corners were, and how far the board was tilted."""

    cells: list[list[int]]  # corners in each cell of a grid over the picture, rows from the top
    share: float  # of the cells that hold a corner
    reach: float  # the farthest corner from the picture's middle, over the picture's half diagonal
    board_share: float  # of the picture's width that the board takes, median over the photos
    tilt_spread_rad: float  # largest angle between two photos' boards


class MarkerFit(Part):
    """One marker of the motion plane: its residuals, and its offset estimated from the others."""

    marker: int
    rms_px: float
    residuals_px: list[list[float]]  # per corner: u, v, du, dv
    off_m: list[float] | None = None  # x, y from the place given, by the other markers
    off_sigma_m: float | None = None


def is_fisheye(distortion: Sequence[float] | np.ndarray) -> bool:
    """Return whether these are the coefficients of a fisheye lens."""
    return len(distortion) == len(FISHEYE)


def coefficient_names(distortion: Sequence[float]) -> tuple[str, ...]:
    """Return the names of a lens' coefficients."""
    return FISHEYE if is_fisheye(distortion) else DISTORTION[: len(distortion)]


class Lens(Part):
    """Pinhole with OpenCV's distortion: k1, k2, p1, p2, k3, and for the rational model k4, k5, k6.

    Four coefficients are k1 to k4 of OpenCV's fisheye model.
    """

    width_px: int
    height_px: int
    matrix: list[list[float]]  # 3×3, pixels
    distortion: list[float]
    rms_px: float
    standard_errors: dict[str, float] = {}  # fx_px, fy_px, cx_px, cy_px, k1 …: of those that were free
    views: list[BoardView] = []
    model: str = "given"  # which coefficients were free: "none", "k1", "k1k2", … "rational", "fisheye"
    models: list[ModelTrial] = []
    held_out_px: float | None = None
    coverage: Coverage | None = None
    # Of fx, fy, cx, cy and the distortion (k1 to p2 free): large where the photos do not determine them.
    covariance: list[list[float]] = []
    legacy: bool = False  # the board's pattern, as it was found
    warnings: list[str] = []
    # Shortcomings of the photos; the camera's warnings give their cost in the plane.
    weaknesses: list[str] = []


class PlaneError(Part):
    """Standard error [m] of a point of the string's plane (root of its two variances' mean), on a grid."""

    x_m: list[float]
    y_m: list[float]
    sigma_m: list[list[float]]  # a row for each y
    median_m: float
    worst_m: float
    # The worst error over the grid from each source alone: corners, places, lens, offset.
    sources_m: dict[str, float]
    corner_sigma_px: float
    place_sd_m: float
    string_offset_sd_m: float

    def at(self, place_m: np.ndarray) -> float:
        """Return the standard error [m] at a place (2,) [m]; outside the grid, that of its nearest edge."""
        rows = [np.interp(place_m[0], self.x_m, row) for row in self.sigma_m]
        return float(np.interp(place_m[1], self.y_m, rows))


class Camera(Record):
    """World plane to pixel and back. Pose: camera = R · world + t, world z towards the camera."""

    SCHEMA: ClassVar[str] = "strandcast/camera"

    lens: Lens
    rotation: list[list[float]]  # 3×3, world to camera
    translation_m: list[float]
    plane_rms_px: float
    plane_markers: list[MarkerFit]
    string_offset_m: float  # of the string's plane over the markers' plane, towards the camera
    scale_m_per_px: float  # at the middle of the plane's markers
    source: str  # "markers", "given", or what a tracker names
    dictionary: str | None = None  # of the plane's markers
    marker_size_ratio: float | None = None  # size measured by the markers' distances over the size given
    marker_size_ratio_se: float | None = None
    plane_error: PlaneError | None = None
    warnings: list[str] = []
