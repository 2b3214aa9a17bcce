"""CSV and TSV of motion capture systems: each maker's names, units, rate and axes, as one table."""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import chain, pairwise, takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from strandcast.imports.mapping import unit_named
from strandcast.imports.table import NumberTable, table_of
from strandcast.records.csv_cells import (
    EMPTY,
    LINE_END,
    Cells,
    has_decimal_commas,
    read_text,
    separator_of,
    split_line,
)
from strandcast.records.record import refusal

AXIS = re.compile(r"(T|R)?([XYZW])\d*")  # Vicon's TX and RX, the X1 of a TRC file
ROTATION = [f"Rot[{k}]" for k in range(9)]  # Qualisys: by columns
BODY_6D = ["x", "y", "z", "roll", "pitch", "yaw", "residual", *ROTATION]
MOST_HEADERS = 10  # rows before OptiTrack's row of axes
LOCAL = "Coordinate Space is Local: what is relative to a body is read as if it were not; export Global"
Rows = list[list[str]]


class Layout(NamedTuple):
    """Where a file has its numbers, and what it says of them.

    `tables` are side by side: the first row of each, which an empty one ends, and the names of its columns.
    """

    maker: str
    tables: list[tuple[int, list[str]]]
    rate_hz: float | None = None
    unit: str | None = None
    up: str | None = None  # by the maker's convention
    zero_is_missing: bool = False
    notes: list[str] = []


def read_capture_csv(path: Path) -> NumberTable | None:
    """Return the table of a motion capture system's file; None if it is none that is known.

    Columns are NAME.x, NAME.y, NAME.z, and NAME.qw … of an orientation; `time` or `frame`.

    Raises
    ------
    StrandcastError
        SC-I001: a known header over rows that do not fit it.
    """
    text = read_text(path, "SC-I001")
    lines = LINE_END.split(text)
    separator = separator_of([line for line in lines if line.strip()])
    rows = [split_line(path, line, k, separator, "SC-I001") for k, line in enumerate(lines, 1)]
    for dialect in DIALECTS:
        try:
            layout = dialect(rows)
        except (LookupError, StopIteration, ValueError) as error:
            what = f"it begins as a file of {dialect.__name__}, and its header is cut or unknown"
            raise refusal("SC-I001", path, None, what, "export it again, as CSV or C3D") from error
        if layout is not None:
            commas = has_decimal_commas(lines[layout.tables[0][0] :], separator)
            return _table(path, rows, layout, commas, text.endswith(("\n", "\r")))
    return None


def _table(path: Path, rows: Rows, layout: Layout, commas: bool, ends: bool) -> NumberTable:
    bodies = [_body(rows, first, len(names)) for first, names in layout.tables]
    names = [name for _, each in layout.tables for name in each]
    beside = [list(chain(*parts)) for parts in zip(*(body for _, body in bodies), strict=True)]
    if not beside:
        raise refusal("SC-I001", path, None, "the file has a header and no rows", "export it again")
    if not ends and len(rows[-1]) < len(rows[-2]):  # the last row was cut
        beside[-1] = rows[-1]
    lines = [bodies[0][0] + 1 + k for k in range(len(beside))]
    cells = Cells(path, names, beside, lines, True, "SC-I001", ends, commas)
    table = table_of(*cells.without_cut_line())
    if layout.zero_is_missing:
        _empty_zeros(table)
    time = None
    if "time" in table.names:
        time = "time", 1.0
    elif "frame" in table.names and layout.rate_hz:
        time = "frame", 1.0 / layout.rate_hz
    return replace(
        _with_quaternions(table),
        notes=layout.notes + table.notes,
        time=time,
        rate_hz=layout.rate_hz,
        length_unit=layout.unit,
        up=layout.up,
        maker=layout.maker,
    )


def _body(rows: Rows, first: int, width: int) -> tuple[int, Rows]:
    """Return the rows of numbers up to an empty one, after which Vicon has its next table, and the first."""
    at = next((k for k in range(first, len(rows)) if any(rows[k])), len(rows))
    # Cells of markers that were not seen may be missing at the end of a row.
    padded = [[*row, *[""] * (width - len(row))] for row in takewhile(any, rows[at:])]
    return at, [row[:width] if not any(row[width:]) else row for row in padded]


def _empty_zeros(table: NumberTable) -> None:
    for name in table.points():
        columns = [table.names.index(f"{name}.{axis}") for axis in "xyz"]
        table.values[np.ix_((table.values[:, columns] == 0.0).all(axis=1), columns)] = np.nan


def _with_quaternions(table: NumberTable) -> NumberTable:
    """Return the table with a quaternion for each rotation matrix."""
    names, columns = list(table.names), [table.values]
    for name in table.points():
        nine = [f"{name}.{part}" for part in ROTATION]
        if not set(nine) <= set(table.names):
            continue
        matrices = table.columns(nine).reshape(-1, 3, 3).transpose(0, 2, 1)
        seen = np.isfinite(matrices).all(axis=(1, 2)) & (np.abs(np.linalg.det(matrices) - 1.0) < 0.1)
        q = np.full((len(matrices), 4), np.nan)
        if seen.any():
            q[seen] = Rotation.from_matrix(matrices[seen]).as_quat(scalar_first=True)
        names += [f"{name}.q{axis}" for axis in "wxyz"]
        columns.append(q)
    return replace(table, names=names, values=np.hstack(columns))


def optitrack(rows: Rows) -> Layout | None:
    """Read Motive's CSV: a line of facts, then type, name, ID, kind and axis of each column."""
    heads = [k for k, row in enumerate(rows[:MOST_HEADERS]) if row[0] == "Frame" and {*row[2:]} & {*"XYZ"}]
    has_facts = rows[0][0] == "Format Version"
    if not has_facts and (not heads or heads[0] == 0):
        return None
    axes = heads[0]
    # A comma in the take's name shifts what follows it.
    facts = dict(pairwise(rows[0])) if has_facts else {}
    _, named, *_, kinds = (row for row in rows[has_facts:axes] if any(row))
    is_quaternion = facts.get("Rotation Type", "Quaternion") == "Quaternion"
    names = ["frame", "time"]
    for name, kind, axis in list(zip(named, kinds, rows[axes], strict=False))[2:]:
        turned = {"Position": "", "Rotation": "q" if is_quaternion else "r"}.get(kind)
        names.append(f"{name}.{kind}" if turned is None or not axis else f"{name}.{turned}{axis.lower()}")
    rate_hz = _number(facts.get("Export Frame Rate") or facts.get("Capture Frame Rate"))
    notes = [LOCAL] if facts.get("Coordinate Space") == "Local" else []
    return Layout("OptiTrack", [(axes + 1, names)], rate_hz, facts.get("Length Units"), "y", notes=notes)


def vicon(rows: Rows) -> Layout | None:
    """Read Vicon's ASCII: title, rate, names, axes, units; tables of positions in the same frames as one."""
    heads = [k for k, row in enumerate(rows) if row[:2] == ["Frame", "Sub Frame"] and k >= 2]
    alike: dict[tuple[str, ...], list[tuple[int, list[str]]]] = {}
    units: dict[tuple[str, ...], set[str]] = {}
    for at in heads:
        names = _by_axis(rows[at - 1], rows[at], rows[at + 1])
        of_points = [k for k, name in enumerate(names) if name.endswith((".x", ".y", ".z"))]
        if of_points:
            frames = rows[at - 2][0], *(row[0] for row in _body(rows, at + 2, 1)[1])
            alike.setdefault(frames, []).append((at + 2, names))
            units.setdefault(frames, set()).update(rows[at + 1][k] for k in of_points)
    if not heads:
        return None
    most = max(alike, key=lambda frames: sum(len(names) for _, names in alike[frames]))
    return Layout("Vicon", alike[most], _number(most[0]), "/".join(sorted(units[most])), "z")


def qualisys(rows: Rows) -> Layout | None:
    """Read QTM's TSV, 3D or 6D: one fact a line, names, and perhaps a line of column headers."""
    if rows[0][0] not in ("NO_OF_FRAMES", "FILE_VERSION"):
        return None
    at = next(k for k, row in enumerate(rows) if any(row) and not re.fullmatch(r"[A-Z_]{4,}", row[0]))
    facts = {row[0]: row[1:] for row in rows[:at]}
    bodies = "BODY_NAMES" in facts
    named = [name for name in facts["BODY_NAMES" if bodies else "MARKER_NAMES"] if name]
    heads = [cell.lower() for cell in rows[at]]
    at += any(cell not in EMPTY and _number(cell) is None for cell in heads)
    parts = BODY_6D if bodies else ["x", "y", "z"]
    names = [f"{name}.{part}" for name in named for part in parts]
    lead = ["frame", "time"] + ["smpte"] * ("smpte" in heads)
    if (
        bodies
        and len(named) > 1
        and any(
            not any(row[k] for row in rows[at:] if any(row)) for k in (len(parts), len(parts) + len(lead))
        )
    ):  # an empty column between bodies
        names = [each for name in named for each in (*(f"{name}.{part}" for part in parts), "")][:-1]
    # One cell more is the tab at the end of a row.
    names = lead * (len(rows[at]) >= len(names) + len(lead)) + names
    rate_hz = _number(facts["FREQUENCY"][0])  # or EXT
    return Layout("Qualisys", [(at, names)], rate_hz, "mm", "z", zero_is_missing=True)


def trc(rows: Rows) -> Layout | None:
    """Read TRC, of Motion Analysis and OpenSim: facts in two lines, names, axes."""
    if rows[0][0] != "PathFileType":
        return None
    facts = dict(zip(rows[1], rows[2], strict=False))
    names = ["frame", "time", *_by_axis(rows[3], rows[4])[2:]]
    return Layout("TRC", [(5, names)], _number(facts["DataRate"]), facts.get("Units"))


DIALECTS: list[Callable[[Rows], Layout | None]] = [qualisys, trc, vicon, optitrack]


def _by_axis(named: list[str], axes: list[str], units: list[str] | None = None) -> list[str]:
    """Return the names of columns from a row of axes under names that stand over the first of theirs.

    Where there are units, a coordinate is a length: angles and forces have an X, too.
    """
    found, name = ["frame"], ""
    turns = {name for name in axes if name.startswith("RW")}
    for k, axis in enumerate(axes[1:], 1):
        name = (named[k] if k < len(named) else "") or name
        match = AXIS.fullmatch(axis)
        if match is not None and match.group(1) == "R":
            found.append(f"{name}.{'q' if turns else 'r'}{match.group(2).lower()}")
        elif match is not None and (units is None or unit_named("".join(units[k : k + 1]))):
            found.append(f"{name}.{match.group(2).lower()}")
        else:
            found.append(".".join(filter(None, [name, axis])))
    return found


def _number(text: str | None) -> float | None:
    try:
        return float((text or "").replace(",", "."))
    except ValueError:
        return None
