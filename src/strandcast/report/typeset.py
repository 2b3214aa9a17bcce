"""Names and units of the files as a reader expects them: subscripts, superscripts, millimetres."""

import re
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup, escape

from strandcast.core.strings import PARAMETERS, UNKNOWNS
from strandcast.report.numbers import HARD, UNKNOWN, significant, superscript

# Suffix of a name in the files -> factor and unit on the page; longer suffixes first.
UNITS: dict[str, tuple[float, str]] = {
    "_rad_s": (1.0, "rad/s"),
    "_rad_m": (1.0, "rad/m"),
    "_rad": (180.0 / np.pi, "°"),
    "_grey": (1.0, "grey levels"),
    "_px": (1.0, "px"),
    "_m": (1e3, "mm"),
    "_s": (1e3, "ms"),
}


def typeset(text: object) -> Markup:
    """Return a text, escaped, with subscripts in the parameters' symbols and words for other names."""
    names = "|".join((*PARAMETERS, *filter(_words, UNKNOWNS)))
    return Markup(re.sub(rf"\b({names})\b", lambda found: str(symbol(found[0])), str(escape(text))))


def _words(name: str) -> str:
    return UNKNOWNS[name].words if name in UNKNOWNS else ""


def symbol(name: str) -> Markup:
    """Return the symbol of a parameter, or the words for another name of the estimate."""
    if name in PARAMETERS:
        letter, index = name.split("_")
        return Markup("{}<sub>{}</sub>").format(letter, index)
    return escape(_words(name) or name.replace("_", " "))


def unit(text: str) -> str:
    """Return a unit of the files, such as ``N s2/m2/kg``, as N·s²/(m²·kg)."""
    above, *below = re.sub(r"\d", lambda digit: superscript(int(digit[0])), text).replace(" ", "·").split("/")
    if not below:
        return above
    return f"{above}/{below[0]}" if len(below) == 1 else f"{above}/({'·'.join(below)})"


def quantity(name: str, value: object) -> tuple[str, str]:
    """Return the words for a name that ends in its unit, and the value with the unit of a reader."""
    suffix = next((each for each in UNITS if name.endswith(each)), "")
    factor, shown = UNITS.get(suffix, (1.0, ""))
    words = _words(name) or name.removesuffix(suffix).replace("_", " ")
    return words, f"{_plain(value, factor)}{HARD if shown and shown != '°' else ''}{shown}"


def _plain(value: object, factor: float) -> str:
    if value is None:
        return UNKNOWN
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return str(value) if factor == 1.0 and isinstance(value, int) else significant(value * factor, 4)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_plain(each, factor) for each in value)
    return str(value)
