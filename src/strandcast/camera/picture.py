"""A picture of the calibration: detected markers, corner residuals, and a grid in the string's plane."""

from itertools import product
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from strandcast.camera.mapping import metre_to_pixel, pixel_to_metre
from strandcast.camera.markers import eight_bit
from strandcast.camera.plane_error import PlaneBox
from strandcast.camera.pose import rms
from strandcast.records.camera import Camera

WIDTH_PX = 1600
DPI = 100
STRIP_PX = 132  # height of the legend under the photo
BACK, INK = "#14181d", "#f2f4f6"
# Okabe–Ito; each is drawn on a dark outline.
GRID, MARKER, ARROW, ERROR = "#56b4e9", "#e69f00", "#ff8ad4", "#f0e442"
ARROW_SHARE = 0.022  # chosen: largest rms length of the arrows relative to the picture's width
LINES = 10  # chosen: approximate number of grid lines along the longer side
DIM = 0.78  # chosen: brightness of the photo
CASING = [withStroke(linewidth=2.6, foreground=BACK)]
ARROWS: dict[str, Any] = {
    "color": ARROW,
    "angles": "xy",
    "scale_units": "xy",
    "units": "inches",
    "width": 0.026,
    "headwidth": 3.6,
    "headlength": 4.2,
    "headaxislength": 3.8,
}


def camera_picture(grey: np.ndarray, camera: Camera) -> np.ndarray:
    """Draw a calibration over its photo (height, width); return an RGB image (rows, columns, 3), uint8."""
    height, width = grey.shape
    photo_px = round(WIDTH_PX * height / width)
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"text.parse_math": False, "font.size": 10.5, "text.color": INK})
        figure = Figure(figsize=(WIDTH_PX / DPI, (photo_px + STRIP_PX) / DPI), dpi=DPI, facecolor=BACK)
        canvas = FigureCanvasAgg(figure)
        share = STRIP_PX / (photo_px + STRIP_PX)
        axes = figure.add_axes((0.0, share, 1.0, 1.0 - share))
        left, right, bottom, top = edges = (-0.5, width - 0.5, height - 0.5, -0.5)
        axes.imshow(DIM * eight_bit(grey), cmap="gray", vmin=0, vmax=255, extent=edges)
        axes.set(xlim=(left, right), ylim=(bottom, top))
        axes.axis("off")
        box = _box(camera, width, height)
        step_m = _draw_grid(axes, camera, box)
        gain = _draw_markers(axes, camera, width)
        _draw_errors(axes, camera)
        strip = figure.add_axes((0.0, 0.0, 1.0, share), xlim=(0, WIDTH_PX), ylim=(0, STRIP_PX))
        strip.axis("off")
        _write_strip(strip, camera, step_m, gain, WIDTH_PX / width)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _box(camera: Camera, width: int, height: int) -> PlaneBox:
    """Return the workspace, or the visible part of the plane."""
    if camera.plane_error is not None:
        x, y = camera.plane_error.x_m, camera.plane_error.y_m
        return (x[0], x[-1]), (y[0], y[-1])
    corners_px = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    (left, low), (right, high) = (
        f(pixel_to_metre(camera, corners_px, camera.string_offset_m), axis=0) for f in (np.nanmin, np.nanmax)
    )
    return (float(left), float(right)), (float(low), float(high))


def _draw_grid(axes: Any, camera: Camera, box: PlaneBox) -> float:
    """Draw the metric grid of the string's plane through the lens; return its step [m]."""
    longest = max(high - low for low, high in box)
    step_m = min((0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0), key=lambda step: abs(longest / step - LINES))
    for axis in (0, 1):
        along = np.linspace(*box[1 - axis], 60)
        first, last = (
            round(value / step_m + nudge) for value, nudge in zip(box[axis], (0.4999, -0.4999), strict=True)
        )
        for index in range(first, last + 1):
            places = np.empty((len(along), 2))
            places[:, axis], places[:, 1 - axis] = index * step_m, along
            line = metre_to_pixel(camera, places, camera.string_offset_m)
            heavy = index == 0
            axes.plot(*line.T, color=GRID, linewidth=2.4 if heavy else 1.2, alpha=1.0 if heavy else 0.85)
            # Slightly outside the line's lower or left end.
            shift, align = ((0, -5), "center top") if axis == 0 else ((-5, 0), "right center")
            _write(axes, f"{index * step_m:g}", line[0], shift, align, color=GRID, annotation_clip=True)
    _name_axes(axes, camera, box)
    return step_m


def _name_axes(axes: Any, camera: Camera, box: PlaneBox) -> None:
    places = np.array([[box[0][1], box[1][0]], [box[0][0], box[1][1]]])
    right, top = metre_to_pixel(camera, places, camera.string_offset_m)
    _write(axes, "x [m] →", right, (-8, 5), "right bottom", color=GRID, fontweight="bold")
    _write(axes, "y [m] ↑", top, (-4, 8), "left bottom", color=GRID, fontweight="bold")


def _write(axes: Any, text: str, place: Any, shift: tuple[int, int], align: str, **style: Any) -> None:
    """Write a text on a dark outline, shifted from a place (u, v) [px] by points (right, up)."""
    across, up = align.split()
    style |= {"textcoords": "offset points", "ha": across, "va": up, "path_effects": CASING}
    axes.annotate(text, place, shift, **style)


def _draw_markers(axes: Any, camera: Camera, width: int) -> float:
    """Draw the markers' outlines, ids and residual arrows; return the magnification of the arrows."""
    if not camera.plane_markers:
        return 0.0
    rows = np.array([fit.residuals_px for fit in camera.plane_markers])
    gain = _round_down(ARROW_SHARE * width / max(rms(rows[..., 2:]), 1e-6))
    for fit, corners in zip(camera.plane_markers, rows[..., :2], strict=True):
        ring = np.vstack([corners, corners[:1]])
        axes.plot(*ring.T, color=BACK, linewidth=3.4)
        axes.plot(*ring.T, color=MARKER, linewidth=1.8)
        above = (float(corners[:, 0].mean()), float(corners[:, 1].min()))
        _write(axes, str(fit.marker), above, (0, 7), "center bottom", color=MARKER, fontweight="bold")
    flat = rows.reshape(-1, 4)
    axes.quiver(*flat.T, scale=1.0 / gain, edgecolor=BACK, linewidth=0.6, zorder=4, **ARROWS)
    return gain


def _draw_errors(axes: Any, camera: Camera) -> None:
    """Write the standard error at nine positions in the workspace."""
    error = camera.plane_error
    if error is None:
        return
    rows, columns = ((1, len(each) // 2, len(each) - 2) for each in (error.y_m, error.x_m))
    for row, column in product(rows, columns):
        place = np.array([error.x_m[column], error.y_m[row]])
        u, v = metre_to_pixel(camera, place, camera.string_offset_m)
        axes.plot(u, v, "o", markersize=5, color=ERROR, markeredgecolor=BACK, zorder=5)
        label = f"±{error.sigma_m[row][column] * 1e3:.2f}"
        _write(axes, label, (u, v), (6, 5), "left bottom", color=ERROR, zorder=5)


def _write_strip(strip: Any, camera: Camera, step_m: float, gain: float, zoom: float) -> None:
    """Draw the legend: each symbol with its meaning."""
    left, right, text_offset = 24.0, 0.5 * WIDTH_PX + 12.0, 50.0
    rows = [STRIP_PX - 28.0, STRIP_PX - 64.0, STRIP_PX - 100.0]
    strip.plot([left, left + 36], [rows[0]] * 2, color=GRID, linewidth=2)
    grid = f"the string's plane, a line every {step_m * 1e3:g} mm (world frame, m)"
    for row, words in zip(rows, (grid, _offset_text(camera), _lens_text(camera)), strict=True):
        strip.text(left + text_offset, row, words, va="center")
    if camera.plane_markers:
        u, v = np.array([8, 28, 28, 8, 8]) + right, np.array([-8, -8, 8, 8, -8]) + rows[0]
        strip.plot(u, v, color=MARKER, linewidth=1.8)
        found = f"detected markers with ids: {camera.plane_rms_px:.2f} px rms residual"
        strip.text(right + text_offset, rows[0], found, va="center")
        bar_px = _round_down(0.1 * WIDTH_PX / (gain * zoom))
        length = bar_px * gain * zoom
        strip.quiver([right - 4], [rows[1]], [length], [0], scale=1.0, **ARROWS)
        words = f"{bar_px:g} px: measured minus model corner, drawn × {gain:g}"
        strip.text(right + length + 14, rows[1], words, va="center")
    if camera.plane_error is not None:
        error = camera.plane_error
        strip.plot(right + 18, rows[2], "o", markersize=5, color=ERROR)
        words = (
            f"± standard error of a point of the string's plane, mm: median {error.median_m * 1e3:.2f}, "
            f"worst {error.worst_m * 1e3:.2f}"
        )
        strip.text(right + text_offset, rows[2], words, va="center")


def _round_down(largest: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that does not exceed a limit."""
    power = 10.0 ** np.floor(np.log10(largest))
    return float(max(step for step in (1, 2, 5) if step * power <= largest) * power)


def _offset_text(camera: Camera) -> str:
    offset_mm = camera.string_offset_m * 1e3
    if camera.source != "markers":
        return f"scale without markers ({camera.source}), {camera.scale_m_per_px * 1e3:.3f} mm per pixel"
    if offset_mm == 0.0:
        where = "it is the markers' plane"
    else:
        side = "in front of" if offset_mm > 0 else "behind"
        where = f"it is {abs(offset_mm):g} mm {side} the markers' plane (corrected)"
    return f"{where}; {camera.scale_m_per_px * 1e3:.3f} mm per pixel"


def _lens_text(camera: Camera) -> str:
    lens = camera.lens
    used = sum(view.used for view in lens.views)
    if not used:
        return "no lens was calibrated"
    held_out = "" if lens.held_out_px is None else f", {lens.held_out_px:.2f} px on held-out photos"
    return f"lens from {used} photos, {lens.model}: {lens.rms_px:.2f} px rms{held_out}"
