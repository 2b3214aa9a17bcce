"""A strict reader of CSV files of numbers: every problem is one message with its line."""

import codecs
import csv
import math
import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime, time
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.record import refusal

COMMENT = ("#", "%", "sep=")  # the last one names the separator to Excel
LARGEST_FILE_BYTES = 256 << 20  # 16 times a log of 60 s at 1 kHz; its cells take ten times as much memory
LONGEST_NAME = 200  # characters of a column's name; chosen, ROS' nested names have some 80
LONGEST_QUOTE = 40  # characters of a cell in a message; chosen, one line of a terminal
EMPTY = frozenset({"", "nan", "na", "null", "none"})
POINT = re.compile(r"\d\.\d")
HEAD_LINES = 50  # by which the separator is chosen
# Not str.splitlines: a damaged byte such as a form feed would split one row into two.
UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
THOUSANDS = 3  # digits after a comma in 1,000
ROWS_ABOVE = 10  # chosen: all have more decimals than a last number that was cut
HOUR_S, DAY_S = 3600.0, 86400.0
MINUTES = re.compile(r"(\d\d):(\d\d\.\d+)")
LINE_END = re.compile(r"\r\n|\n|\r")


@dataclass(frozen=True)
class Cells:
    """The text of a CSV file's cells, the line of each row, and the code of its errors.

    `has_decimal_commas` where commas do not separate the cells, and no number has a point.
    """

    path: Path
    names: list[str]
    rows: list[list[str]]
    lines: list[int]
    has_header: bool
    code: str
    last_line_ends: bool = True  # False: the file stops within its last line, or without a line end
    has_decimal_commas: bool = False

    def without_cut_line(self) -> "tuple[Cells, list[str]]":
        """Return the cells without a last line that was cut, and a warning of it.

        A writer that is stopped leaves a line without an end and with too few cells, or within a number that
        has fewer decimals than those above it; a line with too few cells elsewhere is damage.
        """
        if self.last_line_ends or len(self.rows) < 2 or len(self.rows[-1]) > len(self.names):
            return self, []
        last = self.rows[-1]
        cut = f"{len(last)} of {len(self.names)} cells"
        if len(last) == len(self.names):
            at = max((k for k, cell in enumerate(last) if cell), default=0)
            above = [_decimals(row[at]) for row in self.rows[:-1] if row[at : at + 1] > [""]]
            if len(above) < ROWS_ABOVE or not _is_cut(last[at], min(above)):
                return self, []
            cut = f"{_quoted(last[at])} has fewer decimals than all above"
        left_out = f"line {self.lines[-1]}, the last, was cut ({cut}) and is left out"
        return replace(self, rows=self.rows[:-1], lines=self.lines[:-1]), [left_out]

    def require_even(self) -> None:
        """Refuse rows that have more or fewer cells than there are names."""
        for k, row in enumerate(self.rows):
            if len(row) != len(self.names):
                first = "header" if self.has_header else "first line"
                what = f"{len(row)} cells, the {first} has {len(self.names)}"
                fix = "was the file cut, has it lines above the header, or does it use a decimal comma?"
                raise self._refusal(k, None, what, fix)

    def column(self, k: int, empty: frozenset[str] = EMPTY) -> np.ndarray:
        """Return one column (rows,) as floats; words in `empty`, in any case, become NaN."""
        cells = ((row, cells[k]) for row, cells in enumerate(self.rows))
        return np.array(
            [math.nan if cell.lower() in empty else self._number(row, k, cell) for row, cell in cells]
        )

    def instants(self, k: int) -> np.ndarray | None:
        """Return a column of ISO 8601 times (rows,) as seconds, NaN where empty; else None.

        Times of the day go on after midnight, minutes and seconds after the full hour.
        """
        found = [math.nan if row[k].lower() in EMPTY else instant_s(row[k]) for row in self.rows]
        if None in found:
            return None
        times_s = np.array(found, float)
        if not any(row[k][4:5] == "-" for row in self.rows):
            known = np.isfinite(times_s)
            is_in_hour = all(row[k].count(":") < 2 for row in self.rows)
            times_s[known] = np.unwrap(times_s[known], period=HOUR_S if is_in_hour else DAY_S)
        return times_s

    def integers(self, name: str) -> np.ndarray:
        """Return one column (rows,) exactly, as 64-bit integers; empty cells become 0."""
        column = self.names.index(name)
        values = np.empty(len(self.rows), np.int64)
        for k, row in enumerate(self.rows):
            try:
                values[k] = int(_plain(row[column] or "0"))
            except (ValueError, OverflowError):
                raise self._not_a(k, name, row[column], "whole number") from None
        return values

    def _number(self, row: int, column: int, cell: str) -> float:
        try:
            value = float(_plain(cell.replace(",", ".") if self.has_decimal_commas else cell))
        except ValueError:
            if _has_decimal_comma(cell):
                what = f"{_quoted(cell)} has a decimal comma, and other numbers have points"
                raise self._refusal(row, self.names[column], what, "export with decimal points") from None
            if cell.count(":") > 1:
                what = f"{_quoted(cell)} is neither a number nor a time as in ISO 8601"
                fix = "write times as 2026-11-20T17:01:02.003 or 17:01:02.003, or give seconds"
                raise self._refusal(row, self.names[column], what, fix) from None
            raise self._not_a(row, self.names[column], cell, "number") from None
        if not math.isfinite(value):
            raise self._not_a(row, self.names[column], cell, "finite number")
        return value

    def _not_a(self, row: int, name: str, cell: str, what: str) -> StrandcastError:
        return self._refusal(row, name, f"{_quoted(cell)} is not a {what}", "correct or delete the line")

    def _refusal(self, row: int, field: str | None, what: str, fix: str) -> StrandcastError:
        return refusal(self.code, self.path, field, what, fix, self.lines[row])


def read_cells(path: str | Path, code: str) -> Cells:
    """Read a CSV file of numbers, UTF-8 or UTF-16: comma, semicolon, tab or blanks, with a header or without.

    Lines that begin with # or % are comments, and so is Excel's sep=; names above numbers may be one.
    Without a header the columns are named by their numbers, "1", "2" ….

    `code` is that of the errors, with file and line: a missing or empty file, NUL bytes; from `Cells`, a line
    with another number of cells, or a cell that is not a number (a decimal comma where others have points is
    reported as such), or quotation marks that do not enclose a cell.
    """
    path = Path(path)
    text = read_text(path, code)
    rows, lines, commas = _split(path, text, code)
    ends = text.endswith(("\n", "\r"))
    if all(map(_is_value, rows[0])):
        return Cells(path, [str(k + 1) for k in range(len(rows[0]))], rows, lines, False, code, ends, commas)
    longest = max(rows[0], key=len)
    if len(longest) > LONGEST_NAME:
        what = f"the header has a column's name of {len(longest)} characters, {_quoted(longest)}"
        raise refusal(code, path, None, what, "name it shortly, or export the file again", lines[0])
    if len(rows) == 1:
        raise refusal(code, path, None, "the file has a header and no rows", "export or copy it again")
    return Cells(path, rows[0], rows[1:], lines[1:], True, code, ends, commas)


def read_text(path: Path, code: str) -> str:
    """Return a file's text; see `read_cells` for the errors."""
    if not path.is_file():
        raise refusal(code, path, None, "the file is missing", "check the path")
    if path.stat().st_size > LARGEST_FILE_BYTES:
        what = f"the file is larger than {LARGEST_FILE_BYTES >> 20} MiB"
        raise refusal(code, path, None, what, "cut it to the throw")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise refusal(code, path, None, f"cannot be read ({error.strerror})", "check the rights") from None
    # Without its mark, UTF-16 shows by every second byte of a header in Latin letters.
    halves = len(data) > 3 and (not any(data[1:64:2]) or not any(data[:64:2]))
    utf16 = halves or data.startswith(UTF16_MARKS)
    nul = -1 if utf16 else data.find(b"\0")
    if nul >= 0:
        what = f"there are NUL bytes from byte {nul} on: the file was not written completely"
        line = data.count(b"\n", 0, nul) + 1
        raise refusal(code, path, None, what, "copy it again, or cut it before that line", line)
    if utf16:
        return data.decode(_utf16(data), errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")  # as programs of older systems write names and units


def _utf16(data: bytes) -> str:
    if data.startswith(UTF16_MARKS):
        return "utf-16"
    return "utf-16-be" if data[:1] == b"\0" else "utf-16-le"


def separator_of(lines: list[str]) -> str:
    """Return the tab or semicolon that most of the first lines have, else the comma."""
    head = lines[:HEAD_LINES]
    return next((mark for mark in "\t;" if 2 * sum(mark in line for line in head) > len(head)), ",")


def has_decimal_commas(lines: list[str], separator: str) -> bool:
    """Return whether commas in a file's numbers are decimal ones."""
    return separator != "," and not any(map(POINT.search, lines))


def _split(path: Path, text: str, code: str) -> tuple[list[list[str]], list[int], bool]:
    """Return the cells of all lines that are not empty, the lines' numbers, and `has_decimal_commas`.

    The comment above the rows is their header if it has a name for each of their cells, and they have none.
    """
    filled = [(number, line) for number, line in enumerate(LINE_END.split(text), 1) if line.strip()]
    kept = [each for each in filled if not each[1].lstrip().startswith(COMMENT)]
    if not kept:
        raise refusal(code, path, None, "the file is empty: it has no rows", "export or copy it again")
    delimiter = separator_of([line for _, line in kept])

    def split(numbered: tuple[int, str]) -> list[str]:
        number, line = numbered
        # UR's record.py: blanks
        return split_line(path, line, number, delimiter, code) if separated else line.split()

    separated = delimiter in kept[0][1]
    first = split(kept[0])
    if filled[0] != kept[0] and len(first) > 1 and 2 * sum(map(_is_value, first)) > len(first):
        number, comment = filled[filled.index(kept[0]) - 1]
        above = number, comment.lstrip().lstrip("#%")
        if len(split(above)) == len(first) and not any(map(_is_value, split(above))):
            kept.insert(0, above)
    numbers, cells = [number for number, _ in kept], [split(each) for each in kept]
    rows = [line for _, line in kept[1:]]
    in_cells = [cell for row in cells[1:] for cell in row if "," in cell and separated]
    has_no_thousands = any(len(cell.rpartition(",")[2]) != THOUSANDS for cell in in_cells)
    commas = has_decimal_commas(rows, "" if not separated or has_no_thousands else delimiter)
    if not separated:
        return cells, numbers, commas
    if all(row and row[-1] == "" for row in cells):
        cells = [row[:-1] for row in cells]  # every line ends in a separator
    if len(cells) > 1 and any(map(_listed, cells[1])):
        sizes = [len(_listed(cell)) for cell in cells[1]]
        head = [
            f"{cell}[{k}]" if size else cell
            for cell, size in zip(cells[0], sizes, strict=False)
            for k in range(max(size, 1))
        ]
        first = cells[0] if any(map(_listed, cells[0])) else head
        cells = [[part for cell in row for part in _listed(cell) or [cell]] for row in [first, *cells[1:]]]
    return cells, numbers, commas


def _listed(cell: str) -> list[str]:
    """Return the numbers of a cell that is a list, as Python writes it."""
    return re.split(r"[,\s]+", cell[1:-1].strip()) if cell[:1] + cell[-1:] == "[]" else []


def split_line(path: Path, line: str, number: int, delimiter: str, code: str) -> list[str]:
    """Return the cells of one line: a stray quotation mark must not swallow the lines after it.

    Quotation marks are read strictly, so that `"1"2` does not become 12.
    """
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, strict=True))]
    except csv.Error as error:
        what = f"the quotation marks do not enclose cells ({error}): {_quoted(line)}"
        raise refusal(code, path, None, what, "remove them, or export the file again", number) from None


def instant_s(cell: str) -> float | None:
    """Return the seconds of an ISO 8601 time, with a date (UTC if it has no zone) or without; else None.

    Two numbers, the last with decimals, are minutes and seconds; hours may have one digit.
    """
    cell = f"0{cell}" if cell[1:2] == ":" else cell
    if match := MINUTES.fullmatch(cell):
        return 60.0 * float(match[1]) + float(match[2])
    try:
        if cell[2:3] == ":":
            at = datetime.combine(datetime(1970, 1, 1, tzinfo=UTC), time.fromisoformat(cell))
        elif cell[4:5] == "-":
            at = datetime.fromisoformat(cell)
        else:
            return None
    except ValueError:
        return None
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def _plain(cell: str) -> str:
    """Return the text of a number; Python alone takes 1_0 and digits of other scripts for numbers too."""
    if "_" in cell or not cell.isascii():
        raise ValueError
    return cell


def _quoted(text: str) -> str:
    whole = len(text) <= LONGEST_QUOTE
    return repr(text if whole else f"{text[:LONGEST_QUOTE]}… ({len(text)} characters)")


def _is_value(cell: str) -> bool:
    """Return whether a cell is a number, a time, or empty."""
    try:
        float(_plain(cell))
    except ValueError:
        return cell == "" or _has_decimal_comma(cell) or instant_s(cell) is not None
    return True


def _decimals(cell: str) -> int:
    """Return the digits after a number's point; 0 if it has none, or an exponent."""
    match = re.fullmatch(r"[+-]?\d*[.,](\d+)", cell)
    return len(match[1]) if match else 0


def _is_cut(cell: str, fewest: int) -> bool:
    """Return whether a number is cut after fewer decimals than all others have, or at its point or before it.

    A zero may be written without decimals.
    """
    at_point = re.fullmatch(r"[+-]?(\d*[.,]|0*[1-9]\d*)", cell)
    return fewest > 0 and (at_point is not None or 0 < _decimals(cell) < fewest)


def _has_decimal_comma(cell: str) -> bool:
    head, comma, tail = cell.partition(",")
    return bool(comma) and head.lstrip("+-").isdigit() and tail[:1].isdigit()
