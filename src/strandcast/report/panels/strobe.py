"""The throw against its simulation, in metres: strobe figures and the tip's path (Figs. 7 to 10)."""

from typing import Any

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.verdict import Verdict
from strandcast.report import drawing as draw
from strandcast.report.measures import (
    closest_row,
    fit_window,
    fitted_rows,
    strobe_rows,
    target_distance_m,
    tip_error_m,
)
from strandcast.report.numbers import millimetres, milliseconds, place
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import Array, TrialResults
from strandcast.report.text import miss_in_words

LABEL_GAP = 0.05  # between labelled instants, as a fraction of the path's extent: labels do not overlap
STYLES = {"planned": draw.PLANNED, "predicted": draw.PLANNED, "fitted": draw.FITTED}
NAMES = {
    "planned": "simulated, as planned",
    "predicted": "predicted by the fit before",
    "fitted": "simulated, fitted",
}


def strobe(page: TrialPageData) -> PanelContent:
    """Return the strobe figure of this throw, beside that of the previous throw if there is one."""
    results, previous = page.results, page.previous
    shown, not_shown = [results], ""
    if previous is not None:
        try:
            strobe_rows(previous)
            shown.insert(0, previous)
        except StrandcastError as problem:
            not_shown = f" The previous throw is not shown: {problem.what}."
    wide = len(shown) == 2
    limits = _limits(shown)
    # Two panels share the width; a tall one is kept from filling more than a screen.
    scale = (4.55 if wide else 9.0) / (limits[1] - limits[0])
    height = 1.3 + min(scale * (limits[3] - limits[2]), 5.5)
    figure = draw.new_figure(10.0, height, left=0.07, top=1 - 0.3 / height, bottom=0.9 / height, wspace=0.12)
    for column, each in enumerate(shown):
        axes = figure.add_subplot(1, len(shown), column + 1)
        _draw(axes, each, limits)
        if column == 0:
            axes.set_ylabel("y [m]")
    draw.legend_below(figure, figure.axes[-1])
    verdict = results.need("verdict")
    finding = f"{len(strobe_rows(results))} instants at equal arc length of the tip's path" + (
        "."
        if verdict.target_m is None
        else f"; the closest approach ({miss_in_words(verdict)}) is bold."
        if verdict.miss_m is not None
        else f"; the closest approach to the target at {place(verdict.target_m)} was not detected."
    )
    return PanelContent(
        finding + not_shown,
        draw.Drawing(figure, f"Strobe figure of the throw. {finding}"),
        [_instants(shown)],
        ["track.parquet", "simulated.parquet", "alignment.json"],
        title=None if results.aimed() else "The string at equal steps of the tip’s path",
    )


def _instants(shown: list[TrialResults]) -> Table:
    rows = []
    for each in shown:
        since_s = each.robot_time_s()[strobe_rows(each)] - each.need("alignment").motion_start_s
        rows.append([f"trial {each.need('verdict').trial}", *(f"{time_s * 1e3:.0f}" for time_s in since_s)])
    count = max(map(len, rows))
    rows = [row + [""] * (count - len(row)) for row in rows]
    return Table(["instant", *map(str, range(1, count))], rows, "Time from the motion's start [ms].")


def _limits(shown: list[TrialResults]) -> tuple[float, float, float, float]:
    places = [each.need("track").points_m[strobe_rows(each)].reshape(-1, 2) for each in shown]
    verdict = shown[-1].need("verdict")
    marked = [] if verdict.target_m is None else [np.array([verdict.target_m]), np.zeros((1, 2))]
    every = np.concatenate([*places, *marked])
    low, high = np.nanmin(every, axis=0) - 0.06, np.nanmax(every, axis=0) + 0.06
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _draw(axes: Any, results: TrialResults, limits: tuple[float, float, float, float]) -> None:
    track, verdict = results.need("track"), results.need("verdict")
    throw = (results.get("simulated") or {}).get("fitted")
    rows, closest = strobe_rows(results), closest_row(results)
    named = "simulated, fitted"  # in the legend, once
    for k, row in enumerate(rows):
        bold = row == closest
        strength = 1.0 if bold else 0.75
        string_m = track.points_m[row]
        dots = {"linewidth": 2.6 if bold else 1.1, "marker": "o", "markersize": 2.4, "alpha": strength}
        axes.plot(*string_m.T, **(draw.MEASURED | dots), label="measured" if k == 0 else None)
        if throw is not None and track.frame[row] in throw.frame:
            axes.plot(*throw.at(track.frame[row]).T, **draw.FITTED, alpha=strength, label=named)
            named = "_simulated"
        _label(axes, string_m, f"{k + 1}", bold)
    hand_m = track.points_m[rows, 0]
    axes.plot(*hand_m.T, **draw.marks("s", 4.5, color=draw.HAND), label="hand")
    if results.aimed():
        draw_target(axes, verdict)
    axes.set(xlim=limits[:2], ylim=limits[2:], aspect="equal", xlabel="x [m]")
    miss = f": miss {millimetres(verdict.miss_m, verdict.miss_sigma_m)}" if results.aimed() else ""
    axes.set_title(f"trial {verdict.trial}{miss}")


def _label(axes: Any, string_m: Array, text: str, bold: bool) -> None:
    """Write a label beyond the tip, in the direction of the string's end."""
    measured_m = string_m[np.isfinite(string_m).all(axis=1)]
    if len(measured_m) < 2:
        return
    direction = measured_m[-1] - measured_m[-2]
    direction = direction / max(float(np.linalg.norm(direction)), 1e-9)
    font = {"fontsize": 8.5, "fontweight": "bold"} if bold else {"fontsize": 7.5, "fontweight": "normal"}
    box = {"boxstyle": "round,pad=0.1", "facecolor": draw.PAGE, "edgecolor": "none", "alpha": 0.7}
    draw.note(axes, text, measured_m[-1], direction * 9, ha="center", va="center", bbox=box, **font)


def tip_path(page: TrialPageData) -> PanelContent:
    """Return the tip's paths with equal axes; below them its distances to target and simulation."""
    results = page.results
    track, verdict = results.need("track"), results.need("verdict")
    start_s = results.need("alignment").motion_start_s
    throws = results.need("simulated")
    figure = draw.new_figure(8.4, 9.2, left=0.1, top=0.98, bottom=0.1)
    rows = 3 if results.aimed() else 2
    grid = figure.add_gridspec(rows, 1, height_ratios=[2.6, *[1] * (rows - 1)], hspace=0.3)
    path_axes, *over_time = (figure.add_subplot(grid[k]) for k in range(rows))
    error_axes = over_time[-1]
    window = results.in_window()
    tip_m, time_s = track.points_m[window, -1], results.robot_time_s()[window]
    _draw_path(path_axes, tip_m, time_s - start_s)
    if results.aimed():
        _draw_miss(over_time[0], (time_s - start_s) * 1e3, target_distance_m(verdict, tip_m) * 1e3, verdict)
        if verdict.miss_m is not None and verdict.closest_robot_time_s is not None:
            # The closest approach may lie between two frames.
            closest = ((verdict.closest_robot_time_s - start_s) * 1e3, verdict.miss_m * 1e3)
            over_time[0].plot(*closest, **draw.marks("D", 5, color=draw.MEASURED["color"]))
    fitted_s = results.robot_time_s()[fitted_rows(results) & track.detected()[:, -1]]
    findings, means_m = [], []
    for name, throw in throws.items():
        inside = np.isin(throw.frame, track.frame[window])
        path_axes.plot(*throw.points_m[inside, -1].T, **STYLES[name], label=NAMES[name])
        at_s, apart_m = tip_error_m(results, throw)
        in_time = (at_s >= start_s) & (at_s <= results.window_s()[1])
        at_s, apart_m = at_s[in_time], apart_m[in_time]
        error_axes.plot((at_s - start_s) * 1e3, apart_m * 1e3, **(STYLES[name] | {"linewidth": 1.1}))
        counted_m = np.where(np.isin(at_s, fitted_s), apart_m, np.nan)
        if np.isfinite(counted_m).any():
            mean_m, worst = float(np.nanmean(counted_m)), int(np.nanargmax(counted_m))
            means_m.append(mean_m)
            findings.append(
                f"{NAMES[name]}: {millimetres(mean_m)} from the measured tip on average, at most "
                f"{millimetres(counted_m[worst])} at {milliseconds(at_s[worst] - start_s, digits=0)}"
            )
    error_axes.set(xlabel=draw.SINCE_START, ylabel="tip – simulated [mm]", ylim=(0, None))
    if draw.log_if_wide(error_axes, "y", means_m):
        error_axes.autoscale(axis="y")
    if results.aimed():
        draw_target(path_axes, verdict)
    for axes in over_time:
        axes.set_xlim((time_s[0] - start_s) * 1e3, (time_s[-1] - start_s) * 1e3)
        mark_closest(axes, verdict, start_s)
    draw.legend_below(figure, path_axes)
    finding = "There is no simulated tip to compare with."
    if findings:
        finding = f"Over the {fit_window(results)}: {'; '.join(findings)}."
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Tip path measured and simulated. {finding}", tuple(over_time)),
        sources=["track.parquet", "simulated.parquet"],
        caption=None if results.aimed() else "Squares mark every 50 ms of the measured path.",
        good=None
        if results.aimed()
        else "the fitted path covers the measured one, and the tip stays as near to the simulated one as the "
        "tracker’s σ.",
    )


def _draw_path(axes: Any, tip_m: Any, since_start_s: Any) -> None:
    axes.plot(*tip_m.T, **draw.MEASURED, label="measured")
    marked_s = np.arange(0.0, since_start_s[-1] if len(since_start_s) else 0.0, 0.05)
    rows = np.searchsorted(since_start_s, marked_s).clip(0, max(len(tip_m) - 1, 0))
    axes.plot(*tip_m[rows].T, **draw.marks("s", 3, color=draw.MEASURED["color"]))
    draw.equal_axes(axes)
    least_m = LABEL_GAP * np.ptp(axes.dataLim.get_points(), axis=0).max()
    labelled_m = np.empty((0, 2))
    for mark, row in zip(marked_s, rows, strict=True):
        far = (np.linalg.norm(labelled_m - tip_m[row], axis=1) > least_m).all()
        if round(mark * 1e3) % 100 == 0 and np.isfinite(tip_m[row]).all() and far:
            draw.note(axes, f"{mark * 1e3:.0f} ms", tip_m[row], (5, 4), fontsize=7.5)
            labelled_m = np.vstack([labelled_m, tip_m[row]])


def _draw_miss(axes: Any, since_ms: Any, miss_mm: Any, verdict: Verdict) -> None:
    """Draw the distance of the tip from the target over time, and the closest approach."""
    axes.plot(since_ms, miss_mm, **draw.MEASURED)
    axes.axhline(verdict.hit_radius_m * 1e3, **draw.HIT_RADIUS)
    axes.set(ylabel="tip – target [mm]", ylim=(0, None))
    nearest_mm = None if verdict.miss_m is None else verdict.miss_m * 1e3
    draw.log_if_wide(axes, "y", [*miss_mm[np.isfinite(miss_mm)], verdict.hit_radius_m * 1e3, nearest_mm])
    right = {"xycoords": ("axes fraction", "data"), "ha": "right", "fontsize": 8}
    draw.note(axes, "hit radius", (1.0, verdict.hit_radius_m * 1e3), (-3, 3), **right)


def draw_target(axes: Any, verdict: Verdict) -> None:
    """Draw the target or the bar, and the hit radius."""
    draw.ring(axes, verdict.target(), verdict.hit_radius_m)
    if verdict.bar_m is not None:
        axes.plot(*np.array(verdict.bar_m).T, color=draw.TARGET, linewidth=3.0, label="bar")
    axes.plot(*verdict.target(), **draw.marks("+", 9, color=draw.TARGET), label="target")


def mark_closest(axes: Any, verdict: Verdict, start_s: float) -> None:
    """Draw a line at the closest approach."""
    if verdict.closest_robot_time_s is not None:
        at_ms = (verdict.closest_robot_time_s - start_s) * 1e3
        axes.axvline(at_ms, color=draw.INK, linewidth=0.8, linestyle=(0, (2, 2)))
        first, last = axes.get_xlim()
        right = at_ms < first + 0.7 * (last - first)
        top = {"xycoords": ("data", "axes fraction"), "va": "top", "fontsize": 8}
        side = "left" if right else "right"
        draw.note(axes, "closest approach", (at_ms, 1.0), (4 if right else -4, -2), ha=side, **top)
