"""Matplotlib figures as SVG for a page: same bytes each time, selectable text, colours for light and dark."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

# Okabe–Ito. A dash style goes with each role, so that nothing is told by colour alone.
MEASURED: dict[str, Any] = {"color": "#0072b2", "linestyle": "-", "linewidth": 1.6}
FITTED: dict[str, Any] = {"color": "#d55e00", "linestyle": (0, (5, 2)), "linewidth": 1.5}
PLANNED: dict[str, Any] = {"color": "#009e73", "linestyle": (0, (5, 2, 1, 2)), "linewidth": 1.3}
TRUE: dict[str, Any] = {"color": "#e69f00", "linestyle": (0, (1, 1.2)), "linewidth": 1.8}
TARGET = "#cc79a7"

# The page's style sheet gives these their value in light and in dark.
THEME = {
    "#0072b2": "var(--blue)",
    "#d55e00": "var(--vermilion)",
    "#009e73": "var(--green)",
    "#e69f00": "var(--orange)",
    "#cc79a7": "var(--purple)",
    "#010203": "currentColor",
    "#040506": "var(--faint)",
    "#070809": "var(--page)",
}
INK, FAINT, PAGE = "#010203", "#040506", "#070809"

SETTINGS: dict[str, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "text.parse_math": False,  # names may hold dollar signs
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "xtick.color": INK,
    "ytick.color": INK,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "hatch.color": INK,
}


@contextmanager
def drawing() -> Iterator[None]:
    """Draw in the house's style, whatever the user's own settings of matplotlib are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(SETTINGS)
        yield


def new_figure(width: float, height: float, **margins: float) -> Figure:
    """Return an empty figure of a size in inches, with margins as fractions of it."""
    figure = Figure(figsize=(width, height))
    FigureCanvasSVG(figure)
    sides = {
        "left": 0.09,
        "right": 0.985,
        "top": 0.93,
        "bottom": 0.12,
        "wspace": 0.25,
        "hspace": 0.3,
    } | margins
    figure.subplots_adjust(**sides)
    return figure


def legend_below(figure: Figure, *axes: Any) -> None:
    """Put the legend of some axes at the foot of the figure, where it hides nothing."""
    named: dict[str, Any] = {}
    for each in axes or figure.axes:
        for handle, label in zip(*each.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    figure.legend(
        list(named.values()), list(named), loc="lower center", ncols=5, handlelength=3.0, columnspacing=1.5
    )


def log_ticks(*axes: Any, within: tuple[float, ...] = (1.0,)) -> None:
    """Write plain text beside logarithmic axes (`axes.xaxis` …): these multiples of powers of ten."""
    for axis in axes:
        axis.set_major_locator(LogLocator(subs=within, numticks=5 if len(within) == 1 else None))
        axis.set_major_formatter(FuncFormatter(lambda value, _: _power(value)))
        axis.set_minor_formatter(NullFormatter())


def _power(value: float) -> str:
    if 1e-2 <= value < 1e5:
        return f"{value:g}"
    return "10" + f"{math.log10(value):.0f}".translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def to_svg(figure: Figure, key: str, alt: str) -> Markup:
    """Return a figure as inline SVG.

    Parameters
    ----------
    figure
        What to draw.
    key
        The figure's name on its page; it keeps ids apart and seeds them.
    alt
        What the figure shows, for those who do not see it.
    """
    out = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": key}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)  # it would reach beyond this figure
    text = re.sub(r' xmlns(:xlink)?="[^"]*"', "", text)
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    text = re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{key}-", text)
    text = re.sub(r"<g>\s*</g>\n?", "", text)
    for sentinel, value in THEME.items():
        text = text.replace(sentinel, value)
    head = Markup('<svg role="img" aria-label="{}"').format(alt)
    return Markup(str(head) + text[len("<svg") :].rstrip())
