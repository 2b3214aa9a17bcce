"""How well lens and plane fit the detected corners."""

from typing import Any

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, coefficient_names
from strandcast.report.drawing import FITTED, MEASURED, Drawing, new_figure
from strandcast.report.numbers import UNKNOWN, significant
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import Array

MOST_ARROWS = 500


def calibration(page: TrialPageData) -> PanelContent:
    """Return residual arrows over the picture for lens and plane, and tables of photos and markers."""
    results = page.results
    camera: Camera = results.need("camera")
    lens = camera.lens
    plane = _stack([marker.residuals_px for marker in camera.plane_markers])
    photos = _stack([view.residuals_px for view in lens.views if view.used])
    if not len(plane) and not len(photos):
        raise StrandcastError(
            "SC-H031",
            f"the calibration ({camera.source}) has no corners whose residuals could be shown",
            file=page.results.file("camera"),
        )
    figure = new_figure(10.0, 3.4, left=0.07, top=0.92, bottom=0.14, wspace=0.2)
    panels = (("lens photos", photos, FITTED["color"]), ("markers of the plane", plane, MEASURED["color"]))
    for column, (name, corners, colour) in enumerate(panels):
        axes = figure.add_subplot(1, 2, column + 1)
        limits = {"xlim": (0, lens.width_px), "ylim": (lens.height_px, 0)}
        axes.set(**limits, aspect="equal", xlabel="u [px]", ylabel="v [px]")
        title = _arrows(axes, name, corners, colour, lens.width_px) if len(corners) else f"{name}: none"
        axes.set_title(title)
    finding = (
        f"Lens {lens.rms_px:.3f} px rms over {sum(view.used for view in lens.views)} photos; plane "
        f"{camera.plane_rms_px:.3f} px rms over {len(camera.plane_markers)} markers, "
        f"{camera.scale_m_per_px * 1e3:.3f} mm per pixel."
    )
    return PanelContent(
        finding,
        Drawing(figure, f"Calibration residuals. {finding}"),
        [_view_table(camera), _marker_table(camera), _lens_table(camera)],
        [page.results.file("camera")],
    )


def _stack(groups: list[list[list[float]]]) -> Array:
    rows = [row for group in groups for row in group]
    return np.array(rows, dtype=float).reshape(-1, 4)


def _arrows(axes: Any, name: str, corners: Array, colour: str, width_px: int) -> str:
    """Draw residual arrows, their rms about 3.5 % of the picture's width; return a title for them."""
    size_px = float(np.sqrt((corners[:, 2:] ** 2).sum(axis=1).mean()))
    wanted = 0.035 * width_px / max(size_px, 1e-6)
    power = 10.0 ** np.floor(np.log10(wanted))
    gain = float(max(step for step in (1, 2, 5) if step * power <= wanted) * power)
    shown = corners[np.unique(np.linspace(0, len(corners) - 1, MOST_ARROWS).round().astype(int))]
    heads = {"width": 0.0035, "headwidth": 4, "headlength": 4.5}
    axes.quiver(*shown.T, angles="xy", scale_units="xy", scale=1 / gain, color=colour, **heads)
    left = "" if len(shown) == len(corners) else f", {len(shown)} of them drawn"
    return f"{name}: {len(corners)} corners{left}, residuals × {gain:g}"


def _view_table(camera: Camera) -> Table:
    rows = [
        [
            view.file,
            str(view.corners),
            UNKNOWN if view.rms_px is None else f"{view.rms_px:.3f}",
            "yes" if view.used else f"no: {view.reason or 'no reason given'}",
        ]
        for view in camera.lens.views
    ]
    return Table(["lens photo", "corners", "rms [px]", "used"], rows)


def _marker_table(camera: Camera) -> Table:
    rows = [
        [str(marker.marker), f"{marker.rms_px:.3f}", f"{_worst(marker.residuals_px):.3f}"]
        for marker in camera.plane_markers
    ]
    return Table(["plane marker", "rms [px]", "worst corner [px]"], rows)


def _worst(residuals_px: list[list[float]]) -> float:
    return max((float(np.hypot(row[2], row[3])) for row in residuals_px), default=float("nan"))


def _lens_table(camera: Camera) -> Table:
    matrix = camera.lens.matrix
    values = {"fx": matrix[0][0], "fy": matrix[1][1], "cx": matrix[0][2], "cy": matrix[1][2]}
    rows = []
    for name, value in values.items():
        error = camera.lens.standard_errors.get(f"{name}_px")
        rows.append([name, f"{value:.2f}" + (f" ± {error:.2f}" if error is not None else "")])
    names = coefficient_names(camera.lens.distortion)
    for name, value in zip(names, camera.lens.distortion, strict=True):
        error = camera.lens.standard_errors.get(name)
        rows.append([name, significant(value) + (f" ± {error:.1g}" if error is not None else "")])
    return Table(["lens", "value [px, distortion 1]"], rows)
