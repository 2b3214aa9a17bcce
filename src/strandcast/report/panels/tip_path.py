"""The tip's path, measured and simulated (Fig. 8a of the paper), and their distance in time."""

from typing import Any

import numpy as np

from strandcast.report import drawing as draw
from strandcast.report.measures import rms, tip_error_m
from strandcast.report.numbers import millimetres, milliseconds
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.page_data import TrialPageData

STYLES = {"planned": draw.PLANNED, "fitted": draw.FITTED}
NAMES = {"planned": "Simulated, as planned", "fitted": "Simulated, fitted"}


def tip_path(page: TrialPageData) -> PanelContent:
    """Return the tip's paths with equal axes, and the residual d(t) below them."""
    results = page.results
    track, verdict = results.need("track"), results.need("verdict")
    start_s = results.need("alignment").motion_start_s
    throws = results.need("simulated")
    figure = draw.new_figure(8.4, 7.4, left=0.1, top=0.97, bottom=0.12, hspace=0.24)
    path_axes, error_axes = figure.subplots(2, 1, height_ratios=[2.6, 1])
    window = results.in_window()
    tip_m, time_s = track.points_m[window, -1], results.robot_time_s()[window]
    _draw_path(path_axes, tip_m, time_s - start_s)
    findings = []
    for name, throw in throws.items():
        inside = np.isin(throw.frame, track.frame[window])
        path_axes.plot(*throw.points_m[inside, -1].T, **STYLES[name], label=NAMES[name])
        at_s, apart_m = tip_error_m(results, throw)
        in_time = (at_s >= start_s) & (at_s <= results.window_s()[1])
        at_s, apart_m = at_s[in_time], apart_m[in_time]
        error_axes.plot((at_s - start_s) * 1e3, apart_m * 1e3, **(STYLES[name] | {"linewidth": 1.1}))
        if np.isfinite(apart_m).any():
            worst = int(np.nanargmax(apart_m))
            findings.append(
                f"{NAMES[name]}: {millimetres(rms(apart_m))} rms from the measured tip, at most "
                f"{millimetres(apart_m[worst])} at {milliseconds(at_s[worst] - start_s, digits=0)}"
            )
    _draw_target(path_axes, error_axes, verdict, start_s)
    draw.legend_below(figure, path_axes)
    finding = "; ".join(findings) + "." if findings else "There is no simulated tip to compare with."
    return PanelContent(
        finding,
        "Squares mark every 50 ms of the measured path. Good: the fitted path covers the measured one up "
        "to the closest approach and d(t) stays at the tracker's σ. Bad: d(t) grows steadily (parameters), "
        "jumps (a lost tip), or swings with the speed (alignment: 1 ms is 10 mm at 10 m/s).",
        draw.Drawing(figure, f"Tip path measured and simulated. {finding}"),
        sources=["track.parquet", "simulated.parquet"],
    )


def _draw_path(axes: Any, tip_m: Any, since_start_s: Any) -> None:
    axes.plot(*tip_m.T, **draw.MEASURED, label="Measured")
    marked_s = np.arange(0.0, since_start_s[-1] if len(since_start_s) else 0.0, 0.05)
    rows = np.searchsorted(since_start_s, marked_s).clip(0, max(len(tip_m) - 1, 0))
    axes.plot(*tip_m[rows].T, **draw.marks("s", 3, color=draw.MEASURED["color"]))
    for mark, row in zip(marked_s, rows, strict=True):
        if round(mark * 1e3) % 100 == 0 and np.isfinite(tip_m[row]).all():
            draw.note(axes, f"{mark * 1e3:.0f} ms", tip_m[row], (5, 4), fontsize=7.5)
    draw.equal_axes(axes)


def _draw_target(path_axes: Any, error_axes: Any, verdict: Any, start_s: float) -> None:
    draw.ring(path_axes, verdict.target_m, verdict.hit_radius_m)
    if verdict.bar_m is not None:
        path_axes.plot(*np.array(verdict.bar_m).T, color=draw.TARGET, linewidth=3.0, label="Bar")
    path_axes.plot(*verdict.target_m, **draw.marks("+", 9, color=draw.TARGET), label="Target")
    error_axes.set(xlabel=draw.SINCE_START, ylabel="tip, d [mm]", ylim=(0, None))
    if verdict.closest_robot_time_s is not None:
        at_ms = (verdict.closest_robot_time_s - start_s) * 1e3
        error_axes.axvline(at_ms, color=draw.INK, linewidth=0.8, linestyle=(0, (2, 2)))
        top = {"xycoords": ("data", "axes fraction"), "va": "top", "fontsize": 8}
        draw.note(error_axes, "closest approach", (at_ms, 1.0), (4, -2), **top)
