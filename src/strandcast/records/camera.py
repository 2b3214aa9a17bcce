"""camera.json: lens, distortion, pose of the motion plane, and how well each corner fits."""

from __future__ import annotations

from typing import ClassVar

from strandcast.records.record import Part, Record


class View(Part):
    """One board photo: how many corners it gave, and whether it was used."""

    file: str
    corners: int
    rms_px: float | None
    used: bool
    reason: str | None = None
    residuals_px: list[list[float]] = []  # per corner: u, v, du, dv


class MarkerFit(Part):
    """One marker of the motion plane: its worst corner and its residuals."""

    marker: int
    rms_px: float
    residuals_px: list[list[float]]  # per corner: u, v, du, dv


class Lens(Part):
    """Pinhole with OpenCV's distortion polynomial (k1, k2, p1, p2, k3)."""

    width_px: int
    height_px: int
    matrix: list[list[float]]  # 3×3, pixels
    distortion: list[float]
    rms_px: float
    standard_errors: dict[str, float] = {}  # fx_px, fy_px, cx_px, cy_px
    views: list[View] = []
    model: str = "given"  # which coefficients were free: "radial1" … "radial3", "tangential", "full"
    warnings: list[str] = []


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
    source: str  # "markers", "arc" (known length of a pendulum) or "given"
    warnings: list[str] = []
    # Where the scale comes from a pendulum's arc: its radius and half its angle.
    arc_radius_px: float | None = None
    arc_radius_sigma_px: float | None = None
    arc_half_angle_rad: float | None = None
