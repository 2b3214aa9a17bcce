"""The throw at about eleven instants, in metres: Figs. 7, 9 and 10 of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.patches import Circle
from numpy.typing import NDArray

from strandcast.errors import StrandcastError
from strandcast.report.drawing import FITTED, MEASURED, PAGE, TARGET, legend_below, new_figure, to_svg
from strandcast.report.measures import closest_row, matched, strobe_rows
from strandcast.report.numbers import millimetres, place
from strandcast.report.reportlet import Reportlet, Table
from strandcast.report.results import Results

Array = NDArray[np.float64]


def strobe(key: str, title: str, results: Results, previous: Results | None) -> Reportlet:
    """Return this throw's strobe figure, and the throw before it beside it if it is given and can be read."""
    shown, note = [results], ""
    if previous is not None:
        try:
            strobe_rows(previous)
            shown.insert(0, previous)
        except StrandcastError as problem:
            note = f" The throw before it is not shown: {problem.what}."
    wide = len(shown) == 2
    limits = _limits(shown)
    # Two panels share the width; a tall one is kept from filling more than a screen.
    scale = (4.55 if wide else 9.0) / (limits[1] - limits[0])
    height = 1.3 + min(scale * (limits[3] - limits[2]), 5.5)
    figure = new_figure(10.0, height, left=0.07, top=1 - 0.3 / height, bottom=0.9 / height, wspace=0.12)
    for column, each in enumerate(shown):
        axes = figure.add_subplot(1, len(shown), column + 1)
        _draw(axes, each, limits)
        if column == 0:
            axes.set_ylabel("y [m]")
    legend_below(figure, figure.axes[-1])
    verdict = results.need("verdict")
    error_m = _fit_error(results)
    finding = f"{len(strobe_rows(results))} instants at equal arc length of the tip's path; " + (
        f"the closest approach ({millimetres(verdict.miss_m)} from the target at {place(verdict.target_m)}) "
        "is bold."
        if verdict.miss_m is not None
        else f"the closest approach to the target at {place(verdict.target_m)} was not seen."
    )
    if error_m is not None:
        finding += f" Over these instants the fitted string lies {millimetres(error_m)} from the measured."
    return Reportlet(
        key,
        title,
        finding + note,
        "Good: the dashed string covers the solid one at every instant. Bad: they part towards the tip "
        "(stiffness, masses or air), or from the hand on (alignment, servo or clamp).",
        to_svg(figure, key, f"Strobe figure of the throw. {finding}"),
        [_instants(shown)],
        ["track.parquet", "simulated.parquet", "alignment.json"],
    )


def _instants(shown: list[Results]) -> Table:
    rows = []
    for each in shown:
        since_s = each.robot_time_s()[strobe_rows(each)] - each.need("alignment").motion_start_s
        rows.append([f"trial {each.need('verdict').trial}", *(f"{time_s * 1e3:.0f}" for time_s in since_s)])
    count = max(map(len, rows))
    rows = [row + [""] * (count - len(row)) for row in rows]
    return Table(["instant", *map(str, range(1, count))], rows, "Time from the motion's start [ms].")


def _limits(shown: list[Results]) -> tuple[float, float, float, float]:
    places = [each.need("track").points_m[strobe_rows(each)].reshape(-1, 2) for each in shown]
    target_m = np.array([shown[-1].need("verdict").target_m])
    every = np.concatenate([*places, target_m, [[0.0, 0.0]]])
    low, high = np.nanmin(every, axis=0) - 0.06, np.nanmax(every, axis=0) + 0.06
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _draw(axes: Any, results: Results, limits: tuple[float, float, float, float]) -> None:
    track, verdict = results.need("track"), results.need("verdict")
    throw = (results.get("simulated") or {}).get("fitted")
    rows, closest = strobe_rows(results), closest_row(results)
    named = "simulated, fitted"  # in the legend, once
    for k, row in enumerate(rows):
        bold = row == closest
        strength = 1.0 if bold else 0.75
        string_m = track.points_m[row]
        axes.plot(
            *string_m.T,
            **(MEASURED | {"linewidth": 2.6 if bold else 1.1}),
            alpha=strength,
            marker="o",
            markersize=2.4,
            label="measured" if k == 0 else None,
        )
        if throw is not None and track.frame[row] in throw.frame:
            model_m = throw.points_m[np.searchsorted(throw.frame, track.frame[row])]
            axes.plot(*model_m.T, **FITTED, alpha=strength, label=named)
            named = "_simulated"
        _label(axes, string_m, f"{k + 1}", bold)
    hand_m = track.points_m[rows, 0]
    axes.plot(*hand_m.T, linestyle="none", marker="s", markersize=4.5, color="#e69f00", label="hand")
    axes.add_patch(Circle(verdict.target_m, verdict.hit_radius_m, facecolor="none", edgecolor=TARGET, lw=2.0))
    if verdict.bar_m is not None:
        axes.plot(*np.array(verdict.bar_m).T, color=TARGET, linewidth=3.0, label="bar")
    axes.plot(*verdict.target_m, linestyle="none", marker="+", color=TARGET, markersize=9, label="target")
    axes.set(xlim=limits[:2], ylim=limits[2:], aspect="equal", xlabel="x [m]")
    axes.set_title(f"trial {verdict.trial}: miss {millimetres(verdict.miss_m, verdict.miss_sigma_m)}")


def _label(axes: Any, string_m: Array, text: str, bold: bool) -> None:
    """Write beside the tip, on the side that the string does not come from."""
    seen_m = string_m[np.isfinite(string_m).all(axis=1)]
    if len(seen_m) < 2:
        return
    way = seen_m[-1] - seen_m[-2]
    way = way / max(float(np.linalg.norm(way)), 1e-9)
    axes.annotate(
        text,
        seen_m[-1],
        xytext=way * 9,
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=8.5 if bold else 7.5,
        fontweight="bold" if bold else "normal",
        bbox={"boxstyle": "round,pad=0.1", "facecolor": PAGE, "edgecolor": "none", "alpha": 0.7},
    )


def _fit_error(results: Results) -> float | None:
    throw = (results.get("simulated") or {}).get("fitted")
    if throw is None:
        return None
    mine, theirs = matched(results, throw)
    chosen = np.isin(mine, strobe_rows(results))
    if not chosen.any():
        return None
    apart = results.need("track").points_m[mine[chosen], 1:] - throw.points_m[theirs[chosen], 1:]
    return float(np.nanmean(np.linalg.norm(apart, axis=2)))
