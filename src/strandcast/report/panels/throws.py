"""The throws of an experiment in one figure: tip paths, and hand paths as in Fig. 8b of the paper."""

from typing import Any

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.records.summary import ExperimentSummary
from strandcast.report import drawing as draw
from strandcast.report.measures import arc_length_m, closest_row, within_motion
from strandcast.report.numbers import millimetres, signed
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.page_data import ExperimentPageData
from strandcast.report.results import FILES, HandPoses, TrialResults

Views = list[tuple[Any, list[int]]]  # axes, and the coordinates that they show
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
    counted = [line.trial for line in summary.counted()]
    if not counted:
        raise StrandcastError("SC-W030", "there is no counted trial")
    first, last = counted[0], summary.hit_trial or counted[-1]
    figure = draw.new_figure(8.4, 4.8, top=0.97, bottom=0.2)
    axes = figure.add_subplot()
    for trial in sorted(set(counted) - {first, last}):
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
    summary, trials = page.summary, page.trials
    figure = draw.new_figure(8.4, 5.6, top=0.97, bottom=0.17)
    views = _views(figure, page)
    shown: list[int] = []
    missing: list[str] = []
    for line in summary.counted():
        try:
            tip_m = trials[line.trial].need("track").points_m[trials[line.trial].in_window(), -1]
        except StrandcastError:
            missing.append(str(line.trial))
            continue
        style, name = _style(summary, line.trial)
        label = f"{name}: {millimetres(line.miss_m)}" if page.aimed and name.startswith("trial") else name
        for axes, seen in views:
            axes.plot(*tip_m[:, seen].T, **style, label=label)
        shown.append(line.trial)
    if not shown:
        raise StrandcastError("SC-W030", "no counted trial has a track", fix="track the trials")
    _finish(views, summary)
    finding = f"Tip paths of {len(shown)} trial{'' if len(shown) == 1 else 's'}"
    if page.aimed:
        finding += (
            f"; trial {summary.hit_trial}, the hit, is bold"
            if summary.hit_trial in shown
            else "; none has hit"
        )
    finding += "."
    if missing:
        finding += f" Not shown, without a track: {', '.join(missing)}."
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Measured tip paths. {finding}"),
        sources=[f"{trial_name(trial)}/track.parquet" for trial in shown],
    )


def closest_strings(page: ExperimentPageData) -> PanelContent:
    """Return the measured strings of all counted trials at their closest approach, over each other."""
    summary, trials = page.summary, page.trials
    figure = draw.new_figure(8.4, 4.8, top=0.97, bottom=0.2)
    views = _views(figure, page)
    shown: list[int] = []
    for line in summary.counted():
        if (row := closest_row(trials[line.trial])) is None:
            continue
        style, name = _style(summary, line.trial)
        string_m = trials[line.trial].need("track").points_m[row]
        for axes, seen in views:
            axes.plot(*string_m[:, seen].T, **(style | {"marker": "o", "markersize": 2.6}), label=name)
        shown.append(line.trial)
    if not shown:
        raise StrandcastError("SC-W030", "no counted trial has a closest approach", fix="track the trials")
    _finish(views, summary)
    finding = (
        f"The strings of {len(shown)} trial{'s' * (len(shown) > 1)} at the closest approach of their tips."
    )
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Measured strings at the closest approach. {finding}"),
        sources=[f"{trial_name(trial)}/track.parquet" for trial in shown],
    )


def _style(summary: ExperimentSummary, trial: int) -> tuple[dict[str, Any], str]:
    """Return the style and the name of a trial's line: the hit is bold; of many others, most are grey."""
    counted = [line.trial for line in summary.counted()]
    name = f"trial {trial}"
    if trial == summary.hit_trial:
        return draw.MEASURED | {"linewidth": 2.4, "zorder": 3}, f"{name}, the hit"
    if len(counted) <= MOST_NAMED:
        return STYLES[counted.index(trial) % len(STYLES)], name
    if trial in (counted[0], counted[-1]):
        return (draw.PLANNED if trial == counted[0] else draw.FITTED) | {"zorder": 2.5}, name
    return AMONG_OTHERS, "other trials"


def _views(figure: Any, page: ExperimentPageData) -> Views:
    """Return the figure's axes, each with the coordinates that it shows."""
    seen = draw.views(3 if page.in_space else 2)
    return [(figure.add_subplot(1, len(seen), k + 1), each) for k, each in enumerate(seen)]


def _finish(views: Views, summary: ExperimentSummary) -> None:
    for axes, seen in views:
        if summary.target_m is not None:
            place_m = [summary.target_m[k] for k in seen]
            draw.ring(axes, place_m, summary.hit_radius_m)
            axes.plot(*place_m, **draw.marks("+", 10, color=draw.TARGET), label="target")
            axes.plot(0, 0, **draw.marks("o", 5, color=draw.FITTED["color"]), label="arm’s base")
        draw.equal_axes(axes, seen)
    draw.legend_below(views[0][0].figure, views[0][0])
