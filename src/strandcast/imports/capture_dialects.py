"""CSV and TSV of motion capture systems: each maker's names, units, rate and axes, as one table."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from strandcast.imports.mapping import unit_named
from strandcast.imports.table import NumberTable, table_of
from strandcast.records.csv_cells import LINE_END, Cells, read_text, split_line
from strandcast.records.record import refusal

AXIS = re.compile(r"(T|R)?([XYZW])\d*")  # Vicon's TX and RX, the X1 of a TRC file
ROTATION = [f"Rot[{k}]" for k in range(9)]  # Qualisys: by columns
BODY_6D = ["x", "y", "z", "roll", "pitch", "yaw", "residual", *ROTATION]
Rows = list[list[str]]


class Layout(NamedTuple):
    """Where a file has its numbers, and what it says of them.

    `names` are those of all columns; `first` is the first row of numbers, an empty one ends them.
    """

    maker: str
    names: list[str]
    first: int
    rate_hz: float | None = None
    unit: str | None = None
    up: str | None = None  # by the maker's convention
    zero_is_missing: bool = False


def read_capture_csv(path: Path) -> NumberTable | None:
    """Return the table of a motion capture system's file; None if it is none that is known.

    Columns are NAME.x, NAME.y, NAME.z, and NAME.qw … of an orientation; `time` or `frame`.

    Raises
    ------
    StrandcastError
        SC-I001: a known header over rows that do not fit it.
    """
    lines = LINE_END.split(read_text(path, "SC-I001"))
    head = next((line for line in lines if line.strip(' \t,;"')), "")
    delimiter = max("\t;,", key=head.count) if any(mark in head for mark in "\t;,") else ","
    rows = [split_line(path, line, k, delimiter, "SC-I001") for k, line in enumerate(lines, 1)]
    for dialect in DIALECTS:
        try:
            layout = dialect(rows)
        except (LookupError, StopIteration, ValueError) as error:
            what = f"it begins as a file of {dialect.__name__}, and its header is cut or unknown"
            raise refusal("SC-I001", path, None, what, "export it again, as CSV or C3D") from error
        if layout is not None:
            return _table(path, rows, layout)
    return None


def _table(path: Path, rows: Rows, layout: Layout) -> NumberTable:
    kept = []
    for number, row in enumerate(rows[layout.first :], layout.first + 1):
        if any(row):
            kept.append((number, row))
        elif kept:  # after an empty line, Vicon has its next table
            break
    width = len(layout.names)
    # Cells of markers that were not seen may be missing at the end of a row.
    padded = [[*row, *[""] * (width - len(row))] for _, row in kept]
    even = [row[:width] if not any(row[width:]) else row for row in padded]
    cells = Cells(path, layout.names, even, [number for number, _ in kept], True, "SC-I001")
    table = table_of(cells, [])
    if not kept:
        raise refusal("SC-I001", path, None, "the file has a header and no rows", "export it again")
    if layout.zero_is_missing:
        _empty_zeros(table)
    time = None
    if "time" in table.names:
        time = "time", 1.0
    elif "frame" in table.names and layout.rate_hz:
        time = "frame", 1.0 / layout.rate_hz
    return replace(
        _with_quaternions(table),
        time=time,
        rate_hz=layout.rate_hz,
        length_unit=unit_named(layout.unit),
        up=layout.up,
        maker=layout.maker,
    )


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
    if rows[0][0] != "Format Version":
        return None
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    axes = next(k for k, row in enumerate(rows) if row[0] == "Frame")
    _, named, *_, kinds = (row for row in rows[1:axes] if any(row))
    is_quaternion = facts.get("Rotation Type", "Quaternion") == "Quaternion"
    names = ["frame", "time"]
    for name, kind, axis in list(zip(named, kinds, rows[axes], strict=False))[2:]:
        turned = {"Position": "", "Rotation": "q" if is_quaternion else "r"}.get(kind)
        names.append(f"{name}.{kind}" if turned is None or not axis else f"{name}.{turned}{axis.lower()}")
    rate = facts.get("Export Frame Rate") or facts.get("Capture Frame Rate")
    return Layout("OptiTrack", names, axes + 1, float(rate) if rate else None, facts.get("Length Units"), "y")


def vicon(rows: Rows) -> Layout | None:
    """Read Vicon's ASCII: title, rate, names, axes, units; the first table that has positions."""
    heads = [k for k, row in enumerate(rows) if row[:2] == ["Frame", "Sub Frame"] and k >= 3]
    for at in heads:
        names, units = _by_axis(rows[at - 1], rows[at]), rows[at + 1]
        unit = {units[k] for k, name in enumerate(names[: len(units)]) if name.endswith((".x", ".y", ".z"))}
        if unit:
            return Layout("Vicon", names, at + 2, float(rows[at - 2][0]), "/".join(sorted(unit)), "z")
    return None


def qualisys(rows: Rows) -> Layout | None:
    """Read QTM's TSV, 3D or 6D: one fact a line, names, and perhaps a line of column headers."""
    if rows[0][0] != "NO_OF_FRAMES":
        return None
    at = next(k for k, row in enumerate(rows) if not re.fullmatch(r"[A-Z_]{4,}", row[0]))
    facts = {row[0]: row[1:] for row in rows[:at]}
    bodies = "BODY_NAMES" in facts
    named = [name for name in facts["BODY_NAMES" if bodies else "MARKER_NAMES"] if name]
    at += re.search("[A-Za-z]", "".join(rows[at])) is not None
    parts = BODY_6D if bodies else ["x", "y", "z"]
    # One cell more is the tab at the end of a row.
    has_time = len(rows[at]) >= len(named) * len(parts) + 2
    names = [
        *(["frame", "time"] if has_time else []),
        *(f"{name}.{part}" for name in named for part in parts),
    ]
    return Layout("Qualisys", names, at, float(facts["FREQUENCY"][0]), "mm", "z", zero_is_missing=True)


def trc(rows: Rows) -> Layout | None:
    """Read TRC, of Motion Analysis and OpenSim: facts in two lines, names, axes."""
    if rows[0][0] != "PathFileType":
        return None
    facts = dict(zip(rows[1], rows[2], strict=False))
    names = ["frame", "time", *_by_axis(rows[3], rows[4])[2:]]
    return Layout("TRC", names, 5, float(facts["DataRate"]), facts.get("Units"))


DIALECTS: list[Callable[[Rows], Layout | None]] = [optitrack, vicon, qualisys, trc]


def _by_axis(named: list[str], axes: list[str]) -> list[str]:
    """Return the names of columns from a row of axes under names that stand over the first of theirs."""
    found, name = ["frame"], ""
    turns = {name for name in axes if name.startswith("RW")}
    for k, axis in enumerate(axes[1:], 1):
        name = (named[k] if k < len(named) else "") or name
        match = AXIS.fullmatch(axis)
        turned = "" if match is None or match.group(1) != "R" else "q" if turns else "r"
        found.append(f"{name}.{turned}{match.group(2).lower()}" if match else f"{name}.{axis}")
    return found
