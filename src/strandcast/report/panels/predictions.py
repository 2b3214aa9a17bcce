"""How well the string fitted to earlier trials predicted each trial before it was added to the fit."""

from typing import Any

from strandcast.records.estimate import UNDER_PREVIOUS, Estimate
from strandcast.report import drawing as draw
from strandcast.report.measures import GUESSES, best_guess_m
from strandcast.report.numbers import millimetres
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import ExperimentPageData
from strandcast.report.panels.progress import draw_both, trial_axis


def predictions(page: ExperimentPageData) -> PanelContent:
    """Return E of each trial as predicted, as fitted, and of guesses without a model."""
    estimates: dict[int, Estimate] = {
        trial: estimate for trial, results in page.trials.items() if (estimate := results.get("estimate"))
    }
    excluded = {line.trial for line in page.summary.trials if line.excluded is not None}
    figure = draw.new_figure(8.4, 1.5 + 0.42 * max(len(page.summary.trials), 2), top=0.95, bottom=0.42)
    axes = figure.add_subplot()
    for trial, estimate in estimates.items():
        _draw(axes, trial, estimate, trial in excluded)
    every_mm = [
        1e3 * each for estimate in estimates.values() for each in _values_m(estimate).values() if each
    ]
    axes.set(xlabel="E [mm], w = 0", ylabel="trial", xlim=(0, None))
    draw.log_if_wide(axes, "x", every_mm)
    trial_axis(axes.yaxis, axes.set_ylim, page.summary)
    axes.invert_yaxis()
    for name, marker, colour in (
        ("predicted", "D", draw.PLANNED["color"]),
        ("after the fit", "o", draw.FITTED["color"]),
        ("guesses without a model", "x", draw.GREY),
    ):
        axes.plot([], [], marker, color=colour, markersize=7, label=name)
    draw.legend_below(figure, axes)
    finding = _finding({trial: each for trial, each in estimates.items() if trial not in excluded})
    rows = [
        [f"trial {trial}", *(millimetres(value, digits=2) for value in _values_m(estimate).values())]
        for trial, estimate in estimates.items()
    ]
    heads = ["trial", "E predicted", "E after the fit", "E hanging below the hand", "E first shape, moved"]
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Each trial, predicted and fitted. {finding}"),
        [Table(heads, rows)] if rows else [],
        [f"{page.trials[trial].folder.name}/estimate.json" for trial in estimates],
    )


def _values_m(estimate: Estimate) -> dict[str, float | None]:
    guesses = {what: estimate.held_out_m(what) for what in GUESSES}
    return {"predicted": estimate.held_out_m(UNDER_PREVIOUS), "fitted": estimate.E_m} | guesses


def _draw(axes: Any, trial: int, estimate: Estimate, excluded: bool) -> None:
    for what in GUESSES:
        if (guess_m := estimate.held_out_m(what)) is not None:
            axes.plot(1e3 * guess_m, trial, "x", color=draw.GREY, markersize=7, markeredgewidth=1.8)
    draw_both(axes, trial, estimate.held_out_m(UNDER_PREVIOUS), estimate.E_m, excluded=excluded)


def _finding(estimates: dict[int, Estimate]) -> str:
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
