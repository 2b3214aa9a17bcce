"""The throws of an experiment over each other: tip paths, and hand paths as in Fig. 8b of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.patches import Circle

from strandcast.errors import StrandcastError
from strandcast.records.summary import Summary
from strandcast.report.drawing import (
    FITTED,
    MEASURED,
    PLANNED,
    TARGET,
    TRUE,
    legend_below,
    new_figure,
    to_svg,
)
from strandcast.report.figures.hand_path import within_motion
from strandcast.report.measures import arc_length_m
from strandcast.report.numbers import millimetres
from strandcast.report.reportlet import Reportlet
from strandcast.report.results import FILES, HandPath, Results

STYLES: tuple[dict[str, Any], ...] = (
    PLANNED,
    TRUE,
    {"color": "#808890", "linestyle": (0, (8, 2, 1, 2, 1, 2)), "linewidth": 1.3},
)


def hand_paths(key: str, title: str, summary: Summary, trials: Mapping[int, Results]) -> Reportlet:
    """Return the hand's paths of the first and the hitting throw (of the last one, if none has hit)."""
    counted = [line.trial for line in summary.trials if line.excluded is None and line.trial in trials]
    if not counted:
        raise StrandcastError("SC-H061", "there is no counted trial")
    first, last = counted[0], summary.hit_trial or counted[-1]
    figure = new_figure(8.4, 4.8, top=0.97, bottom=0.2)
    axes = figure.add_subplot()
    lengths = {}
    for trial, style in {first: PLANNED, last: MEASURED}.items():
        path = _hand(trials[trial])
        lengths[trial] = float(arc_length_m(path.pose[:, :2])[-1])
        what = "hit" if trial == summary.hit_trial else "first" if trial == first else "last"
        axes.plot(
            *path.pose[:, :2].T, **style, label=f"trial {trial} ({what}): {lengths[trial] * 1e3:.0f} mm"
        )
        axes.plot(*path.pose[0, :2], linestyle="none", marker="s", markersize=5, color=style["color"])
    _finish(axes, summary)
    finding = f"The hand of trial {first} travelled {millimetres(lengths[first], digits=0)}"
    if last != first:
        change = lengths[last] / lengths[first] - 1
        finding += (
            f", that of trial {last} {millimetres(lengths[last], digits=0)} ({change * 100:+.0f} %)".replace(
                "-", "−"
            )
        )
    return Reportlet(
        key,
        title,
        finding + ".",
        "Squares: where the motion starts. In the paper the path after estimation is the longer one, "
        "because the string of its first plan stretches.",
        to_svg(figure, key, f"Hand paths of the first and the hitting throw. {finding}."),
        sources=[f"trial-{trial:02d}/hand.parquet" for trial in lengths],
    )


def _hand(results: Results) -> HandPath:
    paths = within_motion(results)
    for source in ("measured", "commanded", "seen"):
        if source in paths:
            return paths[source]
    raise StrandcastError(
        "SC-H062",
        "the hand has no path within the motion",
        file=FILES["hand"],
        fix="align the trial again",
    )


def tip_paths(key: str, title: str, summary: Summary, trials: Mapping[int, Results]) -> Reportlet:
    """Return the measured tip paths of all counted trials, the hitting one bold."""
    figure = new_figure(8.4, 5.6, top=0.97, bottom=0.17)
    axes = figure.add_subplot()
    shown: list[int] = []
    missing: list[str] = []
    for line in summary.trials:
        if line.excluded is not None or line.trial not in trials:
            continue
        try:
            tip_m = trials[line.trial].need("track").points_m[trials[line.trial].in_window(), -1]
        except StrandcastError:
            missing.append(str(line.trial))
            continue
        style = (
            MEASURED | {"linewidth": 2.4}
            if line.trial == summary.hit_trial
            else STYLES[len(shown) % len(STYLES)]
        )
        axes.plot(*tip_m.T, **style, label=f"trial {line.trial}: {millimetres(line.miss_m)}")
        shown.append(line.trial)
    if not shown:
        raise StrandcastError("SC-H063", "no counted trial has a track", fix="track the trials")
    _finish(axes, summary)
    finding = f"Tip paths of {len(shown)} trials" + (
        f"; trial {summary.hit_trial}, the hit, is bold." if summary.hit_trial in shown else "; none has hit."
    )
    if missing:
        finding += f" Not shown, for want of a track: {', '.join(missing)}."
    return Reportlet(
        key,
        title,
        finding,
        "From the motion's start until 0.3 s after its end.",
        to_svg(figure, key, f"Measured tip paths. {finding}"),
        sources=[f"trial-{trial:02d}/track.parquet" for trial in shown],
    )


def _finish(axes: Any, summary: Summary) -> None:
    axes.add_patch(
        Circle(
            (summary.target_m[0], summary.target_m[1]),
            summary.hit_radius_m,
            facecolor="none",
            edgecolor=TARGET,
            lw=2.0,
        )
    )
    axes.plot(*summary.target_m, linestyle="none", marker="+", color=TARGET, markersize=10, label="target")
    axes.plot(0, 0, linestyle="none", marker="o", color=FITTED["color"], markersize=5, label="arm’s base")
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="datalim")
    legend_below(axes.figure)
