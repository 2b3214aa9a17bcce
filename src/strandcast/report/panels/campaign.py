"""The figures of a campaign's page: misses by throw, hits and best misses, and the rig by experiment."""

from typing import Any

import numpy as np

from strandcast.report import drawing as draw
from strandcast.report.campaign import RIG_QUANTITIES, Campaign, RigQuantity
from strandcast.report.numbers import millimetres, percent, signed
from strandcast.report.panels.content import PanelContent, Table

BAND = (0.1, 0.9)  # quantiles; four of five throws lie between them
WIDTH = 0.36  # of the places of one throw, on either side
MOST_MEDIANS = 5  # in the sentence
MOST_NAMES = 26  # of experiments on an axis


def throw_misses(campaign: Campaign) -> PanelContent:
    """Return every known miss by throw, with the median and the band of four in five."""
    by_throw = campaign.misses_by_throw()
    count = len(campaign.experiments)
    figure = draw.new_figure(8.4, 4.0, top=0.96, bottom=0.2)
    axes = figure.add_subplot()
    band: dict[str, Any] = {"color": draw.MEASURED["color"], "alpha": 0.25, "lw": 0}
    median: dict[str, Any] = {"color": draw.MEASURED["color"], "linewidth": 2.4}
    rows = []
    unknown = _unknown_by_throw(campaign)
    for throw in range(1, campaign.most_throws() + 1):
        misses = by_throw.get(throw, [])
        rows.append([f"throw {throw}", len(misses), unknown[throw], *_quantiles([m for _, m in misses])])
        if not misses:
            continue
        place = [throw + WIDTH * (2.0 * (position + 0.5) / count - 1.0) for position, _ in misses]
        values_mm = [1e3 * miss for _, miss in misses]
        low, middle, high = np.quantile(values_mm, (BAND[0], 0.5, BAND[1]))
        axes.plot(place, values_mm, **draw.marks("o", 2.2, color=draw.GREY, alpha=0.7), label="_")
        axes.fill_between([throw - WIDTH, throw + WIDTH], low, high, **band)
        axes.plot([throw - WIDTH, throw + WIDTH], [middle] * 2, **median)
    axes.plot([], [], **draw.marks("o", 3, color=draw.GREY), label="a throw")
    axes.plot([], [], **median, label="median")
    axes.fill_between([], [], [], **band, label="four of five throws")
    _hit_radius(axes, campaign)
    axes.set(xlabel="throw", ylabel="miss [mm]", ylim=(0, None))
    all_mm = [1e3 * miss for misses in by_throw.values() for _, miss in misses if miss > 0.0]
    draw.log_if_wide(axes, "y", all_mm)
    _throw_axis(axes, campaign)
    draw.legend_below(figure)
    known = sum(map(len, by_throw.values()))
    middles = [f"{1e3 * np.median([m for _, m in misses]):.1f}" for misses in by_throw.values()]
    middles = [*middles[:MOST_MEDIANS], "…", middles[-1]] if len(middles) > MOST_MEDIANS + 1 else middles
    finding = f"Median miss by throw: {' → '.join(middles) or 'none known'} mm, of {known} known misses."
    if more := sum(unknown.values()):
        finding += f" {more} more {'is' if more == 1 else 'are'} unknown."
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Miss of every throw. {finding}"),
        tables=[Table(["throw", "known", "unknown", "10 %", "median", "90 %", "largest"], rows)],
    )


def learning(campaign: Campaign) -> PanelContent:
    """Return the share of experiments that have hit, and the best miss so far, by throw."""
    shares = campaign.hit_shares()
    figure = draw.new_figure(8.4, 3.8, top=0.92, bottom=0.2, wspace=0.22)
    left, right = figure.subplots(1, 2)
    throws = [each.throw for each in shares if each.known]
    values = np.array([[100.0 * s.hits / s.known, 100.0 * s.low, 100.0 * s.high] for s in shares if s.known])
    if len(values):
        middle, low, high = values.T
        errors = [np.maximum(middle - low, 0.0), np.maximum(high - middle, 0.0)]
        left.errorbar(throws, middle, errors, **draw.MEASURED, marker="o", capsize=4)
    left.set(title="experiments that have hit [%]", xlabel="throw", ylim=(-3, 103))
    best = {throw: misses for throw, misses in campaign.best_so_far().items() if misses}
    if best:
        lines_mm = (
            np.array([np.quantile(misses, (BAND[0], 0.5, BAND[1])) for misses in best.values()]).T * 1e3
        )
        right.fill_between(list(best), lines_mm[0], lines_mm[2], color=draw.FITTED["color"], alpha=0.25, lw=0)
        right.plot(list(best), lines_mm[1], **draw.FITTED, marker="o", markersize=4)
        draw.log_if_wide(right, "y", [each for each in lines_mm.ravel() if each > 0.0])
    _hit_radius(right, campaign)
    right.set(title="best miss so far [mm]: median, four of five", xlabel="throw")
    for axes in (left, right):
        _throw_axis(axes, campaign, most_ticks=10)
    if not throws:
        finding = "No experiment has a known outcome."
    else:
        last = next(each for each in reversed(shares) if each.known)
        interval = f"{percent(last.low)} to {percent(last.high)}"
        finding = (
            f"By throw {last.throw}, {last.hits} of {last.known} experiments with a known outcome have hit: "
            f"{percent(last.hits / last.known)} (95 % interval: {interval})."
        )
    rows = [
        [f"throw {s.throw}", s.hits, s.known, s.unknown, f"{percent(s.low)} to {percent(s.high)}"]
        for s in shares
    ]
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Share of experiments that have hit, and best miss, by throw. {finding}"),
        tables=[Table(["by throw", "have hit", "known", "unknown", "Wilson, 95 %"], rows)],
    )


def rig_course(campaign: Campaign) -> PanelContent:
    """Return the quantities of the rig by experiment: median, extremes, limit; captures are left out."""
    campaign = Campaign([each for each in campaign.experiments if each.aimed])
    names = [each.name for each in campaign.experiments]
    figure = draw.new_figure(
        8.4, 0.7 + 1.45 * len(RIG_QUANTITIES), left=0.11, top=0.96, bottom=0.17, hspace=0.45
    )
    panels = figure.subplots(len(RIG_QUANTITIES), 1, sharex=True)
    rows = []
    beyond, unknown = set(), 0
    for axes, quantity in zip(panels, RIG_QUANTITIES, strict=True):
        verdicts = {(e.name, t.trial): quantity.is_good(t) for e in campaign.experiments for t in e.throws}
        bad = [key for key, good in verdicts.items() if good is False]
        beyond |= set(bad)
        lacking = sum(good is None for good in verdicts.values())
        unknown += lacking
        known = _draw_quantity(axes, campaign, quantity)
        limit = quantity.limit * quantity.factor
        bound = f"{'≥' if quantity.is_least else '≤'} {limit:g} {quantity.unit}"
        texts = (f"{np.median(known):.3g}", f"{min(known):.3g} to {max(known):.3g}") if known else ("–", "–")
        rows.append([f"{quantity.name} [{quantity.unit}]", *map(signed, texts), bound, len(bad), lacking])
    step = -(-len(names) // MOST_NAMES)
    panels[-1].set_xticks(range(0, len(names), step), names[::step], rotation=60, ha="right", fontsize=8)
    panels[-1].set_xlim(-0.6, len(names) - 0.4)
    total = sum(len(each.throws) for each in campaign.experiments)
    finding = f"{len(beyond)} of {total} throws have a quantity of the rig beyond its limit."
    if unknown:
        finding += f" {unknown} of {total * len(RIG_QUANTITIES)} values are unknown."
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Quantities of the rig by experiment. {finding}"),
        tables=[Table(["quantity", "median", "range", "good", "beyond", "unknown"], rows)],
    )


def _draw_quantity(axes: Any, campaign: Campaign, quantity: RigQuantity) -> list[float]:
    """Draw one quantity of all experiments; return its known values."""
    known = []
    groups: dict[bool, list[tuple[int, float, float, float]]] = {True: [], False: []}
    for position, each in enumerate(campaign.experiments):
        values = [value for line in each.throws if (value := quantity.of(line)) is not None]
        if values:
            known += values
            good = all(quantity.is_good(line) is not False for line in each.throws)
            groups[good].append((position, min(values), float(np.median(values)), max(values)))
    for good, found in groups.items():
        if found:
            place, low, middle, high = zip(*found, strict=True)
            style = draw.MEASURED if good else draw.FITTED
            axes.vlines(place, low, high, color=style["color"], linewidth=1.6)
            marks = draw.marks("o" if good else "X", 4 if good else 6, color=style["color"])
            axes.plot(place, middle, **marks)
    limit = quantity.limit * quantity.factor
    sides = (limit, -limit) if any(value < 0.0 for value in known) else (limit,)
    for side in sides:
        axes.axhline(side, color=draw.INK, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.set_title(f"{quantity.name} [{quantity.unit}]", fontsize=8.5, pad=3)
    axes.yaxis.set_major_locator(draw.few_ticks())
    axes.margins(y=0.15)  # marks at the least value stay clear of the axis
    return known


def _unknown_by_throw(campaign: Campaign) -> dict[int, int]:
    throws = [each.throw for each in campaign.trials() if each.throw is not None and each.line.miss_m is None]
    return {throw: throws.count(throw) for throw in range(1, campaign.most_throws() + 1)}


def _quantiles(misses_m: list[float]) -> list[str]:
    if not misses_m:
        return [millimetres(None)] * 4
    return [millimetres(float(value)) for value in np.quantile(misses_m, (BAND[0], 0.5, BAND[1], 1.0))]


def _hit_radius(axes: Any, campaign: Campaign) -> None:
    """Draw the hit radius, if all experiments have the same."""
    radii = {each.summary.hit_radius_m for each in campaign.experiments if each.summary is not None}
    if len(radii) == 1:
        axes.axhline(1e3 * radii.pop(), **draw.HIT_RADIUS, label="hit radius")


def _throw_axis(axes: Any, campaign: Campaign, most_ticks: int = 20) -> None:
    most = max(campaign.most_throws(), 1)
    axes.set_xticks(range(1, most + 1, -(-most // most_ticks)))
    axes.set_xlim(0.5, most + 0.5)
