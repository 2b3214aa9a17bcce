"""A CSV file of numbers, read strictly: whatever does not fit is one message with the line."""

from __future__ import annotations

import csv
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.errors import INTEGRITY, StrandcastError

COMMENT = ("#", "%")
LARGEST_FILE_BYTES = 2 << 30


@dataclass(frozen=True)
class NumberTable:
    """Named columns of numbers: values (rows, columns), NaN where a cell is empty; the line of each row."""

    path: Path
    names: list[str]
    values: np.ndarray
    lines: np.ndarray
    has_header: bool

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
        return (
            np.column_stack([self.column(name) for name in names])
            if names
            else np.zeros((len(self.values), 0))
        )

    def require_finite(self, values: np.ndarray, names: list[str]) -> None:
        """Refuse columns (rows, len(names)) that have an empty cell."""
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            row, column = bad[0]
            raise refusal(
                self.path,
                int(self.lines[row]),
                names[column],
                "the cell is empty or not a number",
                "mend or delete the line",
                code="SC-I005",
            )


def read_numbers(path: str | Path) -> NumberTable:
    """Read a CSV file of numbers: comma, semicolon, tab or blanks, with a header or without.

    Lines that begin with # or % are comments.
    Without a header the columns are named by their numbers, "1", "2" ….

    Raises
    ------
    StrandcastError
        Missing or empty file, NUL bytes, a header that names a column twice, a line with another number of
        cells, a cell that is no number (a decimal comma is named): file and line.
    """
    path = Path(path)
    rows, lines = _split(path, _text(path))
    header = rows[0] if not all(_is_number(cell) for cell in rows[0]) else None
    names = [str(number + 1) for number in range(len(rows[0]))] if header is None else header
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise refusal(path, lines[0], twice[0], "the header names this column twice", "rename one of them")
    body, body_lines = (rows, lines) if header is None else (rows[1:], lines[1:])
    if not body:
        raise refusal(path, None, None, "the file has a header and no rows", "export or copy it again")
    values = np.empty((len(body), len(names)))
    for row, (cells, line) in enumerate(zip(body, body_lines, strict=True)):
        if len(cells) != len(names):
            first = "header" if header else "first line"
            what = f"the line has {len(cells)} cells, the {first} has {len(names)}"
            raise refusal(
                path, line, None, what, "was the file cut, or does it use a decimal comma? copy it again"
            )
        values[row] = [_number(path, line, name, cell) for name, cell in zip(names, cells, strict=True)]
    return NumberTable(path, names, values, np.array(body_lines), header is not None)


def _text(path: Path) -> str:
    if not path.is_file():
        raise refusal(path, None, None, "the file is not there", "check the path")
    if path.stat().st_size > LARGEST_FILE_BYTES:
        raise refusal(path, None, None, "the file is larger than 2 GiB", "cut it to the throw")
    data = path.read_bytes()
    nul = data.find(b"\0")
    if nul >= 0:
        line = data.count(b"\n", 0, nul) + 1
        raise refusal(
            path,
            line,
            None,
            f"there are NUL bytes from byte {nul} on: the file was not written to its end",
            "copy it again, or cut it before that line",
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise refusal(
            path, line, None, f"is not text (byte {error.start})", "export it as CSV in UTF-8"
        ) from None


def _split(path: Path, text: str) -> tuple[list[list[str]], list[int]]:
    """Return the cells of all lines that hold any, and the numbers of the lines."""
    kept = [
        (number + 1, line)
        for number, line in enumerate(text.splitlines())
        if line.strip() and not line.lstrip().startswith(COMMENT)
    ]
    if not kept:
        raise refusal(path, None, None, "the file is empty", "export or copy it again")
    delimiter = max(";\t,", key=kept[0][1].count)
    if delimiter not in kept[0][1]:
        return [line.split() for _, line in kept], [number for number, _ in kept]  # UR's record.py: blanks
    # Line by line: a stray quotation mark must not swallow the lines after it.
    cells = [[cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))] for _, line in kept]
    if cells[0][-1] == "" and all(row and row[-1] == "" for row in cells):
        cells = [row[:-1] for row in cells]  # every line ends in a separator
    return cells, [number for number, _ in kept]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell == "" or _has_decimal_comma(cell)
    return True


def _has_decimal_comma(cell: str) -> bool:
    head, comma, tail = cell.partition(",")
    return bool(comma) and head.lstrip("+-").isdigit() and tail[:1].isdigit()


def _number(path: Path, line: int, name: str, cell: str) -> float:
    if cell == "" or cell.lower() in ("nan", "na"):
        return float("nan")
    try:
        value = float(cell)
    except ValueError:
        if _has_decimal_comma(cell):
            raise refusal(
                path, line, name, f"{cell!r} has a decimal comma", "export with decimal points"
            ) from None
        raise refusal(path, line, name, f"{cell!r} is not a number", "mend or delete the line") from None
    if not np.isfinite(value):
        raise refusal(path, line, name, f"{cell!r} is not a finite number", "mend or delete the line")
    return value


def refusal(
    path: Path, line: int | None, field: str | None, what: str, fix: str, code: str = "SC-I001"
) -> StrandcastError:
    """Return the error for a supplied file that does not fit."""
    return StrandcastError(code, what, file=path, line=line, field=field, fix=fix, exit_code=INTEGRITY)
