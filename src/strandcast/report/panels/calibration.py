"""How well lens and plane fit the detected corners, and the photo of the plane with the calibration."""

from typing import Any

import numpy as np
from markupsafe import Markup

from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, Lens, coefficient_names
from strandcast.report.drawing import FITTED, MEASURED, Drawing, new_figure
from strandcast.report.numbers import UNKNOWN, significant
from strandcast.report.pages import embedded
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import ExperimentPageData, TrialPageData
from strandcast.report.results import Array

MOST_ARROWS = 500
SOURCES = {
    "corners": "corners of the markers",
    "places": "places of the markers",
    "lens": "lens",
    "offset": "string's offset from the markers' plane",
}


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


def camera_picture(page: ExperimentPageData) -> PanelContent:
    """Return the picture beside a camera's record, with its standard errors by source."""
    record = page.camera_record
    camera = Camera.read(record)
    path = record.with_suffix(".webp")
    if not path.is_file():
        what = "the picture of the calibration is missing"
        raise StrandcastError("SC-W030", what, file=path, fix="calibrate again")
    data = embedded(path.read_bytes(), path)
    finding = _picture_finding(camera)
    alt = f"The photo of the plane with its markers, residual arrows and the metric grid. {finding}"
    markup = Markup('<img class="wide" alt="{}" src="data:image/webp;base64,{}">').format(alt, data)
    return PanelContent(
        finding,
        markup,
        [each for each in (_source_table(camera), _model_table(camera), _warning_table(camera)) if each.rows],
        [f"cameras/{path.name}", f"cameras/{record.name}"],
    )


def _picture_finding(camera: Camera) -> str:
    error = camera.plane_error
    scale = f"{camera.scale_m_per_px * 1e3:.3f} mm per pixel"
    if error is None:
        return f"The string's plane: {scale}."
    return (
        f"A point of the string's plane is known to ±{error.median_m * 1e3:.2f} mm (median over the "
        f"workspace), ±{error.worst_m * 1e3:.2f} mm at worst; {scale}."
    )


def _source_table(camera: Camera) -> Table:
    error = camera.plane_error
    found = {} if error is None else error.sources_m
    rows = [[words, f"{found[name] * 1e3:.3f}"] for name, words in SOURCES.items() if name in found]
    return Table(["source of error", "standard error at the worst place [mm]"], rows)


def _model_table(camera: Camera) -> Table:
    lens = camera.lens
    rows = [
        [
            trial.model,
            f"{trial.held_out_px:.4f}" if trial.held_out_px is not None else f"rejected: {trial.reason}",
            "yes" if trial.model == lens.model else "no",
        ]
        for trial in lens.models
    ]
    return Table(["lens model", "residual over held-out photos [px]", "chosen"], rows, _coverage_words(lens))


def _coverage_words(lens: Lens) -> str:
    coverage = lens.coverage
    if coverage is None:
        return ""
    return (
        f"The board's corners cover {coverage.share:.0%} of the picture; two boards are tilted by up to "
        f"{np.degrees(coverage.tilt_spread_rad):.0f}° to each other."
    )


def _warning_table(camera: Camera) -> Table:
    return Table(["warning"], [[words] for words in [*camera.lens.warnings, *camera.warnings]])
