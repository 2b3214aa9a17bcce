"""The calibration over the photo of the plane, as the calibrate stage drew it, and what it is worth."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
from markupsafe import Markup

from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, Lens
from strandcast.report.reportlet import Reportlet, Table

PICTURE, RECORD = "camera.webp", "camera.json"
LARGEST_BYTES = 1_500_000
SOURCES = {
    "corners": "corners of the markers",
    "places": "places of the markers",
    "lens": "lens",
    "offset": "string's offset from the markers' plane",
}


def camera_picture(key: str, title: str, folder: Path) -> Reportlet:
    """Return the picture in an experiment's folder of results, with its standard errors by source."""
    camera = Camera.read(folder / RECORD)
    path = folder / PICTURE
    if not path.is_file():
        raise StrandcastError(
            "SC-H032", "the picture of the calibration is not there", file=path, fix="calibrate again"
        )
    data = path.read_bytes()
    if len(data) > LARGEST_BYTES:
        raise StrandcastError(
            "SC-H032", f"the picture has {len(data) / 1e6:.1f} MB, too much for a page", file=path
        )
    finding = _finding(camera)
    alt = f"The photo of the plane with its markers, residual arrows and the metric grid. {finding}"
    markup = Markup('<img class="wide" alt="{}" src="data:image/webp;base64,{}">').format(
        alt, base64.b64encode(data).decode()
    )
    return Reportlet(
        key,
        title,
        finding,
        "Good: the grid lies on what was measured (markers, a ruler, the arm's base at 0, 0), the arrows "
        "point anywhere. Bad: the grid leans or is stretched (a marker's place, the lens), one marker has "
        "long arrows.",
        markup,
        [each for each in (_source_table(camera), _model_table(camera), _warning_table(camera)) if each.rows],
        [PICTURE, RECORD],
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
    return Table(["what is not known", "standard error at the worst place [mm]"], rows)


def _model_table(camera: Camera) -> Table:
    lens = camera.lens
    rows = [
        [
            trial.model,
            f"{trial.held_out_px:.4f}" if trial.held_out_px is not None else f"out: {trial.reason}",
            "yes" if trial.model == lens.model else "no",
        ]
        for trial in lens.models
    ]
    return Table(["lens model", "residual over photos held out [px]", "chosen"], rows, _coverage_words(lens))


def _coverage_words(lens: Lens) -> str:
    seen = lens.coverage
    if seen is None:
        return ""
    return (
        f"The board's corners cover {seen.share:.0%} of the picture; two boards lean by up to "
        f"{np.degrees(seen.tilt_spread_rad):.0f}° against each other."
    )


def _warning_table(camera: Camera) -> Table:
    return Table(["warning"], [[words] for words in [*camera.lens.warnings, *camera.warnings]])
