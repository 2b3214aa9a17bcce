"""The distance of the measured string from the fitted one, by point and in time."""

import numpy as np
from matplotlib.colors import LogNorm

from strandcast.errors import StrandcastError
from strandcast.report.drawing import INK, PAGE, SINCE_START, Drawing, new_figure
from strandcast.report.measures import fit_errors_m, fit_window, fitted_rows
from strandcast.report.numbers import millimetres, milliseconds
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.tracking import kymograph
from strandcast.report.results import FILES


def fit_error(page: TrialPageData) -> PanelContent:
    """Return an image of the distances; lines bound the frames of the fit."""
    results = page.results
    throw = results.need("simulated").get("fitted")
    if throw is None:
        raise StrandcastError(
            "SC-W030", "there is no fitted throw", file=FILES["simulated"], fix="estimate the trial again"
        )
    mine, apart_m = fit_errors_m(results, throw)
    apart_m = apart_m[:, 1:]
    start_s = results.need("alignment").motion_start_s
    since_ms = (results.robot_time_s()[mine] - start_s) * 1e3
    figure = new_figure(10.0, 2.8, left=0.07, right=1.0, top=0.96, bottom=0.17)
    axes = figure.add_subplot()
    extent = (float(since_ms[0]), float(since_ms[-1]))
    shown_mm = np.where(apart_m > 0, apart_m, np.nan).T * 1e3
    kymograph(axes, shown_mm, extent, "distance [mm]", first=1, norm=LogNorm(0.3, 30.0), cmap="cividis")
    axes.set(xlabel=SINCE_START, ylabel="point")
    window_s = results.need("estimate").window_s or (start_s, start_s)
    for edge_s in window_s:
        at_ms = (edge_s - start_s) * 1e3
        # Dashes stand out from dark and bright cells.
        axes.axvline(at_ms, color=PAGE, linewidth=2.6, alpha=0.8)
        axes.axvline(at_ms, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
    counted = fitted_rows(results)[mine]
    detected = results.need("track").detected()[mine, 1:]
    inside = np.where(detected, apart_m, np.nan)[counted]
    finding = "No point was measured in the frames of the fit."
    if np.isfinite(inside).any():
        row, point = np.unravel_index(int(np.nanargmax(inside)), inside.shape)
        worst_ms = since_ms[counted][row]
        finding = (
            f"Within the {fit_window(results)}, the fitted string is at most "
            f"{millimetres(inside[row, point])} from the measured one: point {point + 1} at "
            f"{milliseconds(worst_ms / 1e3, digits=0)}."
        )
    return PanelContent(
        finding,
        Drawing(figure, f"Distance of the measured from the fitted string. {finding}", (axes,)),
        sources=["track.parquet", "simulated.parquet", "estimate.json"],
    )
