"""Trials to hit (Table 3 of the paper), hit rates with intervals, and misses by trial."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from strandcast.errors import StrandcastError
from strandcast.report.drawing import (
    FITTED,
    INK,
    MEASURED,
    TARGET,
    Drawing,
    legend_below,
    new_figure,
)
from strandcast.report.numbers import HARD, UNKNOWN, millimetres
from strandcast.report.panels.content import PanelContent, Table
from strandcast_studies.paper.figures.log_ticks import log_ticks
from strandcast_studies.paper.records import MissLine, PaperRun, PaperSummary, RateLine
from strandcast_studies.paper.report.summary import METHODS, chosen

# Table 3 of the paper: number of throws up to the hit.
PRINTED_TRIALS = {1: 2, 2: 2, 3: 2, 4: 2, 5: 3, 6: 2, 7: 2}

NAMES = {"paper": "the paper’s method", "default": "defaults"}
STYLES: dict[str, dict[str, Any]] = {
    "paper": FITTED | {"marker": "s", "markersize": 6},
    "default": MEASURED | {"marker": "o", "markersize": 6.5},
}
BESIDE = {"paper": -0.13, "default": 0.13}


def trials_to_hit(summary: PaperSummary) -> PanelContent:
    """Return Table 3: the trial that hit, by string, seed and method, beside the paper's."""
    runs = summary.experiments
    seeds = {method: sorted({run.seed for run in runs if run.method == method}) for method in METHODS}
    heads = ["string", "target", "the paper’s robot"]
    heads += [f"{NAMES[method]}, seed {seed}" for method in METHODS for seed in seeds[method]]
    aims = {(not run.own_target, run.string, run.target) for run in runs}
    rows = [_row(runs, string, target, not other, seeds) for other, string, target in sorted(aims)]
    outcomes = [_outcome(summary, method) for method in METHODS if chosen(runs, method)]
    caption = (
        "Trial that hit, counted from 1; × n: no hit in n trials, with the smallest miss. Rows "
        "below the strings’ own targets: the same string at other targets, as in section VIII."
    )
    return PanelContent(
        " ".join(outcomes) or "Nothing has been thrown yet.",
        tables=[Table(heads, rows, caption)],
        sources=["summary.json"],
    )


def _row(
    runs: Sequence[PaperRun], string: int, target: int, own: bool, seeds: dict[str, list[int]]
) -> list[Any]:
    printed = PRINTED_TRIALS.get(string) if own else None
    row: list[Any] = [f"{string}", f"{target}", UNKNOWN if printed is None else f"{printed}"]
    by_seed = {(run.method, run.seed): run for run in runs if (run.string, run.target) == (string, target)}
    for method in METHODS:
        mine = [by_seed.get((method, seed)) for seed in seeds[method]]
        row += ["" if run is None else _cell(run) for run in mine]
    return row


def _cell(run: PaperRun) -> Any:
    link = Markup('<a href="../{}/report.html">{}</a>')
    if run.state == "unfinished":
        return "unfinished"
    if run.hit_trial is not None:
        text = f"{run.hit_trial}" + (" (then failed)" if run.state == "failed" else "")
        return link.format(run.experiment, text) if run.state == "done" else text
    if run.state == "failed":
        return Markup('<b class="warn">✕ failed</b>')
    known = [line.miss_m for line in run.trials if line.excluded is None and line.miss_m is not None]
    text = f"×{HARD}{len(run.trials)}"
    return link.format(run.experiment, text + (f" ({millimetres(min(known), digits=0)})" if known else ""))


def _outcome(summary: PaperSummary, method: str) -> str:
    """Return a sentence with the number of hits by trial."""
    runs = chosen(summary.experiments, method)
    hits = [run.hit_trial for run in runs if run.hit_trial is not None]
    by = ", ".join(f"{hits.count(trial)} at trial {trial}" for trial in sorted(set(hits)))
    failed = sum(run.state == "failed" for run in runs)
    text = f"{NAMES[method].capitalize()}: {len(hits)} of {len(runs)} runs hit" + (f" ({by})" if by else "")
    return text + (f"; {failed} failed." if failed else ".")


def rates(summary: PaperSummary) -> PanelContent:
    """Return the shares of runs within 50, 20, 10 and 5 mm by trials 1, 2 and 3."""
    lines = [line for line in summary.rates if line.over == "own" and line.trial <= 3]
    if not lines:
        raise StrandcastError("SC-H071", "no string was thrown at its own target", fix="make paper")
    radii = sorted({line.radius_m for line in lines}, reverse=True)
    figure = new_figure(10.0, 3.5, left=0.07, top=0.9, bottom=0.26, wspace=0.12)
    for column, radius_m in enumerate(radii):
        axes = figure.add_subplot(1, len(radii), column + 1)
        for method in METHODS:
            mine = [line for line in lines if line.method == method and line.radius_m == radius_m]
            if mine:
                _draw_rates(axes, method, mine)
        axes.set(ylim=(-3, 103), xlim=(0.5, 3.5), xticks=[1, 2, 3], xlabel="by trial")
        axes.set_title(f"within {radius_m * 1e3:.0f} mm")
        if column:
            axes.tick_params(labelleft=False)
        else:
            axes.set_ylabel("runs [%]")
    legend_below(figure)
    finding = _rates_finding(summary, lines)
    return PanelContent(
        finding,
        Drawing(figure, f"Hit rates by trial. {finding}"),
        [_rates_table(summary, lines, radii)],
        ["summary.json"],
    )


def _rates_finding(summary: PaperSummary, lines: Sequence[RateLine]) -> str:
    parts = []
    for method in METHODS:
        mine = [
            line
            for line in lines
            if line.method == method and abs(line.radius_m - summary.hit_radius_m) < 1e-9 and line.trial < 3
        ]
        if mine:
            parts.append(f"{NAMES[method]} " + ", ".join(map(_share, mine)))
    within = f"Within {millimetres(summary.hit_radius_m, digits=0)} by trials 1 and 2: "
    return within + "; ".join(parts) + "." if parts else ""


def _draw_rates(axes: Any, method: str, lines: Sequence[RateLine]) -> None:
    share = np.array([line.share for line in lines]) * 100
    ends = np.array([[line.low, line.high] for line in lines]) * 100
    axes.errorbar(
        np.array([line.trial for line in lines]) + BESIDE[method],
        share,
        yerr=np.abs(ends.T - share),
        capsize=4,
        label=NAMES[method],
        **STYLES[method],
    )


def _share(line: RateLine) -> str:
    return (
        f"{100 * line.share:.0f}{HARD}% ({line.hits}/{line.runs}; {100 * line.low:.0f}–{100 * line.high:.0f})"
    )


def _rates_table(summary: PaperSummary, lines: Sequence[RateLine], radii: Sequence[float]) -> Table:
    rows = []
    for method in METHODS:
        for trial in (1, 2, 3):
            mine = {line.radius_m: line for line in lines if line.method == method and line.trial == trial}
            if mine:
                rows.append([NAMES[method], f"{trial}", *(_share(mine[radius]) for radius in radii)])
    heads = ["method", "by trial", *(f"{radius * 1e3:.0f} mm" for radius in radii)]
    return Table(heads, rows, "Share (hits/runs; 95 % interval).")


def misses(summary: PaperSummary) -> PanelContent:
    """Return the miss of every throw by trial, with median, p90 and greatest."""
    runs = summary.experiments
    lines = [line for line in summary.misses if line.over == "own"]
    if not any(line.known for line in lines):
        raise StrandcastError("SC-H072", "no throw's miss is known", fix="look at the runs' pages")
    figure = new_figure(10.0, 4.2, left=0.07, top=0.96, bottom=0.2)
    axes = figure.add_subplot()
    axes.axhline(
        summary.hit_radius_m * 1e3, color=TARGET, linewidth=1.4, linestyle=(0, (6, 3)), label="hit radius"
    )
    for method in METHODS:
        _draw_misses(axes, method, chosen(runs, method, "own"), lines)
    axes.set(yscale="log", xlabel="trial", ylabel="miss [mm]")
    axes.set_xticks(range(1, max(line.trial for line in lines) + 1))
    log_ticks(axes.yaxis, within=(1.0, 2.0, 5.0))
    legend_below(figure)
    second = [
        f"{NAMES[line.method]}: {millimetres(line.median_m)} (p90 {millimetres(line.p90_m)}, n = "
        f"{line.known})"
        for line in lines
        if line.of == "thrown" and line.trial == 2 and line.known
    ]
    finding = (
        "Median miss of the second throw, where one was made: " + "; ".join(second) + "." if second else ""
    )
    return PanelContent(
        finding,
        Drawing(figure, f"Miss of every throw by trial. {finding}"),
        [_misses_table(lines, "thrown"), _misses_table(lines, "nearest")],
        ["summary.json"],
    )


def _draw_misses(axes: Any, method: str, runs: Sequence[PaperRun], lines: Sequence[MissLine]) -> None:
    points = [
        (line.trial, line.miss_m * 1e3)
        for run in runs
        for line in run.trials
        if line.excluded is None and line.miss_m is not None
    ]
    if not points:
        return
    trial, miss_mm = np.array(points).T
    spread = 0.09 * (np.arange(len(trial)) % 5 - 2) / 2  # separates equal misses
    style = STYLES[method]
    axes.plot(
        trial + BESIDE[method] + spread,
        np.maximum(miss_mm, 0.05),
        linestyle="none",
        marker=style["marker"],
        markersize=5,
        markerfacecolor="none",
        color=style["color"],
        label=NAMES[method],
    )
    for line in lines:
        if line.method == method and line.of == "thrown" and line.median_m is not None:
            middle = line.trial + BESIDE[method]
            axes.plot([middle - 0.11, middle + 0.11], [line.median_m * 1e3] * 2, color=INK, linewidth=2.2)


def _misses_table(lines: Sequence[MissLine], of: str) -> Table:
    rows = [
        [
            NAMES[line.method],
            f"{line.trial}",
            f"{line.known}" + (f" (+{line.unknown} unknown)" if line.unknown else ""),
            *map(millimetres, (line.median_m, line.p90_m, line.max_m)),
        ]
        for line in lines
        if line.of == of
    ]
    caption = "Miss of the throws made." if of == "thrown" else "Nearest so far, of every run."
    return Table(
        ["method", "trial", "throws" if of == "thrown" else "runs", "median", "p90", "greatest"],
        rows,
        caption,
    )
