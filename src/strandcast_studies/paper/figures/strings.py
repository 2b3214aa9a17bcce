"""Strings and targets to scale: Figs. 5 and 6 of the paper."""

from typing import Any

from matplotlib.patches import Circle, Rectangle

from strandcast.errors import StrandcastError
from strandcast.report.drawing import FITTED, INK, MEASURED, TARGET, Drawing, legend_below, new_figure
from strandcast.report.numbers import millimetres
from strandcast.report.panels.content import PanelContent, Table
from strandcast_studies.paper.records import PaperSummary
from strandcast_studies.paper.report.facts import PaperFacts, StringFacts

PIPE = "#e69f00"


def strings(facts: PaperFacts) -> PanelContent:
    """Return the strings with weights and pipes at their places: Fig. 5."""
    if not facts.strings:
        raise StrandcastError("SC-H073", "no string is known", fix="restore config/paper.yaml")
    figure = new_figure(10.0, 0.9 + 0.42 * len(facts.strings), left=0.08, top=0.95, bottom=0.22)
    axes = figure.add_subplot()
    for string in facts.strings.values():
        _draw_string(axes, string)
    axes.set(xlabel="place along the string from the hand [mm]", ylabel="string", xlim=(-15, 660))
    axes.set_yticks(list(facts.strings))
    axes.set_ylim(min(facts.strings) - 0.6, max(facts.strings) + 0.6)
    axes.invert_yaxis()
    axes.plot([], [], linestyle="none", marker="o", markersize=8, color=FITTED["color"], label="weight")
    axes.plot([], [], linewidth=7, color=PIPE, label="pipe")
    legend_below(figure)
    lengths = sorted({string.length_m for string in facts.strings.values()})
    finding = (
        f"{len(facts.strings)} strings of " + ", ".join(millimetres(each, digits=0) for each in lengths) + "."
    )
    return PanelContent(
        finding,
        Drawing(figure, f"The strings to scale. {finding}"),
    )


def _draw_string(axes: Any, string: StringFacts) -> None:
    axes.plot([0, string.length_m * 1e3], [string.number] * 2, **(MEASURED | {"linewidth": 2.0}))
    for pipe in string.pipes:
        span = [pipe.from_m * 1e3, pipe.to_m * 1e3]
        axes.plot(span, [string.number] * 2, linewidth=7, color=PIPE, solid_capstyle="butt")
    places = [weight.place_m * 1e3 for weight in string.weights]
    style = {"linestyle": "none", "marker": "o", "markersize": 8, "color": FITTED["color"]}
    axes.plot(places, [string.number] * len(places), **style)


def targets(facts: PaperFacts, summary: PaperSummary) -> PanelContent:
    """Return the targets in the plane of motion, and the reach of the arm and the strings: Fig. 6."""
    if not facts.targets:
        raise StrandcastError("SC-H073", "no target is known", fix="restore config/paper.yaml")
    figure = new_figure(8.4, 5.6, left=0.09, top=0.97, bottom=0.19)
    axes = figure.add_subplot()
    axes.add_patch(
        Circle((0, 0), facts.reach_m, facecolor="none", edgecolor=INK, linewidth=1.4, label="arm’s reach")
    )
    for length_m in sorted({string.length_m for string in facts.strings.values()}):
        radius = facts.reach_m + length_m
        axes.add_patch(
            Circle((0, 0), radius, facecolor="none", edgecolor=INK, linewidth=0.7, linestyle=(0, (2, 3)))
        )
    for target in facts.targets:
        printed = target.source == "paper"
        colour = TARGET if printed else MEASURED["color"]
        axes.add_patch(
            Circle(target.target_m, summary.hit_radius_m, facecolor="none", edgecolor=colour, lw=2.0)
        )
        axes.annotate(
            f"{target.number}" + ("" if printed else " (ours)"),
            target.target_m,
            xytext=(9, 6),
            textcoords="offset points",
        )
    axes.plot(0, 0, linestyle="none", marker="o", color=FITTED["color"], markersize=7, label="arm’s base")
    if facts.workspace_m is not None:
        (left, right), (low, high) = facts.workspace_m.x_m, facts.workspace_m.y_m
        style: dict[str, Any] = {"fill": False, "edgecolor": INK, "linewidth": 0.8, "linestyle": "--"}
        label = "workspace of hand and string"
        axes.add_patch(Rectangle((left, low), right - left, high - low, label=label, **style))
        axes.set(xlim=(left - 0.05, right + 0.05), ylim=(low - 0.05, high + 0.05))
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    legend_below(figure)
    away = {t.number: (t.target_m[0] ** 2 + t.target_m[1] ** 2) ** 0.5 for t in facts.targets}
    out = sum(distance > facts.reach_m for distance in away.values())
    reach = millimetres(facts.reach_m, digits=0)
    finding = f"{out} of {len(away)} targets are out of the arm’s reach of {reach}."
    rows = [
        [
            f"{target.number}",
            f"({target.target_m[0] * 1e3:.0f}, {target.target_m[1] * 1e3:.0f}) mm".replace("-", "−"),
            millimetres(away[target.number], digits=0),
            "the paper" if target.source == "paper" else "ours",
            ", ".join(sorted({f"{run.string}" for run in summary.experiments if run.target == target.number}))
            or "none yet",
        ]
        for target in facts.targets
    ]
    return PanelContent(
        finding,
        Drawing(figure, f"The targets and the arm’s reach. {finding}"),
        [Table(["target", "place", "from the base", "source", "thrown at with string"], rows)],
    )
