"""Motion captures as tables of numbers, CSV, Parquet or C3D, with the units and times of each."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from strandcast.core.even_clock import even_clock
from strandcast.core.jumps import GLITCH_M_S
from strandcast.imports.as_measured import not_held
from strandcast.imports.c3d_files import C3D, SUFFIX, read_c3d
from strandcast.imports.capture_dialects import read_capture_csv
from strandcast.imports.capture_mapping import CaptureMapping, at_rest
from strandcast.imports.mapping import LENGTH_UNITS, TIME_UNITS, unit_named
from strandcast.imports.table import NumberTable, read_numbers
from strandcast.records.record import refusal
from strandcast.records.tables import read_parquet

DEFAULT_TIME = "t"
FRAME = re.compile(r"frames?[\s_.#]*(no|nr|num|number|index)?\.?", re.IGNORECASE)
MICROSECOND_S = 1e-6
RATES_DIFFER = 1e-3
CLOCKS_DIFFER = 1e-2  # of a rate and a column of rounded times


def read_capture(path: str | Path) -> NumberTable:
    """Read a motion capture: Parquet or C3D by the file's name, else CSV; see the readers for the errors.

    A known system's file has columns NAME.x, NAME.y, NAME.z, whatever it calls them.
    """
    path = Path(path)
    if path.suffix.lower() == ".parquet":
        return _read_parquet_numbers(path)
    if path.suffix.lower() == SUFFIX:
        return read_c3d(path)
    return read_capture_csv(path) or read_numbers(path)


def _read_parquet_numbers(path: Path) -> NumberTable:
    table = read_parquet(path)
    kept: list[str] = []
    values, instants = [], set()
    for name, kind in zip(table.column_names, table.schema.types, strict=True):
        column, unit_s = table.column(name), 1.0
        if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
            instants.add(len(kept))
            in_ns = pa.timestamp("ns") if pa.types.is_timestamp(kind) else pa.duration("ns")
            column, unit_s = column.cast(in_ns, safe=False).cast(pa.int64()), 1e-9
        elif not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)):
            continue
        kept.append(name)
        values.append(unit_s * column.cast(pa.float64(), safe=False).to_numpy())
    rows = table.num_rows
    columns = np.array(values).reshape(len(kept), rows).T
    return NumberTable(path, kept, columns, 1 + np.arange(rows), True, instants=frozenset(instants))


def with_units(table: NumberTable, mapping: CaptureMapping) -> tuple[CaptureMapping, list[str]]:
    """Return a mapping with what it does not give and the file says, and remarks.

    Raises
    ------
    StrandcastError
        SC-I027 another unit of length than the file's; SC-I011 neither gives the unit, or the axis up, of a
        capture in space.
    """
    known, notes = unit_named(table.length_unit), []
    unit = mapping.length_unit or known
    if known is not None and known != unit:
        what = f"is {unit}, the file says {table.length_unit}"
        raise refusal("SC-I027", table.path, "length_unit", what, "leave it out, or give the file's unit")
    if not mapping.in_space and not table.length_unit:
        unit = unit or "m"
    if unit is None:
        fix = f"give --length-unit ({', '.join(LENGTH_UNITS)}), or length_unit in a mapping"
        what = "the file does not say its unit of length"
        what = f"the file's unit of length is {table.length_unit!r}" if table.length_unit else what
        raise refusal("SC-I011", table.path, "length_unit", what, fix)
    found: dict[str, object] = {"length_unit": unit}
    if mapping.in_space and mapping.up is None:
        if table.up is None:
            what, fix = (
                "the file does not say which axis points up",
                "give --up z (or y …), or up in a mapping",
            )
            raise refusal("SC-I011", table.path, "up", what, fix)
        why = "as the file says" if table.maker == C3D else f"as usual in files of {table.maker}"
        notes.append(f"{table.up} is taken to point up, {why}; else give --up")
        found["up"] = table.up
    return mapping.model_copy(update=found), notes


def times_of(table: NumberTable, mapping: CaptureMapping) -> tuple[np.ndarray, list[str]]:
    """Return the times (rows,) [s] of a capture, which rise: by the mapping, else by the file's own clock.

    Rounded times are those of the even clock that they fit, with a remark.

    Raises
    ------
    StrandcastError
        SC-I011 there is no time and no rate; SC-I028 another rate than the file's; SC-I007, SC-I001.
    """
    if mapping.time is not None:
        column, time_s = mapping.time, table.times(mapping.time, TIME_UNITS[mapping.time_unit])
    else:
        column, time_s = _own_times(table, mapping)
    table.require_finite(time_s[:, None], [column])
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if len(back):
        fix = "sort the rows by time and remove doubled ones"
        raise table.refusal(back[0] + 1, column, "time does not rise here", fix, "SC-I007")
    if len(time_s) < 3:
        raise refusal("SC-I001", table.path, None, f"{len(time_s)} rows are no motion", "export it again")
    stamps = np.rint((time_s - time_s[0]) / MICROSECOND_S).astype(np.int64)
    even = even_clock(stamps, MICROSECOND_S) if np.diff(stamps).min() > 0 else None
    if even is None:
        return time_s, []
    unit_s, step_s = even.rounded_to * MICROSECOND_S, even.step * MICROSECOND_S
    note = f"its times are rounded to {unit_s:g} s: those of {1.0 / step_s:.6g} rows per second are used"
    return time_s[0] + step_s * even.frame, [note]


def _own_times(table: NumberTable, mapping: CaptureMapping) -> tuple[str, np.ndarray]:
    rate_hz = mapping.rate_hz or table.rate_hz
    if rate_hz and table.rate_hz and abs(rate_hz / table.rate_hz - 1.0) > RATES_DIFFER:
        what = f"is {rate_hz:g}, the file says {table.rate_hz:g}"
        raise refusal("SC-I028", table.path, "rate_hz", what, "leave rate_hz out")
    if table.time is not None:
        return table.time[0], table.times(*table.time)
    if rate_hz is not None:
        _refuse_another_clock(table, mapping, rate_hz)
        if (numbered := _frames(table)) is not None:
            return numbered, table.times(numbered, 1.0 / rate_hz)
        return "rate_hz", np.arange(len(table.values)) / rate_hz
    if DEFAULT_TIME not in table.names:
        what = f"no column of the time is named, and the file has no rate; it has {table.listed('time')}"
        fix = "give --time COLUMN and, if it is not in s, --time-unit; or --rate"
        raise refusal("SC-I011", table.path, "time", what, fix)
    return DEFAULT_TIME, table.times(DEFAULT_TIME, TIME_UNITS[mapping.time_unit])


def _frames(table: NumberTable) -> str | None:
    """Return the column that numbers the rows, where some may be missing; None if there is none."""
    for name in filter(FRAME.fullmatch, table.names):
        number = table.values[:, table.names.index(name)]
        steps = np.diff(number)
        if len(steps) and (steps >= 1.0).all() and np.median(steps) == 1.0 and (number % 1.0 == 0.0).all():
            return name
    return None


def _refuse_another_clock(table: NumberTable, mapping: CaptureMapping, rate_hz: float) -> None:
    """Refuse a rate beside a rising column t that has another, or gaps that no number of the rows shows."""
    if table.rate_hz is not None or DEFAULT_TIME not in table.names:
        return
    time_s = table.times(DEFAULT_TIME, TIME_UNITS[mapping.time_unit])
    if not (np.diff(time_s) > 0).all():
        return
    rates_hz = {"": _rate_hz(time_s)}
    if _frames(table) is None:
        rates_hz[" with its gaps"] = (len(time_s) - 1) / float(time_s[-1] - time_s[0])
    for words, own_hz in rates_hz.items():
        if abs(own_hz / rate_hz - 1.0) > CLOCKS_DIFFER:
            what = f"is {rate_hz:g}, the file's column {DEFAULT_TIME} has {own_hz:.4g} rows per second{words}"
            raise refusal("SC-I028", table.path, "rate_hz", what, "leave --rate out, or give --time-unit")


def _rate_hz(time_s: np.ndarray) -> float:
    """Return the rows per second of times that may be rounded and have gaps."""
    steps = np.diff(time_s)
    return 1.0 / float(steps[steps < 1.5 * np.median(steps)].mean())


def as_measured(
    table: NumberTable, mapping: CaptureMapping, time_s: np.ndarray
) -> tuple[NumberTable, np.ndarray, list[str]]:
    """Return a table and times without what was not measured, and remarks.

    A point that jumps to 0, 0, 0 or from there was not measured there; rows held over are left out.
    """
    rate_hz, notes = _rate_hz(time_s), []
    if table.rate_hz is not None and abs(rate_hz / table.rate_hz - 1.0) > CLOCKS_DIFFER:
        notes.append(
            f"the file says {table.rate_hz:g} rows per second, and its times are those of {rate_hz:.4g}, "
            "which are used"
        )
    values = table.values.copy()
    measured = [columns for columns in mapping.positions() if at_rest(columns) is None]
    places = [[table.index(name) for name in columns] for columns in measured]
    for columns, numbers in zip(measured, places, strict=True):
        place_m = table.columns(columns) * mapping.unit_m()
        if (missing := _jumps_to_zero(place_m, time_s)).any():
            values[np.ix_(missing, np.array(numbers))] = np.nan
            words = f"{missing.sum()} rows of {', '.join(columns)} are exactly 0"
            notes.append(f"{words}, far from the rows around: not measured")
    first, held = not_held(time_s, values[:, np.unique(np.concatenate(places))], "markers")
    return replace(table, values=values[first], lines=table.lines[first]), time_s[first], notes + held


def _jumps_to_zero(place_m: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return (rows,) in which a place (rows, 2 or 3) is exactly 0, and is not reached or left by a motion."""
    zero = (place_m == 0.0).all(axis=1)
    edge = np.diff(zero.astype(int)) != 0
    run = np.concatenate([[0], np.cumsum(edge)])
    jumps = edge & (np.hypot.reduce(np.diff(place_m, axis=0), axis=1) > GLITCH_M_S * np.diff(time_s))
    return np.asarray(zero & (np.isin(run, run[:-1][jumps]) | np.isin(run, run[1:][jumps])))
