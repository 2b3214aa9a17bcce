"""Tables of numbers that importers read columns from."""

import re
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from itertools import accumulate
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.csv_cells import Cells, read_cells
from strandcast.records.record import refusal

MOST_LISTED = 450  # characters of names in a message, which may have 600


PART = re.compile(r"(.+)[._ ](q[wxyz]|[xyz])", re.IGNORECASE)


def _part_of(name: str) -> tuple[str, str] | None:
    """Return the point and the axis that a column is of, for NAME.x, NAME_X and the like."""
    match = PART.fullmatch(name)
    return match and (match[1], match[2].lower())


@dataclass(frozen=True)
class NumberTable:
    """Named columns of numbers: values (rows, columns), NaN where a cell is empty; the line of each row."""

    path: Path
    names: list[str]
    values: np.ndarray
    lines: np.ndarray
    has_header: bool
    notes: list[str] = field(default_factory=list)  # for the user
    # By its number from 0, why a column is not one of numbers: an error only where the column is used.
    problems: dict[int, StrandcastError] = field(default_factory=dict)
    instants: frozenset[int] = frozenset()  # columns that are seconds, whatever unit of time is given
    # What a capture's file says of itself.
    maker: str | None = None
    time: tuple[str, float] | None = None  # column, and its unit [s]
    rate_hz: float | None = None  # rows per second
    length_unit: str | None = None
    up: str | None = None  # the axis that points up by the maker's convention

    def points(self) -> list[str]:
        """Return the names of points that have columns NAME.x, NAME.y and NAME.z, or NAME_X …, each once."""
        parts: dict[str, set[str]] = {}
        for stem, part in filter(None, map(_part_of, self.names)):
            parts.setdefault(stem, set()).add(part)
        return [stem for stem, found in parts.items() if {"x", "y", "z"} <= found]

    def listed(self, near: str | None = None) -> str:
        """Return its columns in words, points by their names; if `near` is given, some that are like it."""
        points = self.points()
        others = [name for name in self.names if name and (_part_of(name) or ("",))[0] not in points]
        names = points + others
        if near is None or len(", ".join(names)) <= MOST_LISTED:
            return ", ".join(names)
        names.sort(key=lambda name: SequenceMatcher(None, near, name).ratio(), reverse=True)
        kept = max(sum(end <= MOST_LISTED for end in accumulate(len(name) + 2 for name in names)), 1)
        return f"{', '.join(names[:kept])} and {len(names) - kept} more"

    def column(self, name: str) -> np.ndarray:
        """Return one column (rows,) by its name, or by its number from 1 where the file has no header.

        ``NAME@3`` is the third column. A name that several columns have is an error unless they are equal.
        """
        k = self.index(name)
        if k in self.problems:
            raise self.problems[k]
        return self.values[:, k]

    def index(self, name: str) -> int:
        """Return the number of a column from 0; see `column`."""
        found = [k for k, each in enumerate(self.names) if name in (each, f"{each}@{k + 1}")]
        if not found and name.isdecimal() and 0 < int(name) <= len(self.names):
            return int(name) - 1
        if not found and (part := _part_of(name)):
            found = [k for k, each in enumerate(self.names) if _part_of(each) == part]
        values = self.values
        if found and all(np.array_equal(values[:, found[0]], values[:, k], equal_nan=True) for k in found):
            return found[0]
        if found:
            what = "the header names this column twice"
            stem = name.removesuffix(".x")  # the name of a point stands for its three columns
            fix = f"give one of {', '.join(f'{stem}@{k + 1}' for k in found)}"
        else:
            what = f"there is no column {name!r}; the columns are {self.listed(name)}"
            fix = "name the columns as the file's header does, or number them from 1 if it has none"
        raise StrandcastError("SC-I004", what, file=self.path, field=name, fix=fix)

    def columns(self, names: list[str]) -> np.ndarray:
        """Return several columns (rows, len(names))."""
        return np.column_stack([np.zeros((len(self.values), 0)), *map(self.column, names)])

    def times(self, name: str, unit_s: float) -> np.ndarray:
        """Return a column of times (rows,) [s]: numbers in a unit, or ISO 8601."""
        return self.column(name) * (1.0 if self.index(name) in self.instants else unit_s)

    def require_finite(self, values: np.ndarray, names: list[str]) -> None:
        """Refuse columns (rows, len(names)) that have an empty cell."""
        for row, column in np.argwhere(~np.isfinite(values)):
            what = "the cell is empty or not a number"
            raise self.refusal(row, names[column], what, "correct or delete the line", "SC-I025")

    def refusal(self, row: int, field: str, what: str, fix: str, code: str) -> StrandcastError:
        """Return the error for a row that does not fit."""
        return refusal(code, self.path, field, what, fix, int(self.lines[row]))


def read_numbers(path: str | Path) -> NumberTable:
    """Read a CSV file, see `records.csv_cells.read_cells`; errors have the code SC-I001.

    A last line that was cut is left out, with a note. What is not a number matters only in columns that are
    used; ISO 8601 times are seconds.
    """
    cells, notes = read_cells(path, "SC-I001").without_cut_line()
    return table_of(cells, notes)


def table_of(cells: Cells, notes: list[str]) -> NumberTable:
    """Return the numbers of a file's cells; see `read_numbers`."""
    cells.require_even()
    values = np.full((len(cells.rows), len(cells.names)), np.nan)
    problems, instants = {}, set()
    for k in range(len(cells.names)):
        try:
            values[:, k] = cells.column(k)
        except StrandcastError as error:
            if (times := cells.instants(k)) is None:
                problems[k] = error
            else:
                values[:, k] = times
                instants.add(k)
    lines = np.array(cells.lines)
    return NumberTable(
        cells.path, cells.names, values, lines, cells.has_header, notes, problems, frozenset(instants)
    )
