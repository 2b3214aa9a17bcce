"""What it cost: wall time by stage; and whether the first fit warned: its E against the next miss."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.paper import PaperSummary
from strandcast.report.drawing import INK, TARGET, legend_below, log_ticks, new_figure, to_svg
from strandcast.report.figures.paper_counts import NAMES, STYLES
from strandcast.report.numbers import UNKNOWN, significant
from strandcast.report.paper_facts import PaperFacts, StageTime
from strandcast.report.paper_summary import METHODS, chosen
from strandcast.report.reportlet import Reportlet, Table

STAGES = (
    "setup",
    "calibrate",
    "plan",
    "throw",
    "ingest",
    "track",
    "align",
    "judge",
    "estimate",
    "report",
    "summary",
)
WARNING_M = 0.008


def times(key: str, title: str, facts: PaperFacts) -> Reportlet:
    """Return wall and processor time of every stage, by method."""
    if not facts.times:
        raise StrandcastError(
            "SC-H078", "no stage has left its time in a log", fix="run the experiments by Snakemake"
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
    caption = "Seconds a job: median (greatest). Jobs share the machine with each other and with others."
    told = "; ".join(f"{NAMES[m]} {total:.2f} h" for m, total in zip(methods, totals, strict=True))
    return Reportlet(
        key,
        title,
        f"Wall time of all jobs together: {told}.",
        "From the logs beside the results, the last run of every job; no other result holds a time.",
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


class Warned(NamedTuple):
    """E after a run's first fit [m], and the miss of the throw that came next [m]."""

    E_m: float
    miss_m: float


def warned(summary: PaperSummary, method: str) -> list[Warned]:
    """Return E after the first fit and the next miss of every run that went on."""
    pairs = []
    for run in chosen(summary.experiments, method):
        counted = [line for line in run.trials if line.excluded is None]
        for first, following in list(pairwise(counted))[:1]:
            if first.E_m is not None and following.miss_m is not None:
                pairs.append(Warned(first.E_m, following.miss_m))
    return pairs


def first_fit(key: str, title: str, summary: PaperSummary) -> Reportlet:
    """Return the first fit's E against the miss of the throw planned with it."""
    pairs = {method: warned(summary, method) for method in METHODS}
    if not any(pairs.values()):
        raise StrandcastError(
            "SC-H079", "no run went on to a second throw", fix="see the table of trials to hit"
        )
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
        "E from 8 mm on: next throw missed",
        "rank correlation",
    ]
    return Reportlet(
        key,
        title,
        finding,
        "Good: nothing in the upper left, where a good fit is followed by a miss. All targets; runs that "
        "ended with their first throw have no next one.",
        to_svg(figure, key, f"First fit's E against the next miss. {finding}"),
        [Table(heads, rows)],
        ["summary.json"],
    )


def _counts(method: str, pairs: Sequence[Warned], radius_m: float) -> list[str]:
    cells = []
    for good in (True, False):
        mine = [pair for pair in pairs if (pair.E_m < WARNING_M) == good]
        cells.append(f"{sum(pair.miss_m > radius_m for pair in mine)} of {len(mine)}")
    return [NAMES[method], *cells, UNKNOWN if len(pairs) < 3 else significant(_rank_correlation(pairs), 2)]


def _rank_correlation(pairs: Sequence[Warned]) -> float:
    """Return Spearman's correlation of E and miss."""
    ranks = np.argsort(np.argsort(np.array(pairs), axis=0), axis=0)
    if not ranks.std(axis=0).all():
        return float("nan")
    return float(np.corrcoef(ranks[:, 0], ranks[:, 1])[0, 1])


def _words(name: str, good: str, bad: str, _: str) -> str:
    said = f"after a first fit below 8 mm, {good} next throws missed; after a worse one, {bad}."
    return f"{name.capitalize()}: {said}"
