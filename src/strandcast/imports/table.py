"""Tables of numbers that importers read columns from."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.csv_cells import read_cells
from strandcast.records.record import refusal


@dataclass(frozen=True)
class NumberTable:
    """Named columns of numbers: values (rows, columns), NaN where a cell is empty; the line of each row.

    `rate_hz` and `length_unit` are what the file itself says of them, if it does.
    """

    path: Path
    names: list[str]
    values: np.ndarray
    lines: np.ndarray
    has_header: bool
    notes: list[str] = field(default_factory=list)  # remarks for the user
    rate_hz: float | None = None
    length_unit: str | None = None

    def column(self, name: str) -> np.ndarray:
        """Return one column (rows,) by its name, or by its number from 1 where the file has no header."""
        if name in self.names:
            return self.values[:, self.names.index(name)]
        raise StrandcastError(
            "SC-I004",
            f"there is no column {name!r}; the columns are {', '.join(self.names[:60])}",
            file=self.path,
            field=name,
            fix="name the columns as the file's header does, or number them from 1 if it has none",
        )

    def columns(self, names: list[str]) -> np.ndarray:
        """Return several columns (rows, len(names))."""
        return np.column_stack([np.zeros((len(self.values), 0)), *map(self.column, names)])

    def require_finite(self, values: np.ndarray, names: list[str]) -> None:
        """Refuse columns (rows, len(names)) that have an empty cell."""
        for row, column in np.argwhere(~np.isfinite(values)):
            what = "the cell is empty or not a number"
            raise self.refusal(row, names[column], what, "correct or delete the line", "SC-I005")

    def refusal(self, row: int, field: str, what: str, fix: str, code: str) -> StrandcastError:
        """Return the error for a row that does not fit."""
        return refusal(code, self.path, field, what, fix, int(self.lines[row]))


def read_numbers(path: str | Path) -> NumberTable:
    """Read a CSV file of numbers, see `records.csv_cells.read_cells`; errors have the code SC-I001.

    A last line that was cut is left out, with a note.
    """
    cells, notes = read_cells(path, "SC-I001").without_cut_line()
    return NumberTable(
        cells.path, cells.names, cells.numbers(), np.array(cells.lines), cells.has_header, notes
    )
