"""The estimated string: its parameters within their ranges, and the masses along it."""

from typing import Any

import numpy as np
from markupsafe import Markup

from strandcast.core.strings import PARAMETERS
from strandcast.records.estimate import Estimate, ParameterFit, WeightFit
from strandcast.report.drawing import ALONG_STRING, FITTED, HAND, MEASURED, Drawing, marks, new_figure
from strandcast.report.facts import Facts
from strandcast.report.numbers import significant
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData, with_caveat
from strandcast.report.typeset import quantity, symbol, unit


def parameters(page: TrialPageData) -> PanelContent:
    """Return the table of the parameters: range, estimate, exponent χ of eq. 2, bound, ensemble."""
    results = page.results
    estimate: Estimate = results.need("estimate")
    rows = [
        [
            symbol(fit.name),
            unit(fit.unit),
            f"{significant(fit.minimum)} … {significant(fit.maximum)}",
            Markup("<b>{}</b>").format(significant(fit.value)),
            Markup("{:.2f} {}").format(fit.exponent, _bar(fit)),
            *_bound_and_ensemble(fit, page),
            *_known(estimate, fit.name),
        ]
        for fit in estimate.parameters
    ]
    rows += [_option_row(estimate, name, value) for name, value in sorted(estimate.options.items())]
    heads = ["parameter", "unit", "range", "estimate", "χ (0 … 1)", "bound", "ensemble"]
    heads += ["standard deviation", "interval"]
    caption = (
        f"Ranges: {estimate.ranges}; reading of compression and tension: {estimate.reading}; per kg of a "
        "plain point. The bar shows the range, the spread of the ensemble, and the estimate. "
        + _known_caption(estimate)
    )
    return PanelContent(
        with_caveat(page, _finding(estimate)),
        tables=[Table(heads, rows, caption)],
        sources=["estimate.json", "ensemble.parquet"],
    )


def _finding(estimate: Estimate) -> str:
    bound = [fit.name for fit in estimate.parameters if fit.at_bound]
    wide = [fit.name for fit in estimate.parameters if _decades(fit) > 1.0]
    finding = f"At a bound: {', '.join(bound)}." if bound else "No parameter lies at a bound."
    if (undetermined := estimate.undetermined_in_words()) is not None:
        return f"{finding} {undetermined[0].upper()}{undetermined[1:]}."
    if not wide:
        return f"{finding} The strings of the ensemble agree on every parameter within a factor of ten."
    names = ", ".join(wide)
    return (
        f"{finding} The strings of the ensemble differ by more than a factor of ten in {names}: this throw "
        "does not determine them."
    )


def _bound_and_ensemble(fit: ParameterFit | WeightFit, page: TrialPageData) -> list[str]:
    """Return the cells "bound" and "ensemble" of an estimated number."""
    return [_bound(fit, page), f"{significant(fit.ensemble_low)} … {significant(fit.ensemble_high)}"]


def _bound(fit: ParameterFit | WeightFit, page: TrialPageData) -> str:
    """Return whether an estimate lies at a bound, and whether a wider range would help."""
    if not fit.at_bound:
        return "within"
    if page.caveat is not None:
        return Markup('<b class="warn">▲ at bound</b>, {}').format(page.caveat)
    estimate: Estimate = page.results.need("estimate")
    if isinstance(fit, ParameterFit) and any(text.startswith(f"{fit.name} ") for text in estimate.warnings):
        return Markup('<b class="warn">▲ at bound</b>: widen estimate.ranges.{}').format(fit.name)
    return "at bound: leave it"


def _option_row(estimate: Estimate, name: str, value: float) -> list[Any]:
    """Return the row of a number beside the parameters, e.g. the rest curl."""
    words, text = quantity(name, value)
    return [words, "", "", Markup("<b>{}</b>").format(text), "", "", "", *_known(estimate, name)]


def _known(estimate: Estimate, name: str) -> list[str]:
    """Return the standard deviation and the interval of an unknown, empty where not known."""
    known = estimate.uncertainty
    if known is None or name not in known.unknowns:
        return ["", ""]
    k = known.unknowns.index(name)

    def shown(value: float) -> str:
        return significant(value) if known.in_decades[k] else quantity(name, value)[1]

    deviation = shown(known.marginal_sd[k]) + " decades" * known.in_decades[k]
    low, high = known.profile_low[k], known.profile_high[k]
    if low is None or high is None:
        return [deviation, ""]
    below = "≤ " if known.profile_low_open[k] else ""
    above = "≥ " if known.profile_high_open[k] else ""
    return [deviation, f"{below}{shown(low)} … {above}{shown(high)}"]


def _known_caption(estimate: Estimate) -> str:
    known = estimate.uncertainty
    if known is None:
        return ""
    gauge = "" if known.gauge_fixed else " The common scale of masses and coefficients was held fixed for it."
    # docs/explanation/claims.md: 70 % after the default search, 88 % after the thorough one.
    doubt = " After this search two in three intervals hold the true number; fit with "
    doubt += "estimate.search: thorough to read them (nine in ten)."
    in_plane = all(fit.name in PARAMETERS for fit in estimate.parameters)
    doubted = in_plane and estimate.search != "thorough"
    return (
        f"Standard deviation: from the Fisher information at residuals of {known.noise_m * 1e3:.2f} mm, of "
        f"which {known.measurements_per_datum:.0f} count as one, and the range.{gauge} Interval: strings "
        f"with E up to {known.profile_rise:.0%} above the best, all others fitted again; ≤ and ≥: it "
        f"continues beyond.{doubt if doubted else ''}"
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


def masses(page: TrialPageData) -> PanelContent:
    """Return the relative masses along the string, with the declared places of weights and pipes."""
    results, facts = page.results, page.facts
    estimate: Estimate = results.need("estimate")
    figure = new_figure(8.4, 3.2, top=0.9, bottom=0.17)
    _draw_masses(figure.add_subplot(), estimate, facts)
    finding = with_caveat(page, _masses_finding(estimate, facts.weight_places_m))
    heads = ["kind", "place [mm]", "mass [plain points]", "interval", "range", "bound", "ensemble"]
    rows = [
        [
            weight.kind,
            f"{weight.place_m * 1e3:.0f}",
            significant(weight.value),
            weight.words,
            f"{significant(weight.minimum)} … {significant(weight.maximum)}",
            *_bound_and_ensemble(weight, page),
        ]
        for weight in estimate.weights
    ]
    return PanelContent(
        finding,
        Drawing(figure, f"Relative masses along the string. {finding}"),
        [Table(heads, rows)] if rows else [],
        ["estimate.json"],
    )


def _draw_masses(axes: Any, estimate: Estimate, facts: Facts) -> None:
    """Draw a bar per point, a triangle per known weight, a hatched band per stiff section."""
    spacing_mm = estimate.length_m / estimate.points * 1e3
    places_mm = np.arange(1, estimate.points + 1) * spacing_mm
    masses = np.array(estimate.string.masses)
    base = min(0.5, 0.7 * float(masses.min()))
    axes.bar(
        places_mm, masses - base, 0.7 * spacing_mm, bottom=base, color=MEASURED["color"], label="estimate"
    )
    axes.set(xlabel=ALONG_STRING, ylabel="relative mass [1]", yscale="log")
    axes.set_ylim(base, float(masses.max()) * 2.5)
    axes.yaxis.set_major_formatter("{x:g}")
    for x_mm, mass in zip(places_mm, masses, strict=True):
        if mass > 1.3 * float(np.median(masses)):
            axes.annotate(significant(mass), (x_mm, mass), ha="center", va="bottom", fontsize=8)
    known_mm = [place * 1e3 for place in facts.weight_places_m]
    top = axes.get_xaxis_transform()
    axes.plot(known_mm, [0.97] * len(known_mm), **marks("v", 8, color=FITTED["color"]), transform=top)
    hatched = {"facecolor": "none", "edgecolor": HAND, "hatch": "////", "linewidth": 0, "zorder": 0.5}
    for from_m, to_m in facts.stiff_sections_m:
        axes.axvspan(from_m * 1e3, to_m * 1e3, **hatched)


def _masses_finding(estimate: Estimate, weight_places_m: list[float]) -> str:
    masses = np.array(estimate.string.masses)
    if np.ptp(masses[:-1]) <= 1e-9 * masses[0] and masses[-1] <= masses[0] * (1 + 1e-9):
        return "All points weigh the same" + (
            ", the free end half as much." if masses[-1] < masses[0] else "."
        )
    heaviest = int(np.argmax(masses))
    place_mm = (heaviest + 1) * estimate.length_m / estimate.points * 1e3
    finding = (
        f"The heaviest point is m{heaviest + 1} = {significant(float(masses[heaviest]))} at {place_mm:.0f} mm"
    )
    if not weight_places_m:
        return f"{finding}; the experiment names no weight."
    nearest_mm = min(weight_places_m, key=lambda place: abs(place * 1e3 - place_mm)) * 1e3
    return f"{finding}; the nearest known weight is at {nearest_mm:.0f} mm."
