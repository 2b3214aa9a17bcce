"""Bring in a joint log: a CSV with known or named columns, or a ROS bag, to joints.csv and run.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError
from strandcast.imports.bags import BagChoice, is_bag, read_bag, sha256_bag
from strandcast.imports.dialects import recognise
from strandcast.imports.mapping import ANGLE_UNITS, TIME_UNITS, JointMapping
from strandcast.imports.motion_start import motion_times
from strandcast.imports.table import NumberTable, read_numbers, refusal
from strandcast.records.files import sha256_file
from strandcast.records.joint_log import AFTER_DUPLICATE, SYNC_HIGH, JointLog, Run, timing_of, write_joint_log
from strandcast.records.motion import Motion

LARGEST_ANGLE_RAD = 20.0  # three turns: beyond it are degrees
COMMAND_MOVES_RAD = 1e-5
# What the player asks of its own logs.
TAIL_S = 0.5
LONGEST_GAP = 6.5  # steps
IMPORTED = "import: "  # how the driver of an imported run begins


@dataclass(frozen=True)
class Played:
    """What is known of a throw beside its log: the motion that was played, and the arm that played it."""

    motion: Motion
    arm: Arm


@dataclass(frozen=True)
class Reading:
    """How a log is to be read, where it does not say so itself.

    Attributes
    ----------
    dialect
        ``auto``, ``libfranka``, ``ur_rtde`` or ``ur``; not looked at for a bag, or where a mapping is given.
    mapping
        The columns of a log of no known dialect.
    bag
        Topic and clock of a ROS bag.
    degrees
        The angles are in degrees.
    sync_output
        Number of the digital output that is the sync event, in the column of outputs.
    """

    dialect: str = "auto"
    mapping: JointMapping | None = None
    bag: BagChoice = field(default_factory=BagChoice)
    degrees: bool = False
    sync_output: int | None = None


@dataclass(frozen=True)
class _Source:
    """A log's table, what its columns mean, and what is known of it besides."""

    name: str
    table: NumberTable
    columns: JointMapping
    namings: Sequence[list[str]]
    sha256: str
    clock: str
    notes: list[str] = field(default_factory=list)


def import_joints(
    path: str | Path,
    folder: str | Path,
    reading: Reading | None = None,
    namings: Sequence[list[str]] = (),
    played: Played | None = None,
) -> Run:
    """Write joints.csv and, last, run.json into a trial's folder and return the run.

    Parameters
    ----------
    path
        The log as the robot's software wrote it.
    folder
        ``data/<experiment>/trial-NN``.
    reading
        How to read it.
    namings
        Names that the joints may have, base to hand; of a CSV the first list of as many as the log has joints
        is taken, by default ``joint_1`` …; a bag's joints go by its own names (`imports.bags.read_bag`).
    played
        Motion and arm, where known. By default the motion is when the commanded joints move.

    Raises
    ------
    StrandcastError
        A file that does not fit, unsorted times, empty cells: file, line, column. SC-I032: the log holds a
        part of the motion only.
    """
    source = _source(Path(path), reading or Reading(), namings)
    time_s, log = _log_of(source, reading.sync_output if reading else None)
    times = _times_of(log) if played is None else motion_times(log, played.motion, played.arm, str(path))
    if times is not None:
        inside = (log.time_s >= times[0]) & (log.time_s <= times[1])
        log.since_start_s[inside] = log.time_s[inside] - times[0]
    _refuse_part(log.time_s, times, str(path))
    timing = timing_of(time_s, source.columns.rate_hz)
    folder = Path(folder)
    # It says that an import is complete: it must not stand beside half of another.
    (folder / "run.json").unlink(missing_ok=True)
    run = Run(
        complete=True,
        status="imported",
        reason=None,
        joints_sha256=write_joint_log(folder / "joints.csv", log),
        rows=len(log.time_s),
        motion_sha256=None if played is None else played.motion.content_sha256(),
        arm_sha256=None if played is None else played.arm.sha256,
        driver=f"{IMPORTED}{source.name}",
        controller={"file": Path(path).name, "sha256": source.sha256},
        joint_names=log.joint_names,
        clock=source.clock,
        motion_start_s=None if times is None else times[0],
        motion_end_s=None if times is None else times[1],
        sync_events=[],
        timing=timing,
        video={},
        warnings=source.notes + _warnings(time_s) + _cover_warnings(log.time_s, times) + _unknown(played),
    )
    run.write(folder / "run.json")
    return run


def _source(path: Path, reading: Reading, namings: Sequence[list[str]]) -> _Source:
    """Read a bag, or a CSV by its mapping or its dialect."""
    if is_bag(path):
        bag = read_bag(path, reading.bag, namings)
        columns = _in_degrees(bag.mapping) if reading.degrees else bag.mapping
        return _Source("bag", bag.table, columns, [bag.names], sha256_bag(path), bag.clock, bag.notes)
    table = read_numbers(path)
    name, columns = (
        ("mapping", reading.mapping) if reading.mapping is not None else recognise(table, reading.dialect)
    )
    columns = _in_degrees(columns) if reading.degrees else columns
    clock = f"the column {columns.time!r} of the log"
    return _Source(name, table, columns, namings, sha256_file(path), clock)


def _in_degrees(columns: JointMapping) -> JointMapping:
    return columns.model_copy(update={"angle_unit": "deg"})


def _log_of(source: _Source, sync_output: int | None) -> tuple[np.ndarray, JointLog]:
    """Return all times (rows,), and the log without doubled rows."""
    table, columns = source.table, source.columns
    time_s = table.column(columns.time) * TIME_UNITS[columns.time_unit]
    q = table.columns(columns.q) * ANGLE_UNITS[columns.angle_unit]
    table.require_finite(np.column_stack([time_s, q]), [columns.time, *columns.q])
    _refuse_unsorted(table, columns.time, time_s)
    _refuse_degrees(table, columns, q)
    names = _names(table, len(columns.q), source.namings)
    keep = np.concatenate([[True], np.diff(time_s) > 0])
    doubled = np.flatnonzero(~keep)
    flags = np.zeros(len(time_s), np.int32)
    flags[np.minimum(doubled + 1, len(flags) - 1)] = AFTER_DUPLICATE
    flags[_sync_high(table, columns, sync_output)] |= SYNC_HIGH
    return time_s, JointLog(
        joint_names=names,
        time_s=time_s[keep],
        q_rad=q[keep],
        qd_rad_s=_optional(table, columns.qd, columns)[keep],
        q_cmd_rad=_optional(table, columns.q_cmd, columns)[keep],
        qd_cmd_rad_s=_optional(table, columns.qd_cmd, columns)[keep],
        since_start_s=np.full(int(keep.sum()), np.nan),
        flags=flags[keep],
    )


def _sync_high(table: NumberTable, columns: JointMapping, output: int | None) -> np.ndarray:
    """Return (rows,) whether the output of the sync event is high."""
    if output is None:
        return np.zeros(len(table.values), bool)
    if columns.outputs is None:
        raise StrandcastError(
            "SC-I009",
            "the log has no column of digital outputs",
            file=table.path,
            field="sync-output",
            fix="record actual_digital_output_bits, or name the column in the mapping: outputs",
        )
    bits = table.column(columns.outputs)
    table.require_finite(bits[:, None], [columns.outputs])
    return (bits.astype(np.int64) >> output & 1).astype(bool)


def _names(table: NumberTable, joints: int, namings: Sequence[list[str]]) -> list[str]:
    if not namings:
        return [f"joint_{k + 1}" for k in range(joints)]
    for names in namings:
        if len(names) == joints:
            return list(names)
    counts = " or ".join(sorted({str(len(names)) for names in namings}))
    raise StrandcastError(
        "SC-I006",
        f"the log has {joints} joints, and {counts} names are known",
        file=table.path,
        field="joints",
        fix="take the arm's own file, or name every joint of the log, from the base on: --joint NAME …",
    )


def _optional(table: NumberTable, names: list[str], columns: JointMapping) -> np.ndarray:
    """Return columns (rows, J), or NaN where the log has none."""
    if not names:
        return np.full((len(table.values), len(columns.q)), np.nan)
    if len(names) != len(columns.q):
        raise StrandcastError(
            "SC-I006",
            f"{len(columns.q)} joints are measured and {len(names)} columns are given",
            file=table.path,
            fix="give one column for each joint, or none",
        )
    return table.columns(names) * ANGLE_UNITS[columns.angle_unit]


def _refuse_unsorted(table: NumberTable, name: str, time_s: np.ndarray) -> None:
    back = np.flatnonzero(np.diff(time_s) < 0)
    if len(back):
        row = int(back[0]) + 1
        raise refusal(
            table.path,
            int(table.lines[row]),
            name,
            f"time runs back by {time_s[row - 1] - time_s[row]:.6g} s here ({len(back)} times in all)",
            "sort the rows by time, or give the column of the controller's own clock",
            code="SC-I007",
        )


def _refuse_degrees(table: NumberTable, columns: JointMapping, q: np.ndarray) -> None:
    largest = np.unravel_index(np.argmax(np.abs(q)), q.shape)
    if abs(q[largest]) > LARGEST_ANGLE_RAD:
        raise refusal(
            table.path,
            int(table.lines[largest[0]]),
            columns.q[largest[1]],
            f"an angle of {q[largest]:.1f} rad",
            "if the log is in degrees, say so: --degrees, or angle_unit: deg in a mapping",
            code="SC-I008",
        )


def _times_of(log: JointLog) -> tuple[float, float] | None:
    """Return the first and the last change of the commanded joints; None where the log has no commands."""
    told = np.isfinite(log.q_cmd_rad).all(axis=1)
    if not told.any():
        return None
    times, command = log.time_s[told], log.q_cmd_rad[told]
    changes = np.flatnonzero(np.abs(np.diff(command, axis=0)).max(axis=1) > COMMAND_MOVES_RAD)
    if not len(changes):
        return None
    return float(times[changes[0]]), float(times[changes[-1] + 1])


def _warnings(time_s: np.ndarray) -> list[str]:
    """Tell the longest gap and the doubled rows in words; run.json's timing has them all."""
    timing = timing_of(time_s)
    warnings = []
    if timing.gaps:
        longest = max(timing.gaps, key=lambda gap: gap.duration_s)
        missing = sum(gap.missing for gap in timing.gaps)
        warnings.append(
            f"{len(timing.gaps)} gaps, {missing} samples missing; the longest is "
            f"{longest.duration_s * 1e3:.1f} ms, after {time_s[longest.index]:.3f} s"
        )
    if timing.duplicates:
        first = float(time_s[int(np.flatnonzero(np.diff(time_s) == 0)[0])])
        warnings.append(
            f"{timing.duplicates} rows repeat a time and were left out, the first at {first:.3f} s"
        )
    step_ms = np.diff(time_s) * 1e3
    if timing.uneven > 0.01 * len(step_ms):
        warnings.append(
            f"{timing.uneven} of {len(step_ms)} steps are not of the usual {1e3 / timing.rate_hz:.1f} ms "
            f"({step_ms.min():.1f} to {step_ms.max():.1f} ms): {1e3 / step_ms.mean():.1f} Hz on average"
        )
    return warnings


def _refuse_part(time_s: np.ndarray, times: tuple[float, float] | None, file: str) -> None:
    """Refuse a log that begins or ends within the motion, by more cycles than a throw may lack."""
    if times is None:
        return
    early_s, late_s = time_s[0] - times[0], times[1] - time_s[-1]
    lacking = [
        f"{1e3 * lack_s:.0f} ms of the motion's {where}"
        for lack_s, where in ((early_s, "beginning"), (late_s, "end"))
        if lack_s > LONGEST_GAP * np.median(np.diff(time_s))
    ]
    if lacking:
        raise StrandcastError(
            "SC-I032",
            f"the log lacks {' and '.join(lacking)}",
            file=file,
            cost="a throw without its whole log is no trial: nothing was imported",
            fix=f"record from before the motion until {TAIL_S} s after it, and throw again",
        )


def _unknown(played: Played | None) -> list[str]:
    if played is not None:
        return []
    return [
        "there is no motion.json in the trial's folder: when the motion began is known from the commanded "
        "joints at best, and no later motion can be planned around it; put it there, import again: --replace"
    ]


def _cover_warnings(time_s: np.ndarray, times: tuple[float, float] | None) -> list[str]:
    """Tell where a log does not cover the motion as one of the player's must."""
    if times is None:
        return []
    start_s, end_s = times
    warnings = []
    if time_s[0] > start_s:
        warnings.append(f"the log begins {1e3 * (time_s[0] - start_s):.0f} ms after the motion")
    if time_s[-1] < end_s + TAIL_S:
        warnings.append(
            f"the log ends {1e3 * (time_s[-1] - end_s):.0f} ms after the motion; the joints arrive late, and "
            f"the string moves on: record {TAIL_S} s more"
        )
    steps = np.diff(time_s)
    moving = (time_s[1:] > start_s) & (time_s[:-1] < end_s)
    if (moving & (steps > LONGEST_GAP * np.median(steps))).any():
        longest_ms = 1e3 * steps[moving].max()
        warnings.append(f"the log lacks {longest_ms:.0f} ms of the motion itself: better throw again")
    return warnings
