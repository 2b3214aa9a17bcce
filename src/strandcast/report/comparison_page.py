"""The page of a comparison, and its lines for a terminal."""

from typing import Any

from strandcast.report.comparison import LOG_UNIT, QUANTITIES, Comparison, Row, Value
from strandcast.report.drawing import GREY, INK, MEASURED, Drawing, new_figure
from strandcast.report.numbers import HARD, UNKNOWN, counted, millimetres, milliseconds, scaled, signed
from strandcast.report.pages import render
from strandcast.report.panels.content import Panel, PanelContent, Table, make_sections
from strandcast.report.typeset import symbol, unit

HEADS = ["trial", "quantity", "A", "B", "B − A"]
DIGITS = 2
LARGE = 2.0  # a difference of this many standard deviations is marked


def comparison_page(comparison: Comparison) -> str:
    """Return the HTML page of a comparison."""
    panels = [
        Panel(
            "trials",
            "Trials",
            _trials_panel,
            caption="The deviation of a difference is that of independent results. Results from the same "
            "recording share errors of tracking, so their difference is known better than that.",
        ),
        Panel("misses", "Misses", _misses_panel, shown=lambda it: bool(_misses(it))),
        Panel(
            "parameters",
            "Parameters of the last fit",
            _parameters_panel,
            caption="A parameter that the throws do not determine may differ by decades and mean nothing: "
            "its σ says so. σ belongs to one minimum of E; two searches that end in different minima differ "
            "by more.",
            shown=lambda it: bool(_fitted(it)),
        ),
        Panel("differing", "What differs", _differing_panel),
    ]
    a, b = comparison.names
    return render(
        "comparison.html.jinja",
        names=comparison.names,
        headline=headline(comparison),
        notes=notes(comparison),
        sections=make_sections(panels, comparison),
        title=f"{a} and {b} compared",
    )


def comparison_lines(comparison: Comparison) -> list[str]:
    """Return a comparison as lines of text."""
    a, b = comparison.names
    lines = [f"A: {a}", f"B: {b}", *notes(comparison)]
    shown = [*_measured(comparison), *_fitted(comparison)]
    cells = [HEADS, *([f"{row.trial}", row.quantity, *_values(row)] for row in shown)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines += ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]
    lines += [f"{name}: {one} in A, {other} in B" for name, one, other in comparison.settings]
    return [*lines, headline(comparison)]


def headline(comparison: Comparison) -> str:
    """Return in one sentence in how many trials B is lower."""
    if not comparison.tallies:
        known = any(row.difference.value is not None for row in comparison.rows)
        return "No quantity that is counted differs." if known else "No quantity is known in both."
    lower = (
        f"{each.quantity}: lower in B in {each.lower} of {each.lower + each.higher} trials "
        f"(sign test p = {each.p:.2g})"
        for each in comparison.tallies
    )
    return "; ".join(lower) + "."


def notes(comparison: Comparison) -> list[str]:
    """Return what a reader must know before the numbers."""
    found = [
        f"only in {name}: trial {', '.join(map(str, trials))}"
        for name, trials in zip(comparison.names, comparison.unpaired, strict=True)
        if trials
    ]
    other = [str(trial) for trial, same in comparison.same_recording.items() if same is False]
    if other:
        found.append(f"different recordings: trial {', '.join(other)}")
    return found


def text(row: Row, value: Value) -> str:
    """Return a value in the unit in which it is shown."""
    if row.unit == "m":
        return millimetres(value.value, value.sigma, DIGITS)
    if row.quantity == "clock offset":
        return milliseconds(value.value, value.sigma, DIGITS + 1)
    if row.unit == "1":
        return scaled(value.value, 100.0, 1, "%", value.sigma)
    return scaled(value.value, 1.0, 1 if row.unit == "s" else DIGITS + 1, row.unit, value.sigma).strip(HARD)


def change(row: Row) -> str:
    """Return the difference with its sign, marked where it is larger than its uncertainty allows."""
    difference = row.difference
    if difference.value is None:
        return UNKNOWN
    plus = "+" if difference.value > 0.0 else ""
    return f"{plus}{text(row, difference)}{' *' if is_large(difference) else ''}"


def is_large(difference: Value) -> bool:
    """Return whether a difference is larger than `LARGE` standard deviations."""
    return bool(difference.sigma) and abs(difference.value or 0.0) > LARGE * (difference.sigma or 0.0)


def _values(row: Row) -> list[str]:
    return [text(row, row.a), text(row, row.b), change(row)]


def _measured(comparison: Comparison) -> list[Row]:
    return [row for row in comparison.rows if row.quantity in QUANTITIES]


def _misses(comparison: Comparison) -> list[Row]:
    """Return the misses that are known in both."""
    return [row for row in comparison.rows if row.quantity == "miss" and row.difference.value is not None]


def _fitted(comparison: Comparison) -> list[Row]:
    """Return the parameters of the last trial that has any in both."""
    rows = [
        row for row in comparison.rows if row.quantity not in QUANTITIES and row.difference.value is not None
    ]
    last = max((row.trial for row in rows), default=0)
    return [row for row in rows if row.trial == last]


def _trials_panel(comparison: Comparison) -> PanelContent:
    caption = (
        f"± standard deviation where the records have one; * more than {LARGE:g} of the difference's own."
    )
    rows = [[f"trial {row.trial}", row.quantity, *_values(row)] for row in _measured(comparison)]
    return PanelContent(headline(comparison), tables=[Table(HEADS, rows, caption)])


def _parameters_panel(comparison: Comparison) -> PanelContent:
    """Return the parameters, with their units in a column of their own."""
    rows = _fitted(comparison)
    large = [row.quantity for row in rows if is_large(row.difference)]
    finding = f"Trial {rows[0].trial}: {len(large)} of {len(rows)} numbers differ by more than {LARGE:g} σ"
    caption = "Logarithms to base 10 of the estimates, ± in decades; other numbers in their own unit."
    cells: list[list[Any]] = []
    for row in rows:
        of = row.unit.removeprefix(LOG_UNIT)
        shown_unit = f"log₁₀ {unit(of)}" if of != row.unit else row.unit
        name = symbol(row.quantity) if row.unit else row.quantity
        cells.append([f"trial {row.trial}", name, shown_unit, *_values(row._replace(unit=""))])
    return PanelContent(
        f"{finding}{': ' if large else ''}{', '.join(large)}.",
        tables=[Table([*HEADS[:2], "unit", *HEADS[2:]], cells, caption)],
    )


def _misses_panel(comparison: Comparison) -> PanelContent:
    rows = _misses(comparison)
    figure = new_figure(8.4, 1.3 + 0.4 * len(rows), top=0.95, bottom=0.3 if len(rows) < 5 else 0.15)
    axes = figure.add_subplot()
    for row in rows:
        values = [1e3 * (each.value or 0.0) for each in (row.a, row.b)]
        axes.plot(values, [row.trial] * 2, color=GREY, linewidth=2, zorder=1)
        axes.plot(values[0], row.trial, "D", color=INK, markersize=7, markerfacecolor="none")
        axes.plot(values[1], row.trial, "o", color=MEASURED["color"], markersize=7)
    axes.set(xlabel="miss [mm]   (open diamond: A, disc: B)", ylabel="trial", xlim=(0, None))
    axes.set_yticks([row.trial for row in rows])
    axes.set_ylim(max(row.trial for row in rows) + 0.6, min(row.trial for row in rows) - 0.6)
    shift = sum(row.difference.value or 0.0 for row in rows) / len(rows)
    change, over = signed(f"{1e3 * shift:+.1f}"), counted(len(rows), "trial")
    finding = f"The miss changes by {change} mm on average over {over}."
    return PanelContent(finding, drawing=Drawing(figure, f"Misses of both results by trial. {finding}"))


def _differing_panel(comparison: Comparison) -> PanelContent:
    rows = [list(each) for each in comparison.settings]
    if not rows:
        return PanelContent("The fit of the last trial was done the same way, by the same versions.")
    finding = f"{len(rows)} settings or versions of the last trial's fit differ."
    return PanelContent(finding, tables=[Table(["name", "A", "B"], rows)])
