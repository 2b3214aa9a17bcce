"""The error budget: misses with causes of error switched off, and the causes of the worst throws."""

from collections.abc import Sequence

import numpy as np

from strandcast.report.drawing import INK, MEASURED, TARGET, Drawing, legend_below, new_figure
from strandcast.report.numbers import millimetres
from strandcast.report.panels.content import PanelContent, Table
from strandcast_studies.paper.figures.log_ticks import log_ticks
from strandcast_studies.paper.records import BudgetThrow, ErrorBudget, MissWithout

NONE = "none"
SHOWN = 2  # the trial that the figure shows
WORST = 6
LEAST_MM = 0.05  # of the axis


def budget(made: ErrorBudget, hit_radius_m: float) -> PanelContent:
    """Return the misses of the second throws with each cause switched off, and the worst throws."""
    lines = [line for line in made.without if line.trial == SHOWN]
    throws = [one for one in made.throws if one.trial == SHOWN]
    figure = new_figure(9.0, 0.6 + 0.42 * len(lines), left=0.2, top=0.97, bottom=0.28)
    axes = figure.add_subplot()
    spread = np.random.default_rng(0).uniform(-0.25, 0.25, len(throws))
    for row, line in enumerate(lines):
        miss_mm = np.array([1e3 * one.miss_m[line.cause] for one in throws])
        style = MEASURED | {"linestyle": "none", "marker": "o", "markersize": 4, "markerfacecolor": "none"}
        label = "one throw" if row == 0 else None
        axes.plot(np.maximum(miss_mm, LEAST_MM), row + spread, **style, label=label)
        for value_m, width, name in ((line.median_m, 2.6, "median"), (line.p90_m, 1.2, "p90")):
            x = max(1e3 * value_m, LEAST_MM)
            axes.plot([x, x], [row - 0.38, row + 0.38], color=INK, lw=width, label=None if row else name)
    axes.axvline(1e3 * hit_radius_m, color=TARGET, linewidth=1.4, linestyle=(0, (6, 3)), label="hit radius")
    axes.set(xscale="log", xlabel="miss of the second throw [mm]", ylim=(len(lines) - 0.5, -0.5))
    axes.set_yticks(range(len(lines)), [_without(line.cause) for line in lines])
    log_ticks(axes.xaxis, within=(1.0, 2.0, 5.0))
    legend_below(figure)
    finding = _finding(lines)
    return PanelContent(
        finding,
        Drawing(figure, f"Misses with causes switched off. {finding}"),
        [_table(made), _worst(throws)],
        ["../error-budget.json"],
    )


def _without(cause: str) -> str:
    return "all causes" if cause == NONE else f"without {cause}"


def _finding(lines: Sequence[MissWithout]) -> str:
    # Quantiles, as a single large miss can dominate an rms.
    every = next(line for line in lines if line.cause == NONE)
    others = [f"{_without(line.cause)} {millimetres(line.p90_m)}" for line in lines if line is not every]
    return (
        f"Median miss of second throws {millimetres(every.median_m)}, p90 {millimetres(every.p90_m)}; "
        f"p90 {', '.join(others)}."
    )


def _signed(value_m: float) -> str:
    return ("−" if value_m < 0.0 else "") + millimetres(abs(value_m))


def _table(made: ErrorBudget) -> Table:
    trials = sorted({line.trial for line in made.without})
    rows = []
    for cause in dict.fromkeys(line.cause for line in made.without):
        row = [_without(cause)]
        for trial in trials:
            line = next(one for one in made.without if (one.cause, one.trial) == (cause, trial))
            row += [millimetres(line.median_m), millimetres(line.p90_m), millimetres(line.rms_m)]
            row.append("" if cause == NONE else _signed(line.cause_rms_m))
        rows.append(row)
    heads = [""]
    for trial in trials:
        heads += [f"throw {trial}: median", "p90", "rms", "the cause adds"]
    count = max((line.throws for line in made.without), default=0)
    return Table(heads, rows, f"Misses of {count} throws.")


def _worst(throws: Sequence[BudgetThrow]) -> Table:
    """Return the second throws with the largest misses, and the cause that halves them if switched off."""
    worst = sorted(throws, key=lambda one: -one.miss_m[NONE])[:WORST]
    causes = list(throws[0].miss_m) if throws else [NONE]
    rows = []
    for one in worst:
        single = [cause for cause in causes if cause != NONE and not cause.startswith("all but")]
        least = min(single, key=lambda cause: one.miss_m[cause])
        rows.append(
            [
                f"{one.string}",
                f"{one.seed}",
                *(millimetres(one.miss_m[cause]) for cause in causes),
                least if one.miss_m[least] < 0.5 * one.miss_m[NONE] else "none alone",
            ]
        )
    heads = ["string", "seed", *(_without(cause) for cause in causes), "halved without"]
    return Table(heads, rows, "The second throws with the largest misses.")
