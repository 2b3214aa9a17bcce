"""The estimated string: parameters in their ranges, and the masses along it."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from strandcast.records.estimate import Estimate, ParameterFit
from strandcast.report.drawing import FITTED, MEASURED, new_figure, to_svg
from strandcast.report.facts import Facts
from strandcast.report.numbers import significant
from strandcast.report.reportlet import Reportlet, Table
from strandcast.report.results import Results


def parameters(key: str, title: str, results: Results) -> Reportlet:
    """Return the table of the parameters: range, estimate, exponent χ of eq. 2, bound, near-best spread."""
    estimate: Estimate = results.need("estimate")
    rows = [
        [
            fit.name,
            fit.unit,
            significant(fit.minimum),
            significant(fit.maximum),
            Markup("<b>{}</b>").format(significant(fit.value)),
            Markup("{:.2f} {}").format(fit.exponent, _bar(fit)),
            Markup('<b class="warn">▲ at bound</b>') if fit.at_bound else "within",
            f"{significant(fit.ensemble_low)} … {significant(fit.ensemble_high)}",
            *_known(estimate, fit.name),
        ]
        for fit in estimate.parameters
    ]
    rows += [
        [name, "", "", "", significant(value), "", "", "", *_known(estimate, name)]
        for name, value in sorted(estimate.options.items())
    ]
    bound = [fit.name for fit in estimate.parameters if fit.at_bound]
    wide = [fit.name for fit in estimate.parameters if _decades(fit) > 1.0]
    finding = f"At a bound: {', '.join(bound)}." if bound else "No parameter lies at a bound."
    finding += (
        f" Near-best strings differ by more than a factor of ten in {', '.join(wide)}: this throw does not "
        "tell them."
        if wide
        else " Every parameter is told to within a factor of ten by the near-best strings."
    )
    heads = ["parameter", "unit", "least", "greatest", "estimate", "χ (0 … 1)", "bound", "near-best strings"]
    heads += ["standard deviation", "profile"]
    caption = (
        f"Ranges: {estimate.ranges}; reading of compression and tension: {estimate.reading}; per kg of a "
        "plain point. In the bar: the whole range, the near-best strings' spread, the estimate. "
        + _known_caption(estimate)
    )
    return Reportlet(
        key,
        title,
        finding,
        "Only ratios can be known: masses and coefficients may all be scaled together. Good: estimates "
        "inside their ranges, narrow spreads. Bad: an estimate at a bound wants a wider range.",
        tables=[Table(heads, rows, caption)],
        sources=["estimate.json", "ensemble.parquet"],
    )


def _known(estimate: Estimate, name: str) -> list[str]:
    """Return the standard deviation and the profile interval of an unknown, empty where not known."""
    known = estimate.knowledge
    if known is None or name not in known.unknowns:
        return ["", ""]
    k = known.unknowns.index(name)
    deviation = significant(known.marginal_sd[k]) + (" decades" if known.in_decades[k] else "")
    low, high = known.profile_low[k], known.profile_high[k]
    if low is None or high is None:
        return [deviation, ""]
    below = "≤ " if known.profile_low_open[k] else ""
    above = "≥ " if known.profile_high_open[k] else ""
    return [deviation, f"{below}{significant(low)} … {above}{significant(high)}"]


def _known_caption(estimate: Estimate) -> str:
    known = estimate.knowledge
    if known is None:
        return ""
    gauge = "" if known.gauge_fixed else " The common scale of masses and coefficients was held for it."
    return (
        f"Standard deviation: by the Fisher information at residuals of {known.noise_m * 1e3:.2f} mm, of "
        f"which {known.measurements_per_datum:.0f} count as one, and the range.{gauge} Profile: as far as E "
        f"rises by {known.profile_rise:.0%} while all others are fitted again; ≤ and ≥: it goes on."
    )


def _decades(fit: ParameterFit) -> float:
    if min(fit.ensemble_low, fit.ensemble_high) <= 0:
        return 0.0
    return float(np.log10(fit.ensemble_high / fit.ensemble_low))


def _exponent(fit: ParameterFit, value: float) -> float:
    """Return χ of eq. 2, P = P_min (P_max/P_min)^χ, for a value of a parameter's range."""
    if min(value, fit.minimum) <= 0 or fit.maximum <= fit.minimum:
        return 0.0
    return float(np.clip(np.log(value / fit.minimum) / np.log(fit.maximum / fit.minimum), 0.0, 1.0))


def _bar(fit: ParameterFit) -> Markup:
    low, high = (100 * _exponent(fit, value) for value in (fit.ensemble_low, fit.ensemble_high))
    return Markup(
        '<svg class="bar" viewBox="0 0 100 12" aria-hidden="true">'
        '<rect class="range" y="5" width="100" height="2"/>'
        '<rect class="spread" x="{:.1f}" y="3" width="{:.1f}" height="6"/>'
        '<rect class="value" x="{:.1f}" width="3" height="12"/></svg>'
    ).format(low, max(high - low, 0.8), 97 * min(max(fit.exponent, 0.0), 1.0))


def masses(key: str, title: str, results: Results, facts: Facts) -> Reportlet:
    """Return the relative masses along the string, with the places where weights and pipes truly are."""
    estimate: Estimate = results.need("estimate")
    spacing_mm = estimate.length_m / estimate.points * 1e3
    places_mm = np.arange(1, estimate.points + 1) * spacing_mm
    masses = np.array(estimate.string.masses)
    figure = new_figure(8.4, 3.2, top=0.9, bottom=0.17)
    axes = figure.add_subplot()
    base = min(0.5, 0.7 * float(masses.min()))
    axes.bar(
        places_mm, masses - base, 0.7 * spacing_mm, bottom=base, color=MEASURED["color"], label="estimate"
    )
    axes.set(xlabel="place along the string from the hand [mm]", ylabel="relative mass [1]", yscale="log")
    axes.set_ylim(base, float(masses.max()) * 2.5)
    axes.yaxis.set_major_formatter("{x:g}")
    for x_mm, mass in zip(places_mm, masses, strict=True):
        if mass > 1.3 * float(np.median(masses)):
            axes.annotate(significant(mass), (x_mm, mass), ha="center", va="bottom", fontsize=8)
    top = axes.get_xaxis_transform()
    true_mm = [place * 1e3 for place in facts.weight_places_m]
    axes.plot(
        true_mm,
        [0.97] * len(true_mm),
        linestyle="none",
        marker="v",
        markersize=8,
        color=FITTED["color"],
        transform=top,
    )
    for from_m, to_m in facts.stiff_sections_m:
        axes.axvspan(
            from_m * 1e3,
            to_m * 1e3,
            facecolor="none",
            edgecolor="#e69f00",
            hatch="////",
            linewidth=0,
            zorder=0.5,
        )
    finding = _masses_finding(estimate, facts.weight_places_m)
    heads = ["kind", "place [mm]", "relative mass", "range", "bound", "near-best strings"]
    rows = [
        [
            weight.kind,
            f"{weight.place_m * 1e3:.0f}",
            significant(weight.value),
            f"{significant(weight.minimum)} … {significant(weight.maximum)}",
            Markup('<b class="warn">▲ at bound</b>') if weight.at_bound else "within",
            f"{significant(weight.ensemble_low)} … {significant(weight.ensemble_high)}",
        ]
        for weight in estimate.weights
    ]
    return Reportlet(
        key,
        title,
        finding,
        "Point i lies at i·L/n from the hand (point 0); a plain point has mass 1. Triangles: the "
        "experiment's known weights; hatched: its stiff sections. As in the paper's Table 4, a stiff "
        "section shows as mass.",
        to_svg(figure, key, f"Relative masses along the string. {finding}"),
        [Table(heads, rows)] if rows else [],
        ["estimate.json"],
    )


def _masses_finding(estimate: Estimate, weight_places_m: list[float]) -> str:
    masses = np.array(estimate.string.masses)
    if masses.max() <= masses.min() * (1 + 1e-9):
        return "All points weigh the same."
    heaviest = int(np.argmax(masses))
    place_mm = (heaviest + 1) * estimate.length_m / estimate.points * 1e3
    finding = (
        f"The heaviest point is m{heaviest + 1} = {significant(float(masses[heaviest]))} at {place_mm:.0f} mm"
    )
    if not weight_places_m:
        return f"{finding}; the experiment names no weight."
    nearest_mm = min(weight_places_m, key=lambda place: abs(place * 1e3 - place_mm)) * 1e3
    return f"{finding}; the nearest known weight is at {nearest_mm:.0f} mm."
