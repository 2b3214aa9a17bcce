"""The throws of an experiment in one figure: tip paths, and hand paths as in Fig. 8b of the paper."""

from contextlib import suppress
from typing import Any

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.records.summary import ExperimentSummary
from strandcast.report import drawing as draw
from strandcast.report.measures import arc_length_m, closest_row, within_motion
from strandcast.report.numbers import counted, millimetres, signed
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.page_data import ExperimentPageData
from strandcast.report.results import FILES, Array, HandPoses, TrialResults

STYLES: tuple[dict[str, Any], ...] = (
    draw.PLANNED,
    draw.TRUE,
    {"color": draw.GREY, "linestyle": (0, (8, 2, 1, 2, 1, 2)), "linewidth": 1.3},
)
AMONG_OTHERS: dict[str, Any] = {"color": draw.GREY, "linewidth": 0.9, "alpha": 0.8}
MOST_NAMED = len(STYLES) + 1  # trials that can be told apart; of more, only the first and the last are named


def hand_paths(page: ExperimentPageData) -> PanelContent:
    """Return the hand's paths in the first throw and in the one that hit (or the last)."""
    summary, trials = page.summary, page.trials
    numbers = [line.trial for line in summary.counted()]
    if not numbers:
        raise StrandcastError("SC-W030", "there is no counted trial")
    first, last = numbers[0], summary.hit_trial or numbers[-1]
    figure = draw.new_figure(8.4, 4.8, top=0.97, bottom=0.2)
    axes = figure.add_subplot()
    for trial in sorted(set(numbers) - {first, last}):
        if trials[trial].get("hand") is not None and trials[trial].get("alignment") is not None:
            axes.plot(*_hand(trials[trial]).pose[:, :2].T, **AMONG_OTHERS, label="other trials")
    lengths = {}
    for trial, style in {first: draw.PLANNED, last: draw.MEASURED}.items():
        path = _hand(trials[trial])
        lengths[trial] = float(arc_length_m(path.pose[:, :2])[-1])
        what = "hit" if trial == summary.hit_trial else "first" if trial == first else "last"
        axes.plot(
            *path.pose[:, :2].T, **style, label=f"trial {trial} ({what}): {lengths[trial] * 1e3:.0f} mm"
        )
        axes.plot(*path.pose[0, :2], **draw.marks("s", 5, color=style["color"]))
    _finish([(axes, [0, 1])], summary)
    finding = f"The hand of trial {first} travelled {millimetres(lengths[first], digits=0)}"
    if last != first:
        change = lengths[last] / lengths[first] - 1
        more = signed(f"{change * 100:+.0f} %")
        finding += f", that of trial {last} {millimetres(lengths[last], digits=0)} ({more})"
    return PanelContent(
        finding + ".",
        draw.Drawing(
            figure,
            f"Hand paths of the first and the {'hitting throw' if page.aimed else 'last trial'}. {finding}.",
        ),
        sources=[f"{trial_name(trial)}/hand.parquet" for trial in lengths],
    )


def _hand(results: TrialResults) -> HandPoses:
    paths = within_motion(results)
    for source in ("measured", "commanded", "seen"):
        if source in paths:
            return paths[source]
    raise StrandcastError(
        "SC-W030", "the hand has no path within the motion", file=FILES["hand"], fix="align the trial again"
    )


def tip_paths(page: ExperimentPageData) -> PanelContent:
    """Return the measured tip paths of all counted trials, the hit in bold."""
    hit, misses_m = page.summary.hit_trial, {line.trial: line.miss_m for line in page.summary.counted()}
    tips_m = {}
    for trial in misses_m:
        with suppress(StrandcastError):
            tips_m[trial] = page.trials[trial].need("track").points_m[page.trials[trial].in_window(), -1]
    if not tips_m:
        raise StrandcastError("SC-W030", "no counted trial has a track", fix="track the trials")
    labels = {trial: f": {millimetres(miss_m)}" for trial, miss_m in misses_m.items() if page.aimed}
    finding = f"Tip paths of {counted(len(tips_m), 'trial')}"
    if page.aimed:
        finding += f"; trial {hit}, the hit, is bold" if hit in tips_m else "; none has hit"
    finding += "."
    if missing := [str(trial) for trial in misses_m if trial not in tips_m]:
        finding += f" Not shown, without a track: {', '.join(missing)}."
    figure = draw.new_figure(8.4, 5.6, top=0.97, bottom=0.17)
    return _lines(page, figure, tips_m, "Measured tip paths", finding, labels)


def closest_strings(page: ExperimentPageData) -> PanelContent:
    """Return the measured strings of all counted trials at their closest approach, over each other."""
    rows = {line.trial: closest_row(page.trials[line.trial]) for line in page.summary.counted()}
    strings_m = {
        trial: page.trials[trial].need("track").points_m[row]
        for trial, row in rows.items()
        if row is not None
    }
    if not strings_m:
        raise StrandcastError("SC-W030", "no counted trial has a closest approach", fix="track the trials")
    finding = f"The strings of {counted(len(strings_m), 'trial')} at the closest approach of their tips."
    figure, what = draw.new_figure(8.4, 4.8, top=0.97, bottom=0.2), "Measured strings at the closest approach"
    return _lines(page, figure, strings_m, what, finding, {}, marker="o", markersize=2.6)


def _lines(
    page: ExperimentPageData,
    figure: Any,
    lines_m: dict[int, Array],
    what: str,
    finding: str,
    labels: dict[int, str],
    **marks: Any,
) -> PanelContent:
    """Return a figure of one line of each trial, in each view; labels stand behind the trials' names."""
    planes = draw.views(3 if page.in_space else 2)
    views = [(figure.add_subplot(1, len(planes), k + 1), seen) for k, seen in enumerate(planes)]
    for trial, line_m in lines_m.items():
        style, name = _style(page.summary, trial)
        label = name if style is AMONG_OTHERS else name + labels.get(trial, "")
        for axes, seen in views:
            axes.plot(*line_m[:, seen].T, **(style | marks), label=label)
    _finish(views, page.summary)
    return PanelContent(
        finding,
        draw.Drawing(figure, f"{what}. {finding}"),
        sources=[f"{trial_name(trial)}/track.parquet" for trial in lines_m],
    )


def _style(summary: ExperimentSummary, trial: int) -> tuple[dict[str, Any], str]:
    """Return the style and the name of a trial's line: the hit is bold; of many others, most are grey."""
    numbers = [line.trial for line in summary.counted()]
    name = f"trial {trial}"
    if trial == summary.hit_trial:
        return draw.MEASURED | {"linewidth": 2.4, "zorder": 3}, f"{name}, the hit"
    if len(numbers) <= MOST_NAMED:
        return STYLES[numbers.index(trial) % len(STYLES)], name
    if trial in (numbers[0], numbers[-1]):
        return (draw.PLANNED if trial == numbers[0] else draw.FITTED) | {"zorder": 2.5}, name
    return AMONG_OTHERS, "other trials"


def _finish(views: list[tuple[Any, list[int]]], summary: ExperimentSummary) -> None:
    """Draw the target in axes, each with the coordinates that it shows, and the legend."""
    for axes, seen in views:
        if summary.target_m is not None:
            place_m = [summary.target_m[k] for k in seen]
            draw.ring(axes, place_m, summary.hit_radius_m)
            axes.plot(*place_m, **draw.marks("+", 10, color=draw.TARGET), label="target")
            axes.plot(0, 0, **draw.marks("o", 5, color=draw.FITTED["color"]), label="arm’s base")
        draw.equal_axes(axes, seen)
    draw.legend_below(views[0][0].figure, views[0][0])
