"""The course of an experiment: each trial's miss, E before and after its fit, and E as predicted."""

from typing import Any

import numpy as np

from strandcast.records.estimate import UNDER_PREVIOUS, Estimate
from strandcast.records.summary import ExperimentSummary, TrialSummary
from strandcast.report import drawing as draw
from strandcast.report.expected import expected_miss
from strandcast.report.measures import GUESSES, best_guess_m
from strandcast.report.numbers import millimetres
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import ExperimentPageData

MOST_NUMBERS = 12  # of misses that stand beside their marks; the table has all
MOST_TICKS = 20
# Of the predicted intervals, in points: wider than a mark, and together half of the axis.
WIDEST_BAR, ALL_BARS = 22.0, 270.0


def misses(page: ExperimentPageData) -> PanelContent:
    """Return the miss per trial against the hit radius; excluded trials are grey."""
    summary = page.summary
    figure = draw.new_figure(8.4, 3.6, top=0.95, bottom=0.15)
    axes = figure.add_subplot()
    radius_mm = summary.hit_radius_m * 1e3
    axes.axhspan(0, radius_mm, facecolor=draw.TARGET, alpha=0.25, linewidth=0)
    axes.axhline(radius_mm, **draw.HIT_RADIUS)
    counted_mm = {line.trial: line.miss_m * 1e3 for line in summary.counted() if line.miss_m is not None}
    axes.plot(list(counted_mm), list(counted_mm.values()), **draw.MEASURED)
    best_mm = np.minimum.accumulate(list(counted_mm.values()))
    axes.step(list(counted_mm), best_mm, where="post", color=draw.INK, linewidth=0.9, linestyle=(0, (2, 2)))
    predicted = _draw_predicted(axes, page)
    for line in summary.trials:
        _draw_miss(axes, line, named=len(summary.trials) <= MOST_NUMBERS)
    right = {"xycoords": ("axes fraction", "data"), "ha": "right", "fontsize": 8}
    draw.note(axes, "hit radius", (1.0, radius_mm), (-3, 3), **right)
    axes.set(xlabel="trial", ylabel="miss [mm]", ylim=(0, None))
    known_mm = [1e3 * line.miss_m for line in summary.trials if line.miss_m]
    draw.log_if_wide(
        axes, "y", [radius_mm, *known_mm, *(end for interval in predicted.values() for end in interval)]
    )
    trial_axis(axes.xaxis, axes.set_xlim, summary)
    finding = _finding(summary, counted_mm) + _held(counted_mm, predicted)
    return PanelContent(finding, draw.Drawing(figure, f"Miss per trial. {finding}"), sources=["summary.json"])


def evaluations(page: ExperimentPageData) -> PanelContent:
    """Return E with the parameters that planned each throw and after its fit, as dumbbells."""
    summary = page.summary
    known = [line for line in summary.trials if line.E_m is not None]
    figure = draw.new_figure(8.4, 1.1 + 0.42 * max(len(summary.trials), 2), top=0.95, bottom=0.26)
    axes = figure.add_subplot()
    for line in known:
        draw_both(axes, line.trial, line.E_planned_m, line.E_m or 0.0, excluded=line.excluded is not None)
    axes.axvline(8.0, color=draw.INK, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.set(
        xlabel="E [mm], w = 0 (dotted: 8 mm, beyond which the next throw often misses)",
        ylabel="trial",
        xlim=(0, None),
    )
    both_mm = [1e3 * each for line in known for each in (line.E_m, line.E_planned_m) if each is not None]
    draw.log_if_wide(axes, "x", [*both_mm, 8.0])
    trial_axis(axes.yaxis, axes.set_ylim, summary)
    axes.invert_yaxis()
    axes.plot([], [], "D", color=draw.PLANNED["color"], markersize=7, label="as planned")
    axes.plot([], [], "o", color=draw.FITTED["color"], markersize=7, label="after the fit")
    axes.legend(loc="best")
    pairs = [line for line in known if line.E_planned_m is not None and line.excluded is None]
    better = sum((line.E_m or 0.0) < (line.E_planned_m or 0.0) for line in pairs)
    finding = f"The fit lowered E in {better} of {len(pairs)} counted trials"
    finding += f"; last: {millimetres(known[-1].E_m, digits=2)}." if known else "."
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Evaluation value before and after each fit. {finding}"),
        sources=["summary.json"],
    )


def draw_both(axes: Any, trial: int, before_m: float | None, after_m: float, *, excluded: bool) -> None:
    """Draw E before and after a trial's fit, a diamond and a disc; grey if the trial is excluded."""
    before, after = (draw.GREY, draw.GREY) if excluded else (draw.PLANNED["color"], draw.FITTED["color"])
    if before_m is not None:
        axes.plot([1e3 * before_m, 1e3 * after_m], [trial] * 2, color=draw.GREY, linewidth=2, zorder=1)
        axes.plot(1e3 * before_m, trial, "D", color=before, markersize=7)
    axes.plot(1e3 * after_m, trial, "o", color=after, markersize=7)


def _draw_predicted(axes: Any, page: ExperimentPageData) -> dict[int, tuple[float, float]]:
    """Draw the interval of misses that was predicted before each throw; return them by trial [mm]."""
    intervals = {}
    width = min(WIDEST_BAR, ALL_BARS / max(len(page.summary.trials), 1))
    for trial, results in page.trials.items():
        if (expected := expected_miss(results.get("motion"))) is not None:
            low_mm, high_mm = expected.low_m * 1e3, expected.high_m * 1e3
            wide = {
                "color": draw.PLANNED["color"],
                "alpha": 0.45,
                "linewidth": width,
                "solid_capstyle": "butt",
            }
            axes.plot([trial, trial], [low_mm, high_mm], **wide)
            intervals[trial] = (low_mm, high_mm)
    return intervals


def _held(counted_mm: dict[int, float], predicted: dict[int, tuple[float, float]]) -> str:
    """Return in words how many misses were within the interval predicted before the throw."""
    both = counted_mm.keys() & predicted.keys()
    if not both:
        return ""
    held = sum(predicted[trial][0] <= counted_mm[trial] <= predicted[trial][1] for trial in both)
    return f" {held} of {len(both)} misses lie in the interval predicted before the throw."


def _draw_miss(axes: Any, line: TrialSummary, named: bool) -> None:
    if line.miss_m is None:
        draw.note(axes, "not seen", (line.trial, 0), (0, 4), ha="center", fontsize=8)
        return
    colour, marker = (
        (draw.GREY, "x") if line.excluded is not None else (draw.MEASURED["color"], "o" if line.hit else "^")
    )
    axes.errorbar(
        line.trial,
        line.miss_m * 1e3,
        yerr=None if line.miss_sigma_m is None else line.miss_sigma_m * 1e3,
        marker=marker,
        markersize=9,
        color=colour,
        markerfacecolor=colour if line.hit else "none",
        markeredgewidth=1.8,
        capsize=4,
    )
    if named:
        draw.note(axes, f"{line.miss_m * 1e3:.1f}", (line.trial, line.miss_m * 1e3), (9, 5), fontsize=8.5)


def trial_axis(axis: Any, set_limits: Any, summary: ExperimentSummary) -> None:
    """Set the ticks of an axis to trials."""
    trials = [line.trial for line in summary.trials]
    axis.set_ticks(spaced_ticks(trials))
    set_limits(min(trials, default=1) - 0.6, max(trials, default=1) + 0.6)


def spaced_ticks(trials: list[int]) -> list[int]:
    """Return those of the trials, in their order, that an axis names: at most 20, and none near another."""
    apart = (max(trials, default=1) - min(trials, default=1) + 1) / MOST_TICKS
    ticks: list[int] = []
    for trial in trials:
        if not ticks or trial - ticks[-1] >= apart:
            ticks.append(trial)
    return ticks


def _finding(summary: ExperimentSummary, counted_mm: dict[int, float]) -> str:
    if not counted_mm:
        return "No counted trial has a measured miss."
    measured = (line for line in summary.trials if line.trial in counted_mm)
    best = min(measured, key=lambda line: counted_mm[line.trial])
    path = " → ".join(f"{miss_mm:.1f}" for miss_mm in counted_mm.values())
    best_text = f"{millimetres(best.miss_m, best.miss_sigma_m)} in trial {best.trial}"
    return f"Miss by trial: {path} mm; the best is {best_text}."


def predictions(page: ExperimentPageData) -> PanelContent:
    """Return E of each trial as predicted, as fitted, and of guesses without a model."""
    estimates: dict[int, Estimate] = {
        trial: estimate for trial, results in page.trials.items() if (estimate := results.get("estimate"))
    }
    values_m = {
        trial: [each.held_out_m(UNDER_PREVIOUS), each.E_m, *map(each.held_out_m, GUESSES)]
        for trial, each in estimates.items()
    }
    excluded = {line.trial for line in page.summary.trials if line.excluded is not None}
    figure = draw.new_figure(8.4, 1.5 + 0.42 * max(len(page.summary.trials), 2), top=0.95, bottom=0.42)
    axes = figure.add_subplot()
    for trial, (predicted_m, _, *guesses_m) in values_m.items():
        for guess_m in guesses_m:
            if guess_m is not None:
                axes.plot(1e3 * guess_m, trial, "x", color=draw.GREY, markersize=7, markeredgewidth=1.8)
        draw_both(axes, trial, predicted_m, estimates[trial].E_m, excluded=trial in excluded)
    axes.set(xlabel="E [mm], w = 0", ylabel="trial", xlim=(0, None))
    draw.log_if_wide(axes, "x", [1e3 * each for values in values_m.values() for each in values if each])
    trial_axis(axes.yaxis, axes.set_ylim, page.summary)
    axes.invert_yaxis()
    for name, marker, colour in (
        ("predicted", "D", draw.PLANNED["color"]),
        ("after the fit", "o", draw.FITTED["color"]),
        ("guesses without a model", "x", draw.GREY),
    ):
        axes.plot([], [], marker, color=colour, markersize=7, label=name)
    draw.legend_below(figure, axes)
    counted = {trial: each for trial, each in estimates.items() if trial not in excluded}
    finding = _predictions_finding(counted)
    rows = [
        [f"trial {trial}", *(millimetres(each, digits=2) for each in values)]
        for trial, values in values_m.items()
    ]
    heads = ["trial", "E predicted", "E after the fit", "E hanging below the hand", "E first shape, moved"]
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Each trial, predicted and fitted. {finding}"),
        [Table(heads, rows)] if rows else [],
        [f"{page.trials[trial].folder.name}/estimate.json" for trial in estimates],
    )


def _predictions_finding(estimates: dict[int, Estimate]) -> str:
    if not estimates:
        return "No trial has been fitted yet."
    last = max(estimates)
    pairs = [
        (predicted_m, guess_m)
        for each in estimates.values()
        if (predicted_m := each.held_out_m(UNDER_PREVIOUS)) is not None
        and (guess_m := best_guess_m(each)) is not None
    ]
    fitted = f"Trial {last} is fitted to E {millimetres(estimates[last].E_m, digits=2)}"
    if not pairs:
        return f"{fitted}. A prediction needs a second trial, which the first one’s fit has not seen."
    predicted_m = estimates[last].held_out_m(UNDER_PREVIOUS)
    before = f", and was predicted to {millimetres(predicted_m, digits=2)}" if predicted_m is not None else ""
    better = sum(predicted < guess for predicted, guess in pairs)
    return (
        f"{fitted}{before}. {better} of {len(pairs)} predictions are better than the better guess "
        "without a model."
    )
