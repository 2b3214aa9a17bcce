"""Matplotlib figures as SVG for a page: reproducible bytes, selectable text, colours for light and dark."""

import io
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

# The palette of Okabe and Ito. Each role has a dash style too, so that nothing depends on colour alone.
MEASURED: dict[str, Any] = {"color": "#0072b2", "linestyle": "-", "linewidth": 1.6}
FITTED: dict[str, Any] = {"color": "#d55e00", "linestyle": (0, (5, 2)), "linewidth": 1.5}
PLANNED: dict[str, Any] = {"color": "#009e73", "linestyle": (0, (5, 2, 1, 2)), "linewidth": 1.3}
TRUE: dict[str, Any] = {"color": "#e69f00", "linestyle": (0, (1, 1.2)), "linewidth": 1.8}
TARGET, HAND, GREY = "#cc79a7", "#e69f00", "#808890"
HIT_RADIUS: dict[str, Any] = {"color": TARGET, "linestyle": (0, (6, 3)), "linewidth": 1.4}

# Labels that several figures share.
SINCE_START = "time from the motion's start [ms]"
ALONG_STRING = "place along the string from the hand [mm]"

# The page's style sheet defines these for light and dark.
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
    "path.simplify_threshold": 0.3,  # points that change a line by less, in points of 1/72 inch, are left out
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
    """Draw in the style of the pages, whatever the user's matplotlib settings are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(SETTINGS)
        yield


def new_figure(width: float, height: float, **margins: float) -> Figure:
    """Return an empty figure of a size in inches, with margins as fractions of it."""
    figure = Figure(figsize=(width, height))
    FigureCanvasSVG(figure)
    usual = {"left": 0.09, "right": 0.985, "top": 0.93, "bottom": 0.12, "wspace": 0.25, "hspace": 0.3}
    figure.subplots_adjust(**(usual | margins))
    return figure


def legend_below(figure: Figure, *axes: Any) -> None:
    """Put the legend of some axes at the bottom of the figure, where it hides nothing."""
    named: dict[str, Any] = {}
    for each in axes or figure.axes:
        for handle, label in zip(*each.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    figure.legend(
        list(named.values()), list(named), loc="lower center", ncols=5, handlelength=3.0, columnspacing=1.5
    )


def dashes(style: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Return the colour and the dashes of a role, without its width, for lines across the axes."""
    return {"color": style["color"], "linestyle": style["linestyle"]} | changes


def log_if_wide(axes: Any, axis: str, values: Iterable[float | None], ratio: float = 20.0) -> bool:
    """Make an axis logarithmic if its values are positive and span more than a ratio; return whether."""
    known = [value for value in values if value is not None and value == value]
    if not known or min(known) <= 0 or max(known) / min(known) <= ratio:
        return False
    axes.set(**{f"{axis}scale": "log"})
    side = getattr(axes, f"{axis}axis")
    side.set_major_locator(LogLocator(subs=(1, 2, 5) if max(known) / min(known) < 300 else (1,)))
    side.set_minor_locator(NullLocator())
    side.set_major_formatter("{x:g}")
    getattr(axes, f"set_{axis}lim")(min(known) / 1.6, max(known) * 1.6)
    return True


def few_ticks() -> Any:
    """Return a locator of few ticks, for a low panel among others."""
    return MaxNLocator(nbins=3)


def marks(marker: str, size: float, **style: Any) -> dict[str, Any]:
    """Return a style of markers without a line."""
    return {"linestyle": "none", "marker": marker, "markersize": size} | style


def views(dimensions: int) -> tuple[list[int], ...]:
    """Return the coordinates that each view shows: the plane; or in space from two sides, z upwards."""
    return ([0, 1],) if dimensions == 2 else ([0, 2], [1, 2])


def equal_axes(axes: Any, seen: Sequence[int] = (0, 1)) -> None:
    """Label axes with the coordinates of a view (see `views`), at one scale for both."""
    axes.set(xlabel=f"{'xyz'[seen[0]]} [m]", ylabel=f"{'xyz'[seen[1]]} [m]")
    axes.set_aspect("equal", adjustable="datalim")


def ring(axes: Any, place_m: Sequence[float], radius_m: float, width: float = 2.0) -> None:
    """Draw the hit radius around a place of the target."""
    circle = Circle((place_m[0], place_m[1]), radius_m, facecolor="none", edgecolor=TARGET, lw=width)
    axes.add_patch(circle)


def note(axes: Any, text: str, at: Any, offset: Any, **style: Any) -> None:
    """Write a text beside a place of the data, at an offset in points."""
    axes.annotate(text, at, xytext=offset, textcoords="offset points", **style)


class Drawing(NamedTuple):
    """A figure, its alternative text for screen readers, and its plots that the viewer's cursor follows."""

    figure: Figure
    alt: str
    time_axes: Sequence[Any] = ()  # x is the time from the motion's start [ms]
    frame_axes: Sequence[Any] = ()  # x is the camera's frame


def to_svg(drawn: Drawing, name: str) -> Markup:
    """Return a figure as inline SVG; its name, unique on the page, is the prefix and seed of all ids."""
    out = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": name}):
        drawn.figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)  # it would apply to the whole page
    text = re.sub(r' xmlns(:xlink)?="[^"]*"', "", text)
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    text = re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{name}-", text)
    text = re.sub(r"<g>\s*</g>\n?", "", text)
    # Matplotlib writes six digits; a hundredth of a point is less than a pixel on any screen.
    text = re.sub(
        r'(?<= d=")[^"]+', lambda path: re.sub(r"(\.\d\d)\d+|\s*\n|(?<=[A-Z]) ", r"\1", path[0]), text
    )
    for sentinel, value in THEME.items():
        text = text.replace(sentinel, value)
    head = Markup('<svg role="img" aria-label="{}"').format(drawn.alt)
    body = text[len("<svg") :].rstrip().removesuffix("</svg>")
    return Markup(f"{head}{body}{''.join(_cursors(drawn))}</svg>")


def _cursors(drawn: Drawing) -> Iterator[str]:
    """Yield a hidden line for each plot that follows the viewer, with the scale of its time axis."""
    width, height = 72.0 * drawn.figure.get_size_inches()  # in the units of the SVG
    for clock, plots in (("ms", drawn.time_axes), ("frame", drawn.frame_axes)):
        for axes in plots:
            box, (first, last) = axes.get_position(), axes.get_xlim()
            yield (
                f'<line class="now" visibility="hidden" data-clock="{clock}" data-first="{first:.6g}" '
                f'data-last="{last:.6g}" data-left="{box.x0 * width:.2f}" data-right="{box.x1 * width:.2f}" '
                f'y1="{(1 - box.y1) * height:.2f}" y2="{(1 - box.y0) * height:.2f}"/>'
            )
