"""Estimated masses by place, with the true weights and pipes: Table 4 of the paper."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.estimate import Estimate
from strandcast.report.drawing import INK, Drawing, legend_below, new_figure
from strandcast.report.numbers import UNKNOWN, significant
from strandcast.report.panels.content import PanelContent, Table
from strandcast_studies.paper.figures.counts import NAMES, STYLES
from strandcast_studies.paper.figures.log_ticks import log_ticks
from strandcast_studies.paper.figures.strings import PIPE
from strandcast_studies.paper.report.facts import PaperFacts, StringFacts
from strandcast_studies.paper.report.runs import RunResults
from strandcast_studies.paper.report.summary import METHODS

# Table 4 as printed: indices and masses are the paper's, relative to its own plain points ("others").
PRINTED_MASSES = {
    1: "m10 = 9.1; others 1.0",
    2: "m4 = 1.0, second 1.0; others 11",
    3: "m5 = 17; others 4.3",
    4: "m13 = 3.5, m15 = 20; others 1.0",
    5: "m6 = 18, m12 = 9.1, m13 = 6.1 (pipe at 12, 13); others 1.0",
    6: "m13 = 1.9, m14 = 4.0, m15 = 4.8 (pipe there); others 1.0",
    7: "m9 = 11; others 1.0",
}
COLUMNS = 4
PLAIN = "plain_mass"  # an estimate's option: the fitted mass of the plain points, as in the paper


class FoundMass(NamedTuple):
    """An estimated mass at a place, in plain points; `pipe` is the index of its pipe, or None."""

    place_m: float
    pipe: int | None
    ratio: float


def masses(runs: Sequence[RunResults], facts: PaperFacts) -> PanelContent:
    """Return the masses estimated by both methods for every string, and the true ones."""
    found: dict[tuple[int, str], list[list[FoundMass]]] = {}
    for each in runs:
        estimate = each.estimate() if each.run.own_target else None
        if estimate is not None and each.run.string in facts.strings:
            mine = found_masses(estimate, facts.strings[each.run.string])
            found.setdefault((each.run.string, each.run.method), []).append(mine)
    if not found:
        raise StrandcastError("SC-H074", "no string has an estimate", fix="look at the runs' pages")
    strings = [string for number, string in facts.strings.items() if any(s == number for s, _ in found)]
    rows = [row for string in strings for row in _rows(string, found)]
    heads = [
        "string",
        "place",
        "true",
        *(f"{NAMES[method]} (least … greatest)" for method in METHODS),
        "printed (its own string)",
    ]
    finding = _finding(rows, found)
    return PanelContent(
        finding,
        Drawing(_figure(strings, found), f"Estimated masses by place. {finding}"),
        [Table(heads, rows)],
        ["summary.json"],
    )


def found_masses(estimate: Estimate, string: StringFacts) -> list[FoundMass]:
    """Return an estimate's masses at the known places, relative to its plain points."""
    plain = estimate.options.get(PLAIN, 1.0)
    found = []
    for weight in estimate.weights:
        pipe = None
        if weight.kind == "stiff":
            away = [max(p.from_m - weight.place_m, weight.place_m - p.to_m, 0.0) for p in string.pipes]
            pipe = int(np.argmin(away)) if away else None
        found.append(FoundMass(weight.place_m, pipe, weight.value / plain))
    return found


def _rows(string: StringFacts, found: dict[tuple[int, str], list[list[FoundMass]]]) -> list[list[Any]]:
    """Return a string's rows of the table: one for each weight and pipe."""
    places = [
        (f"{w.place_m * 1e3:.0f} mm", w.relative_mass, ("weight", k)) for k, w in enumerate(string.weights)
    ]
    places += [
        (f"pipe {p.from_m * 1e3:.0f}–{p.to_m * 1e3:.0f} mm", p.relative_mass, ("pipe", k))
        for k, p in enumerate(string.pipes)
    ]
    rows = []
    for k, (where, true, what) in enumerate(places):
        cells = [
            _cell([_mass(each, string, *what) for each in found.get((string.number, m), [])]) for m in METHODS
        ]
        printed = PRINTED_MASSES.get(string.number, "") if k == 0 else ""
        rows.append([f"{string.number}", where, significant(true), *cells, printed])
    return rows


def _mass(each: list[FoundMass], string: StringFacts, kind: str, number: int) -> float:
    if kind == "pipe":
        return sum(mass.ratio for mass in each if mass.pipe == number)
    place_m = string.weights[number].place_m
    return min((m for m in each if m.pipe is None), key=lambda m: abs(m.place_m - place_m)).ratio


def _cell(values: list[float]) -> str:
    if not values:
        return UNKNOWN
    text = significant(float(np.median(values)))
    if len(values) > 1:
        text += f" ({significant(min(values))} … {significant(max(values))})"
    return text


def _finding(rows: list[list[Any]], found: dict[tuple[int, str], list[list[FoundMass]]]) -> str:
    runs = {method: sum(len(v) for (_, m), v in found.items() if m == method) for method in METHODS}
    counts = [f"{count} with {NAMES[method]}" for method, count in runs.items() if count]
    return f"Masses at {len(rows)} known places, number of fits: " + ", ".join(counts) + "."


def _figure(strings: Sequence[StringFacts], found: dict[tuple[int, str], list[list[FoundMass]]]) -> Any:
    lines = -(-len(strings) // COLUMNS)
    height = 0.8 + 1.9 * lines
    figure = new_figure(
        10.0, height, left=0.07, top=1 - 0.25 / height, bottom=0.85 / height, wspace=0.3, hspace=0.45
    )
    for k, string in enumerate(strings):
        axes = figure.add_subplot(lines, COLUMNS, k + 1)
        _draw(axes, string, found)
        axes.set(yscale="log", xlim=(-15, string.length_m * 1e3 + 25), ylim=(0.2, 600))
        log_ticks(axes.yaxis)
        axes.set_title(f"string {string.number}")
        if k % COLUMNS == 0:
            axes.set_ylabel("mass [plain points]")
        if k + COLUMNS >= len(strings):
            axes.set_xlabel("place [mm]")
    legend_below(figure)
    return figure


def _draw(axes: Any, string: StringFacts, found: dict[tuple[int, str], list[list[FoundMass]]]) -> None:
    spacing_mm = string.length_m / string.points * 1e3
    for pipe in string.pipes:
        axes.axvspan(
            pipe.from_m * 1e3, pipe.to_m * 1e3, facecolor="none", edgecolor=PIPE, hatch="////", linewidth=0
        )
    for weight in string.weights:
        ends = [(weight.place_m * 1e3 - 0.9 * spacing_mm), (weight.place_m * 1e3 + 0.9 * spacing_mm)]
        axes.plot(ends, [weight.relative_mass] * 2, color=INK, linewidth=2.2, label="true weight", zorder=3)
    for method, aside in zip(METHODS, (-0.25, 0.25), strict=True):
        points = [mass for each in found.get((string.number, method), []) for mass in each]
        if points:
            axes.plot(
                [mass.place_m * 1e3 + aside * spacing_mm for mass in points],
                [max(mass.ratio, 0.2) for mass in points],
                linestyle="none",
                marker=STYLES[method]["marker"],
                markersize=5,
                markerfacecolor="none",
                color=STYLES[method]["color"],
                label=NAMES[method],
                zorder=4,
            )
