"""The throw at about eleven instants, in metres: Figs. 7, 9 and 10 of the paper."""

from typing import Any

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.report import drawing as draw
from strandcast.report.measures import closest_row, strobe_rows
from strandcast.report.numbers import millimetres, place
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.tip_path import draw_target
from strandcast.report.results import Array, TrialResults
from strandcast.report.text import miss_in_words


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
