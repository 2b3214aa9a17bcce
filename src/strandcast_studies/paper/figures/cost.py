"""Wall time by stage, and the first fit's E as a warning of the next miss."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.report.drawing import INK, TARGET, Drawing, legend_below, new_figure
from strandcast.report.numbers import UNKNOWN, significant
from strandcast.report.panels.content import PanelContent, Table
from strandcast_studies.paper.figures.counts import NAMES, STYLES
from strandcast_studies.paper.figures.log_ticks import log_ticks
from strandcast_studies.paper.records import PaperSummary
from strandcast_studies.paper.report.facts import PaperFacts, StageTime
from strandcast_studies.paper.report.summary import METHODS, chosen

STAGES = (
    "lab_calibrate",
    "calibrate",
    "plan",
    "lab_throw",
    "ingest",
    "track",
    "align",
    "score",
    "estimate",
    "report",
    "summary",
)
WARNING_M = 0.008  # measured: DESIGN section 6; `first_fit` shows how well it separates misses


def times(facts: PaperFacts) -> PanelContent:
    """Return wall and processor time of every stage, by method."""
    if not facts.times:
        raise StrandcastError(
            "SC-H078", "no stage has logged its time", fix="run the experiments with Snakemake"
        )
    present = {each.stage for each in facts.times}
    stages = [stage for stage in STAGES if stage in present] + sorted(present - set(STAGES))
    methods = [method for method in METHODS if any(each.method == method for each in facts.times)]
    rows = []
    for stage in stages:
        mine = {method: _of(facts.times, stage, method) for method in methods}
        count = sum(map(len, mine.values()))
        cells = [cell for method in methods for cell in _cells(mine[method])]
        rows.append([stage, f"{count}", *cells])
    totals = [sum(each.wall_s for each in facts.times if each.method == method) / 3600 for method in methods]
    heads = [
        "stage",
        "jobs",
        *(f"{NAMES[m]}, {what}" for m in methods for what in ("wall time", "processor")),
    ]
    caption = "Seconds per job: median (greatest). Jobs share the machine with each other and other programs."
    total_times = "; ".join(f"{NAMES[m]} {total:.2f} h" for m, total in zip(methods, totals, strict=True))
    return PanelContent(
        f"Total wall time of all jobs: {total_times}.",
        tables=[Table(heads, rows, caption)],
    )


def _of(all_times: Sequence[StageTime], stage: str, method: str) -> list[StageTime]:
    return [each for each in all_times if each.stage == stage and each.method == method]


def _cells(mine: Sequence[StageTime]) -> list[str]:
    if not mine:
        return [UNKNOWN, UNKNOWN]
    cells = []
    for values in ([each.wall_s for each in mine], [each.processor_s for each in mine]):
        known = [value for value in values if value is not None]
        cells.append(f"{np.median(known):.1f} ({max(known):.1f})" if known else UNKNOWN)
    return cells


class FirstFit(NamedTuple):
    """E after a run's first fit [m], and the miss of the next throw [m]."""

    E_m: float
    miss_m: float


def warned(summary: PaperSummary, method: str) -> list[FirstFit]:
    """Return E after the first fit and the next miss of every run with a second throw."""
    pairs = []
    for run in chosen(summary.experiments, method):
        counted = [line for line in run.trials if line.excluded is None]
        for first, following in list(pairwise(counted))[:1]:
            if first.E_m is not None and following.miss_m is not None:
                pairs.append(FirstFit(first.E_m, following.miss_m))
    return pairs


def first_fit(summary: PaperSummary) -> PanelContent:
    """Return the first fit's E against the miss of the throw planned with it."""
    pairs = {method: warned(summary, method) for method in METHODS}
    if not any(pairs.values()):
        raise StrandcastError("SC-H079", "no run has a second throw", fix="see the table of trials to hit")
    figure = new_figure(8.4, 4.4, top=0.96, bottom=0.2)
    axes = figure.add_subplot()
    axes.axvline(WARNING_M * 1e3, color=INK, linewidth=0.9, linestyle=(0, (2, 2)), label="E = 8 mm")
    axes.axhline(
        summary.hit_radius_m * 1e3, color=TARGET, linewidth=1.4, linestyle=(0, (6, 3)), label="hit radius"
    )
    for method in METHODS:
        if pairs[method]:
            E_mm, miss_mm = (1e3 * np.array(values) for values in zip(*pairs[method], strict=True))
            style = STYLES[method] | {"linestyle": "none", "markerfacecolor": "none"}
            axes.plot(E_mm, np.maximum(miss_mm, 0.05), **style, label=NAMES[method])
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="E after the first fit [mm], w = 0",
        ylabel="miss of the next throw [mm]",
    )
    log_ticks(axes.xaxis, axes.yaxis, within=(1.0, 2.0, 5.0))
    legend_below(figure)
    rows = [_counts(method, pairs[method], summary.hit_radius_m) for method in METHODS if pairs[method]]
    finding = " ".join(_words(*row) for row in rows)
    heads = [
        "method",
        "E below 8 mm: next throw missed",
        "E of 8 mm or more: next throw missed",
        "rank correlation",
    ]
    return PanelContent(
        finding,
        Drawing(figure, f"First fit's E against the next miss. {finding}"),
        [Table(heads, rows)],
        ["summary.json"],
    )


def _counts(method: str, pairs: Sequence[FirstFit], radius_m: float) -> list[str]:
    cells = []
    for good in (True, False):
        mine = [pair for pair in pairs if (pair.E_m < WARNING_M) == good]
        cells.append(f"{sum(pair.miss_m > radius_m for pair in mine)} of {len(mine)}")
    return [NAMES[method], *cells, UNKNOWN if len(pairs) < 3 else significant(_rank_correlation(pairs), 2)]


def _rank_correlation(pairs: Sequence[FirstFit]) -> float:
    """Return Spearman's correlation of E and miss."""
    ranks = np.argsort(np.argsort(np.array(pairs), axis=0), axis=0)
    if not ranks.std(axis=0).all():
        return float("nan")
    return float(np.corrcoef(ranks[:, 0], ranks[:, 1])[0, 1])


def _words(name: str, good: str, bad: str, _: str) -> str:
    text = f"after a first fit below 8 mm, {good} next throws missed; after a worse one, {bad}."
    return f"{name.capitalize()}: {text}"
