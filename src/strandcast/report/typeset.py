"""Names and units of the files as a reader expects them: subscripts, superscripts, millimetres."""

import re
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup, escape

from strandcast.core.strings import (
    BEND_FRICTION,
    CLAMP_OFFSET,
    DRAG_ALONG,
    FRICTION_STICK,
    PARAMETERS,
    REST_CURL,
    STIFF_BEND,
)
from strandcast.report.numbers import HARD, UNKNOWN, significant, superscript

WORDS = {
    REST_CURL: "rest curl",
    CLAMP_OFFSET: "clamp angle",
    STIFF_BEND: "stiffness of the stiff sections",
    BEND_FRICTION: "bend friction",
    FRICTION_STICK: "bend over which friction builds up",
    DRAG_ALONG: "drag along the string over that across it",
}
NAMES = re.compile(rf"\b({'|'.join((*PARAMETERS, *WORDS))})\b")

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
    return Markup(NAMES.sub(lambda found: str(symbol(found[0])), str(escape(text))))


def symbol(name: str) -> Markup:
    """Return the symbol of a parameter, or the words for another name of the estimate."""
    if name in PARAMETERS:
        letter, index = name.split("_")
        return Markup("{}<sub>{}</sub>").format(letter, index)
    return escape(WORDS.get(name, name.replace("_", " ")))


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
    words = WORDS.get(name, name.removesuffix(suffix).replace("_", " "))
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
