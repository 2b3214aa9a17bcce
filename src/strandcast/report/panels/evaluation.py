"""How well the string fits: E by point, the convergence of the search, and the distances in time."""

import numpy as np
from matplotlib.colors import LogNorm

from strandcast.errors import StrandcastError
from strandcast.records.estimate import UNDER_PREVIOUS, Estimate, ForceTried
from strandcast.report import drawing as draw
from strandcast.report.measures import GUESSES, fit_errors_m, fit_window, fitted_rows
from strandcast.report.numbers import millimetres, milliseconds
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.tracking import kymograph
from strandcast.report.results import FILES
from strandcast.report.text import capture_finding

CAPTURE_CAPTION = (
    "E is the mean distance between measured and simulated points, E_i that of point i (eqs. 4–6). The "
    "curve is for all trials in the fit, with w; green dash-dot: this trial alone under the string fitted to "
    "the trials before it, w = 0."
)


def evaluation(page: TrialPageData) -> PanelContent:
    """Return E_i (eq. 5) along the string and the convergence of the search."""
    results = page.results
    estimate: Estimate = results.need("estimate")
    figure = draw.new_figure(10.0, 3.6, top=0.9, bottom=0.15, wspace=0.22)
    bars, curve = figure.subplots(1, 2)
    places_mm = np.arange(1, estimate.points + 1) * estimate.length_m / estimate.points * 1e3
    if results.in_space():  # E is of the markers, which lie between the mass points
        places_mm = 1e3 * results.need("track_summary").places_m()[1:]
    errors_mm = np.array([np.nan if e is None else e * 1e3 for e in estimate.E_points_m])
    width_mm = 0.7 * np.diff(places_mm, prepend=0.0).min()
    bars.bar(places_mm, errors_mm, max(width_mm, 1.0), color=draw.MEASURED["color"])
    bars.axhline(estimate.E_m * 1e3, **draw.dashes(draw.FITTED, linewidth=1.5))
    left = {"xycoords": ("axes fraction", "data"), "fontsize": 8.5}
    draw.note(bars, f"E {estimate.E_m * 1e3:.2f} mm", (0.0, estimate.E_m * 1e3), (4, 3), **left)
    bars.set(xlabel=draw.ALONG_STRING, ylabel="mean distance E_i [mm]")
    bars.set_title("by point, after the fit")
    steps = [step.evaluations for step in estimate.convergence]
    best_mm = [step.best_m * 1e3 for step in estimate.convergence]
    curve.step(steps, best_mm, where="post", **draw.MEASURED)
    curve.set(xlabel="simulations", ylabel="best E so far [mm]")
    aimed = results.aimed()
    before_m = estimate.E_planned_m if aimed else estimate.held_out_m(UNDER_PREVIOUS)
    draw.log_if_wide(curve, "y", [*best_mm, 1e3 * (before_m or estimate.E_m)], ratio=1.5)
    if before_m is not None:
        curve.axhline(before_m * 1e3, **draw.dashes(draw.PLANNED))
    curve.set_title(f"search: {estimate.search}, {estimate.evaluations} simulations")
    window = fit_window(results)
    finding = _finding(estimate, window) if aimed else capture_finding(estimate, window)
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Evaluation value by point and convergence. {finding}"),
        [_table(estimate, window, aimed)],
        ["estimate.json"],
        caption=None if aimed else CAPTURE_CAPTION,
    )


def _finding(estimate: Estimate, window: str) -> str:
    after = f"E {millimetres(estimate.E_m, digits=2)} after the fit, over {window}"
    if estimate.E_planned_m is None:
        return f"{after}; this throw was planned without a fitted string, so there is no E before the fit."
    ratio = estimate.E_planned_m / max(estimate.E_m, 1e-12)
    return f"{after}; {millimetres(estimate.E_planned_m, digits=2)} before it: {ratio:.1f} times better."


def _held_out(what: str, aimed: bool) -> str:
    """Return in words what is compared; the records call every trial a throw."""
    words = what if what in GUESSES else f"held out: {what}"
    return words if aimed else words.replace("throw", "trial")


def _tried(force: ForceTried) -> str:
    """Return in words what an optional force is worth."""
    kept = "kept" if force.kept else "left out"
    if force.cost_m is None:
        return f"{kept}, as in the estimate before"
    if force.held_out_m is None or force.gain_sd_m is None:
        return f"{kept}: the cost falls by {1.0 - force.cost_m[1] / force.cost_m[0]:.1%}"
    before, after, sd = (millimetres(m, digits=2) for m in (*force.held_out_m, force.gain_sd_m))
    return f"{kept}: E of what was not fitted {before} without, {after} with it, ± {sd}"


def _table(estimate: Estimate, window: str, aimed: bool) -> Table:
    planned = "E of this trial with the parameters that planned it (w = 0)"
    simulations = "simulations; of these rejected (diverged or overstretched)"
    rows = [
        *([[planned, millimetres(estimate.E_planned_m, digits=2)]] if aimed else []),
        ["E of this trial after the fit (w = 0)", millimetres(estimate.E_m, digits=2)],
        [f"E after the fit, weighted (w = {estimate.w:g})", millimetres(estimate.E_weighted_m, digits=2)],
        ["rms distance over points and frames", millimetres(estimate.rmse_m, digits=2)],
        ["mean distance of the tip", millimetres(estimate.tip_error_m, digits=2)],
        ["frames in all of these", window],
        *([_held_out(held.what, aimed), millimetres(held.E_m, digits=2)] for held in estimate.held_out),
        [simulations, f"{estimate.evaluations}; {estimate.rejected}"],
        ["the search converged", {None: "not known", True: "yes", False: "no"}[estimate.converged]],
        ["trials in the fit", ", ".join(map(str, estimate.trials_used))],
        *([f"tried: {tried.words}", _tried(tried)] for tried in estimate.forces),
        *([] if (read := estimate.fitted_in_words()) is None else [["read by the fit", read]]),
    ]
    caption = (
        "E is a weighted mean distance: points with a large σ or flagged as unsure count less, hidden and "
        "predicted ones not at all. In the rms and in the mean of the tip every measured "
        "point counts the same."
    )
    return Table(["quantity", "value"], rows, caption)


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
    figure = draw.new_figure(10.0, 2.8, left=0.07, right=1.0, top=0.96, bottom=0.17)
    axes = figure.add_subplot()
    extent = (float(since_ms[0]), float(since_ms[-1]))
    shown_mm = np.where(apart_m > 0, apart_m, np.nan).T * 1e3
    kymograph(axes, shown_mm, extent, "distance [mm]", first=1, norm=LogNorm(0.3, 30.0), cmap="cividis")
    axes.set(xlabel=draw.SINCE_START, ylabel="point")
    window_s = results.need("estimate").window_s or (start_s, start_s)
    for edge_s in window_s:
        at_ms = (edge_s - start_s) * 1e3
        # Dashes stand out from dark and bright cells.
        axes.axvline(at_ms, color=draw.PAGE, linewidth=2.6, alpha=0.8)
        axes.axvline(at_ms, color=draw.INK, linewidth=1.0, linestyle=(0, (4, 2)))
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
        draw.Drawing(figure, f"Distance of the measured from the fitted string. {finding}", (axes,)),
        sources=["track.parquet", "simulated.parquet", "estimate.json"],
    )
