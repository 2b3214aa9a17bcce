"""The benchmark's results: one number per entry, as they are written and printed."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from strandcast.bench.timing import Spread, Timing
from strandcast.records.files import write_text

OURS = "strandcast"


@dataclass(frozen=True)
class Entry:
    """One result.

    Attributes
    ----------
    name, value, unit
        What it is; the value is a text for what is named rather than measured, such as a version.
    peer
        Whose it is, or whom it is compared with.
    min, max
        Least and greatest of the repetitions, or of the draws; None where there was one.
    """

    name: str
    value: float | str
    unit: str
    peer: str = OURS
    min: float | None = None
    max: float | None = None


def of_spread(name: str, spread: Spread, unit: str, peer: str = OURS) -> Entry:
    """Return an entry of something measured several times."""
    return Entry(name, spread.value, unit, peer, spread.least, spread.greatest)


def of_timing(timing: Timing, peer: str, suffix: str = "") -> list[Entry]:
    """Return CPU and wall time per simulated second of one string."""
    return [
        of_spread(f"cpu_s_per_string_s{suffix}", timing.cpu, "s/s", peer),
        of_spread(f"wall_s_per_string_s{suffix}", timing.wall, "s/s", peer),
    ]


def write(path: Path, entries: Iterable[Entry]) -> None:
    """Write the entries as a JSON list, one line each."""
    lines = [json.dumps(asdict(entry), allow_nan=False, ensure_ascii=False) for entry in entries]
    write_text(path, "[\n" + ",\n".join(lines) + "\n]\n")


def table(entries: Iterable[Entry]) -> str:
    """Return the entries as text in columns."""
    rows = [("", "value", "min", "max", "unit", "of / against")]
    rows += [
        (entry.name, _figure(entry.value), _figure(entry.min), _figure(entry.max), entry.unit, entry.peer)
        for entry in entries
    ]
    widths = [max(len(row[c]) for row in rows) for c in range(len(rows[0]))]
    return "\n".join(_line(row, widths) for row in rows)


def _line(row: tuple[str, ...], widths: list[int]) -> str:
    cells = zip(row, widths, (str.ljust, str.rjust, str.rjust, str.rjust, str.ljust, str.ljust), strict=True)
    return "  ".join(place(cell, width) for cell, width, place in cells).rstrip()


def _figure(value: float | str | None) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else f"{value:,.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
