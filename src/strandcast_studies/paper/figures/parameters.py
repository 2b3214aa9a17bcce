"""Parameters of one string fitted at several targets (Fig. 11 of the paper), and the fits' predictions."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.report.drawing import (
    FITTED,
    INK,
    MEASURED,
    PLANNED,
    TRUE,
    Drawing,
    legend_below,
    new_figure,
)
from strandcast.report.numbers import UNKNOWN, millimetres
from strandcast.report.panels.content import PanelContent, Table
from strandcast_studies.paper.figures.counts import NAMES
from strandcast_studies.paper.figures.log_ticks import log_ticks
from strandcast_studies.paper.report.runs import RunResults
from strandcast_studies.paper.report.summary import METHODS

# Colour and marker by target: readable without colour vision.
STYLES = (
    {"color": MEASURED["color"], "marker": "o"},
    {"color": FITTED["color"], "marker": "s"},
    {"color": PLANNED["color"], "marker": "^"},
    {"color": "#808890", "marker": "v"},
    {"color": TRUE["color"], "marker": "D"},
)
# Fig. 11a: k_h and k_sh over c_h and c_sh; Fig. 11b: k_s over c_s.
PANELS = (
    (("c_h", "k_h"), "c_h [Nms/rad/kg]", "k_h [Nm/rad/kg]"),
    (("c_sh", "k_sh"), "c_sh [Nms/rad/kg]", "k_sh [Nm/rad/kg]"),
    (("c_s", "k_s"), "c_s [Ns/m/kg]", "k_s [N/m/kg]"),
)


def several_targets(runs: Sequence[RunResults], method: str) -> list[RunResults]:
    """Return the finished runs of the string thrown at several targets, for the lowest seed."""
    groups: dict[tuple[int, int], list[RunResults]] = {}
    for each in runs:
        if (each.run.method, each.run.state) == (method, "done"):
            groups.setdefault((each.run.seed, each.run.string), []).append(each)
    several = [groups[key] for key in sorted(groups) if len(groups[key]) > 1]
    return sorted(several[0], key=lambda each: each.run.target) if several else []


def parameters(runs: Sequence[RunResults]) -> PanelContent:
    """Return the fitted parameters by target, with their ensembles, one row of panels for each method."""
    shown = {method: several_targets(runs, method) for method in METHODS}
    methods = [method for method in METHODS if shown[method]]
    if not methods:
        raise StrandcastError("SC-H075", "no string was thrown at several targets", fix="make paper")
    height = 0.9 + 2.7 * len(methods)
    figure = new_figure(
        10.0, height, left=0.08, top=1 - 0.3 / height, bottom=0.95 / height, wspace=0.35, hspace=0.45
    )
    apart = {}
    for row, method in enumerate(methods):
        for column, (names, x_label, y_label) in enumerate(PANELS):
            axes = figure.add_subplot(len(methods), len(PANELS), row * len(PANELS) + column + 1)
            for each in shown[method]:
                _draw(axes, each, names)
            axes.set(xscale="log", yscale="log", xlabel=x_label, ylabel=y_label)
            log_ticks(axes.xaxis, axes.yaxis)
            if column == 0:
                axes.set_title(NAMES[method])
        apart[method] = _apart(shown[method])
    legend_below(figure)
    first = shown[methods[0]][0].run
    finding = (
        f"String {first.string}, seed {first.seed}, at targets "
        + ", ".join(f"{each.run.target}" for each in shown[methods[0]])
        + ": the estimates of one parameter differ by up to (decades) "
        + "; ".join(f"{apart[method]}, {NAMES[method]}" for method in methods)
        + "."
    )
    return PanelContent(
        finding,
        Drawing(figure, f"Fitted parameters by target. {finding}"),
        sources=[f"../{each.run.experiment}/report.html" for method in methods for each in shown[method]],
    )


def _draw(axes: Any, each: RunResults, names: tuple[str, str]) -> None:
    estimate, ensemble = each.estimate(), each.ensemble()
    style = STYLES[(each.run.target - 1) % len(STYLES)]
    if ensemble is not None:
        axes.plot(
            ensemble[names[0]], ensemble[names[1]], linestyle="none", markersize=3.2, alpha=0.6, **style
        )
    if estimate is not None:
        values = estimate.string.parameters
        style = style | {"linestyle": "none", "markersize": 9, "markeredgecolor": INK, "markeredgewidth": 0.8}
        axes.plot(values[names[0]], values[names[1]], label=f"target {each.run.target}", **style)


def _apart(group: Sequence[RunResults]) -> str:
    """Return the fits' differences in decades, for the parameter that differs most and for k_s."""
    fits = [estimate.string.parameters for each in group if (estimate := each.estimate()) is not None]
    if len(fits) < 2:
        return UNKNOWN
    names = [name for pair, _, _ in PANELS for name in pair]
    decades = {name: float(np.ptp(np.log10([max(fit[name], 1e-300) for fit in fits]))) for name in names}
    worst = max(decades, key=lambda name: decades[name])
    return f"{decades[worst]:.1f} in {worst}, {decades['k_s']:.1f} in k_s"


def transfer(runs: Sequence[RunResults]) -> PanelContent:
    """Return E of every target's throw with every target's fit."""
    tables, sources, medians = [], [], []
    for method in METHODS:
        group = [each for each in several_targets(runs, method) if each.transfer() is not None]
        if not group:
            continue
        tables.append(_matrix(group, method))
        sources += [f"../{each.run.experiment}/transfer.json" for each in group]
        medians.append(f"{NAMES[method]}: {_own_and_other(group)}")
    if not tables:
        raise StrandcastError("SC-H076", "no fit was applied to another target's throw", fix="make paper")
    return PanelContent(
        "Median E, the fit’s own throw against another target’s: " + "; ".join(medians) + ".",
        tables=tables,
        sources=sources,
    )


def _matrix(group: Sequence[RunResults], method: str) -> Table:
    targets = [each.run.target for each in group]
    place = {each.run.experiment: each.run.target for each in group}
    rows = []
    for each in group:
        record = each.transfer()
        assert record is not None
        fits = {place[fit.experiment]: fit for fit in record.fits if fit.experiment in place}
        cells = []
        for target in targets:
            fit = fits.get(target)
            known = [] if fit is None else [value for value in fit.ensemble_E_m if value is not None]
            text = UNKNOWN if fit is None else millimetres(fit.E_m)
            cells.append(text + (f" ({1e3 * min(known):.1f} … {1e3 * max(known):.1f})" if known else ""))
        rows.append([f"target {each.run.target}, trial {record.trial}", *cells])
    caption = f"{NAMES[method].capitalize()}, string {group[0].run.string}, seed {group[0].run.seed}."
    return Table(["throw at", *(f"fitted at target {target}" for target in targets)], rows, caption)


def _own_and_other(group: Sequence[RunResults]) -> str:
    own: list[float] = []
    other: list[float] = []
    for each in group:
        record = each.transfer()
        assert record is not None
        for fit in record.fits:
            if fit.E_m is not None:
                (own if fit.experiment == record.experiment else other).append(fit.E_m)
    middle = [millimetres(float(np.median(values)) if values else None) for values in (own, other)]
    return " against ".join(middle)
