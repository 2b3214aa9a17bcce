"""The benchmark's results: entries of one number each, written as JSON and printed as a table."""

import json
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from strandcast.records.files import write_text
from strandcast_studies.benchmarks.simulation.timing import Spread, Timing

OURS = "strandcast"


@dataclass(frozen=True)
class Entry:
    """One result."""

    name: str
    value: float | str  # a text for facts such as a version
    unit: str
    peer: str = OURS  # the program that was measured, or that ours is compared with
    min: float | None = None  # least of the repetitions or draws; None for a single one
    max: float | None = None


def of_spread(name: str, spread: Spread, unit: str, peer: str = OURS) -> Entry:
    """Return an entry of repeated measurements."""
    return Entry(name, spread.value, unit, peer, spread.least, spread.greatest)


def of_timing(timing: Timing, peer: str, suffix: str = "") -> list[Entry]:
    """Return entries of CPU and wall time per simulated second of one string."""
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
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    form = "  ".join(f"{{:{side}{width}}}" for side, width in zip("<>>><<", widths, strict=True))
    return "\n".join(form.format(*row).rstrip() for row in rows)


def report_progress(text: str) -> None:
    """Print a line to standard error at once."""
    print(text, file=sys.stderr, flush=True)


def _figure(value: float | str | None) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else f"{value:,.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
