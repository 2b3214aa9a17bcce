"""The calibration drawn over the photo of the plane by the calibrate stage, and its accuracy."""

import numpy as np
from markupsafe import Markup

from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, Lens
from strandcast.report.pages import embedded
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import ExperimentPageData

SOURCES = {
    "corners": "corners of the markers",
    "places": "places of the markers",
    "lens": "lens",
    "offset": "string's offset from the markers' plane",
}


def camera_picture(page: ExperimentPageData) -> PanelContent:
    """Return the picture beside a camera's record, with its standard errors by source."""
    record = page.camera_record
    camera = Camera.read(record)
    path = record.with_suffix(".webp")
    if not path.is_file():
        what = "the picture of the calibration is missing"
        raise StrandcastError("SC-W030", what, file=path, fix="calibrate again")
    data = embedded(path.read_bytes(), path)
    finding = _finding(camera)
    alt = f"The photo of the plane with its markers, residual arrows and the metric grid. {finding}"
    markup = Markup('<img class="wide" alt="{}" src="data:image/webp;base64,{}">').format(alt, data)
    return PanelContent(
        finding,
        markup,
        [each for each in (_source_table(camera), _model_table(camera), _warning_table(camera)) if each.rows],
        [f"cameras/{path.name}", f"cameras/{record.name}"],
    )


def _finding(camera: Camera) -> str:
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
