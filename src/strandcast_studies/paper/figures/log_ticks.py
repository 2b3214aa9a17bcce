"""Labels of logarithmic axes."""

import math
from typing import Any

from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from strandcast.report.numbers import superscript


def log_ticks(*axes: Any, within: tuple[float, ...] = (1.0,)) -> None:
    """Label logarithmic axes (`axes.xaxis` …) as plain text at these multiples of powers of ten."""
    for axis in axes:
        axis.set_major_locator(LogLocator(subs=within, numticks=5 if len(within) == 1 else None))
        axis.set_major_formatter(FuncFormatter(lambda value, _: _power(value)))
        axis.set_minor_formatter(NullFormatter())


def _power(value: float) -> str:
    if 1e-2 <= value < 1e5:
        return f"{value:g}"
    return f"10{superscript(round(math.log10(value)))}"
