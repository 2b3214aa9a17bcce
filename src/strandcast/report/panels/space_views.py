"""A string in space: two views at right angles, and one that can be turned where scripts run."""

from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from strandcast.core.interpolation import resampled
from strandcast.records.verdict import Verdict
from strandcast.report import drawing as draw
from strandcast.report.measures import fit_errors_m, fit_window, fitted_rows, strobe_rows
from strandcast.report.numbers import millimetres
from strandcast.report.pages import render
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.viewer import in_base64, whole_steps
from strandcast.report.results import Array, SimulatedThrow, TrialResults

INSTANTS = 7  # of a string that moves through space; more would hide each other
MOST_FRAMES = 240  # of the view that can be turned: its page stays below a megabyte
STEP_M = 1e-4  # of its places


def two_views(page: TrialPageData) -> PanelContent:
    """Return the string at some instants, seen along y and along x."""
    results = page.results
    track, throws = results.need("track"), results.get("simulated") or {}
    rows = strobe_rows(results, INSTANTS)
    string = throws.get("string")
    verdict = results.get("verdict")
    aims_m = [verdict.target_m] if verdict is not None and verdict.target_m is not None else []
    every_m = np.vstack([track.points_m.reshape(-1, 3), *aims_m])
    low, high = (reduce(every_m, axis=0) for reduce in (np.nanmin, np.nanmax))
    middle_m, reach_m = 0.5 * (low + high), 0.53 * float((high - low).max())
    figure = draw.new_figure(10.0, 5.6, left=0.07, top=0.97, bottom=0.18, wspace=0.1)
    shown = figure.subplots(1, 2, sharey=True)
    for axes, seen in zip(shown, draw.views(3), strict=True):
        axes.plot(*track.points_m[:, -1][:, seen].T, **(draw.MEASURED | {"linewidth": 0.6, "alpha": 0.6}))
        for k, row in enumerate(rows):
            frame = track.frame[row]
            string_m = string.at(frame)[:, seen] if string is not None and frame in string.frame else None
            _draw_instant(axes, track.points_m[row][:, seen], string_m, named=k == 0)
        for end_m in _ends(results, rows):
            axes.plot(*end_m[:, seen].T, **draw.marks("s", 4.5, color=draw.HAND))
        axes.plot([], [], **draw.marks("s", 4.5, color=draw.HAND), label="driven end")
        _draw_aim(axes, verdict, seen)
        limits = middle_m[seen[0]] - reach_m, middle_m[seen[0]] + reach_m
        axes.set(xlabel=f"{'xy'[seen[0]]} [m]", xlim=limits, aspect="equal")
    shown[0].set(ylabel="z [m], up", ylim=(middle_m[2] - reach_m, middle_m[2] + reach_m))
    draw.legend_below(figure, shown[0])
    finding = f"{len(rows)} instants at equal steps of the last marker’s path"
    error_m = _mean_distance(results, throws.get("fitted"))
    if error_m is not None:
        window = fit_window(results)
        finding += f"; over the {window} the fitted markers are {millimetres(error_m)} off on average"
    finding += "."
    return PanelContent(
        finding,
        draw.Drawing(figure, f"The string from two sides. {finding}"),
        sources=["track.parquet", "simulated.parquet", "hand.parquet"],
    )


def turnable(page: TrialPageData) -> PanelContent:
    """Return a view of all frames that can be turned; where scripts do not run, the two views stand alone."""
    results = page.results
    track, throws = results.need("track"), results.need("simulated")
    rows = np.arange(0, len(track.frame), max(-(-len(track.frame) // MOST_FRAMES), 1))
    since_s = results.robot_time_s()[rows] - results.need("alignment").motion_start_s
    every_m = track.points_m.reshape(-1, 3)
    centre_m = 0.5 * (np.nanmin(every_m, axis=0) + np.nanmax(every_m, axis=0))
    lines = {"measured": track.points_m[rows]}
    for name, source in (("fitted", "string"), ("predicted", "predicted_string")):
        if source in throws:
            lines[name] = throws[source].at(track.frame[rows])
    reach_m = max(float(np.nanmax(np.linalg.norm(each - centre_m, axis=-1))) for each in lines.values())
    markup = render(
        "turnable.html.jinja",
        points={name: each.shape[1] for name, each in lines.items()},
        places={name: whole_steps((each - centre_m) / STEP_M) for name, each in lines.items()},
        times=in_base64((1e3 * since_s).astype("<f4")),
        frames=len(rows),
        step_m=STEP_M,
        reach_m=reach_m,
    )
    seconds = since_s[-1] - since_s[0]
    finding = f"{len(rows)} of {len(track.frame)} frames over {seconds:.1f} s."
    return PanelContent(finding, Markup(markup), sources=["track.parquet", "simulated.parquet"])


def _draw_aim(axes: Any, verdict: Verdict | None, seen: list[int]) -> None:
    """Draw the target and the closest approach of a throw that aimed in space."""
    if verdict is None or verdict.target_m is None:
        return
    target_m = [verdict.target()[k] for k in seen]
    draw.ring(axes, target_m, verdict.hit_radius_m)
    axes.plot(*target_m, **draw.marks("+", 10, color=draw.TARGET), label="target")
    if verdict.closest_m is not None:
        nearest_m = [verdict.closest_m[k] for k in seen]
        axes.plot(*nearest_m, **draw.marks("D", 6, color=draw.MEASURED["color"]), label="closest approach")


def _draw_instant(axes: Any, markers_m: Array, string_m: Array | None, named: bool) -> None:
    """Draw the markers and the fitted string at one instant, with labels for the legend once."""
    style = draw.marks("o", 4, color=draw.MEASURED["color"], markerfacecolor="none")
    axes.plot(*markers_m[1:].T, **style, label="measured markers" if named else None)
    if string_m is not None:
        axes.plot(*string_m.T, **draw.FITTED, label="fitted string" if named else None)


def _ends(results: TrialResults, rows: NDArray[np.int64]) -> list[Array]:
    """Return the places of the driven ends (K, 3) at rows of the track."""
    path = (results.get("hand") or {}).get("measured")
    if path is None:
        return []
    time_s = results.robot_time_s()[rows]
    at = resampled(time_s, path.robot_time_s, path.pose)
    return np.split(at, at.shape[1] // 3, axis=1)


def _mean_distance(results: TrialResults, throw: SimulatedThrow | None) -> float | None:
    if throw is None or results.get("estimate") is None:
        return None
    rows, apart_m = fit_errors_m(results, throw)
    counted = fitted_rows(results)[rows]
    return float(np.nanmean(apart_m[counted, 1:])) if counted.any() else None
