"""Numbers as text: with a unit and an uncertainty, a dash for unknown values."""

import math
import re
from functools import partial

UNKNOWN = "–"
MINUS = "−"
MINUS_ZERO = re.compile(r"(?<![\w.])-(0(?:\.0*)?(?![\d.]))")
HARD = "\u00a0"  # a no-break space
LONG_S = 10.0


def signed(text: str) -> str:
    """Return a number's text with a true minus sign; none before a zero."""
    return MINUS_ZERO.sub(r"\1", text).replace("-", MINUS)


def scaled(
    value: float | None, scale: float, digits: int, unit: str, sigma: float | None = None, sign: str = "-"
) -> str:
    """Return ``value · scale`` with its unit, and ± the scaled sigma; `sign` "+" marks positive ones too."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    text = signed(f"{value * scale:{sign}.{digits}f}")
    if sigma is not None and math.isfinite(sigma):
        text += f"{HARD}±{HARD}{sigma * scale:.{digits}f}"
    return f"{text}{HARD}{unit}"


def millimetres(value_m: float | None, sigma_m: float | None = None, digits: int = 1) -> str:
    """Return a length in millimetres."""
    return scaled(value_m, 1e3, digits, "mm", sigma_m)


fine_millimetres = partial(millimetres, digits=2)


def milliseconds(value_s: float | None, sigma_s: float | None = None, digits: int = 2) -> str:
    """Return a time in milliseconds; a long one, e.g. between clocks with other origins, in seconds."""
    if value_s is not None and abs(value_s) >= LONG_S:
        return scaled(value_s, 1.0, digits + 3, "s", sigma_s)
    return scaled(value_s, 1e3, digits, "ms", sigma_s)


def percent(fraction: float | None, digits: int = 1) -> str:
    """Return a fraction in per cent."""
    return scaled(fraction, 100.0, digits, "%")


def counted(number: int, noun: str) -> str:
    """Return a number with its noun: "1 throw", "2 throws"."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def significant(value: float | None, digits: int = 3) -> str:
    """Return a number with this many significant digits, with a power of ten if very large or small."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    if value == 0 or 1e-2 <= abs(value) < 1e5:
        return signed(f"{value:.{digits}g}" if abs(value) < 1e3 else f"{value:.0f}")
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return f"{signed(mantissa)}·10{superscript(int(exponent))}"


def superscript(number: int) -> str:
    """Return an exponent in superscript digits."""
    return str(number).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def place(point_m: list[float] | None) -> str:
    """Return a point of the plane in millimetres."""
    if point_m is None:
        return UNKNOWN
    return "(" + ", ".join(signed(f"{value * 1e3:.0f}") for value in point_m) + f"){HARD}mm"
