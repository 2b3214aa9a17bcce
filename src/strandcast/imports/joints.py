"""Import a joint log, a CSV with known or named columns or a ROS bag, as joints.csv and run.json."""

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import scipy

from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError
from strandcast.imports.as_measured import as_measured
from strandcast.imports.clock import clock_problem
from strandcast.imports.coverage import check_coverage, timing_warnings
from strandcast.imports.dialects import recognise
from strandcast.imports.mapping import ANGLE_UNITS, LARGEST_ANGLE_RAD, TIME_UNITS, JointMapping, JointSource
from strandcast.imports.motion_start import CLEARLY_LESS, LARGEST_LEFT_RAD, motion_times, played_plan
from strandcast.imports.ros_bags import Clock, is_bag, read_bag
from strandcast.imports.table import NumberTable, read_numbers
from strandcast.records.files import sha256_file
from strandcast.records.joint_log import AFTER_DUPLICATE, SYNC_HIGH, JointLog, Run, timing_of, write_joint_log
from strandcast.records.kept_motions import take_motion
from strandcast.records.motion import Motion
from strandcast.records.record import refusal

TURN_AS_DEGREES_RAD = np.radians(2.0 * np.pi)  # a whole turn in radians that is read as degrees
DEGREES = re.compile(r"[_.\s(\[]deg(rees?)?([_.\s)\]/]|$)|°", re.IGNORECASE)  # in a column's name
OUTPUTS = 53  # bits that a float holds exactly; UR has 18
COMMAND_MOVES_RAD = 1e-5  # chosen; above rounding
RATES_DIFFER = 0.1  # of a stated rate and that of the times, which may jitter; chosen
FEWEST_COMMANDS = 10  # rows with commands, to compare them with the joints; chosen
NO_MOTION = (
    "there is no motion.json in the trial's folder: the motion's start is known from the commanded joints at "
    "best, and no later motion is planned near it; put the motion that was played there, and import again: "
    "--replace"
)
UNNAMED = (
    "its {} columns have no names: read as a UR log, time, six angles q and their speeds qd; the others are "
    "not used"
)
IMPORTED = "import: "  # start of an imported run's driver name


@dataclass(frozen=True)
class Played:
    """What was played on an arm."""

    motion: Motion | None  # beside the raw files, if there is one
    arm: Arm
    is_rehearsal: bool = False  # the log is of no use without its motion
    # The motions that were planned for this throw, by path: if the log is that of one of them, that counts.
    plans: Mapping[Path, Motion] = field(default_factory=dict)
    # The experiment's other motions by path, which it should not be.
    others: Mapping[str, Motion] = field(default_factory=dict)


@dataclass(frozen=True)
class Reading:
    """How to read a log that does not describe itself."""

    dialect: str = "auto"  # or one of `dialects.DIALECTS`; ignored for a bag and with a mapping
    mapping: JointMapping | None = None  # the columns of a log without a known dialect
    topic: str | None = None  # of a ROS bag: by default the only one with joints
    clock: Clock = "header"  # its stamp in each message's header, or when the recorder received it
    degrees: bool = False  # whether the angles are
    sync_output: int | None = None  # the digital output with the sync event, in the column of outputs
    rate_hz: float | None = None  # rows per second of a log without a column of the time


def import_joints(
    path: str | Path,
    folder: str | Path,
    reading: Reading | None = None,
    namings: Sequence[list[str]] = (),
    played: Played | None = None,
) -> Run:
    """Write joints.csv and, last, run.json into a trial's folder and return the run.

    `namings` are names that the joints may have, base to hand. For a CSV the first list with as many names as
    the log has joints is used, by default ``joint_1`` …; a bag has its own names (`ros_bags.read_bag`).
    Without a motion it lasts while the commanded joints move.

    Raises
    ------
    StrandcastError
        A file that does not fit, unsorted times, empty cells: file, line, column. SC-I032: the log holds
        only a part of the motion.
    """
    source = _source(Path(path), reading or Reading(), namings)
    time_s, log = _log_of(source, reading.sync_output if reading else None)
    motion, taken = None if played is None else played.motion, None
    nominal_hz = source.columns.rate_hz
    measured, notes = as_measured(log, motion or next(iter(played.plans.values()), None) if played else None)
    if len(measured.time_s) < len(log.time_s):
        time_s, nominal_hz = measured.time_s, None
    log = measured
    doubts = _check_commands(log, str(path))
    if played is not None:
        taken = played_plan(log, motion, played.plans, played.arm)
        motion = motion if taken is None else played.plans[taken]
    if played is not None and played.is_rehearsal and motion is None:
        raise _rehearsal_of_no_motion(Path(folder), played.plans)
    unlike: list[str] = []
    if played is None or motion is None:
        times = _command_span(log)
    else:
        start_s, end_s, unlike = motion_times(log, motion, played.arm, str(path), played.others)
        times = start_s, end_s
    warnings = [*source.notes, *notes, *timing_warnings(time_s), *doubts, *unlike]
    if taken:
        warnings.append(f"the log is that of {taken}, which is now the motion.json beside it")
    if times is not None:
        inside = (log.time_s >= times[0]) & (log.time_s <= times[1])
        log.since_start_s[inside] = log.time_s[inside] - times[0]
        warnings += check_coverage(log.time_s, *times, str(path))
    if motion is None:
        warnings.append(NO_MOTION)
    timing = timing_of(time_s, nominal_hz)
    rate_hz = _rate_hz(time_s)
    if nominal_hz and rate_hz < (1.0 - RATES_DIFFER) * nominal_hz:
        warnings.append(f"the log has {rate_hz:.4g} rows per second by its times, not {nominal_hz:g}")
    folder = Path(folder)
    # run.json marks an import as complete: it must not lie beside half of another one.
    (folder / "run.json").unlink(missing_ok=True)
    if taken:
        take_motion(taken, folder)
    run = Run(
        complete=True,
        status="imported",
        reason=None,
        joints_sha256=write_joint_log(folder / "joints.csv", log),
        rows=len(log.time_s),
        motion_sha256=None if motion is None else motion.content_sha256(),
        arm_sha256=None if motion is None or played is None else played.arm.sha256,
        driver=f"{IMPORTED}{source.name}",
        controller={"file": Path(path).name, "sha256": source.sha256},
        joint_names=log.joint_names,
        clock=source.clock,
        motion_start_s=None if times is None else times[0],
        motion_end_s=None if times is None else times[1],
        sync_events=[],
        timing=timing,
        video={},
        warnings=warnings,
    )
    run.write(folder / "run.json")
    return run


def _check_commands(log: JointLog, file: str) -> list[str]:
    """Compare the measured joints with their commands; return a warning.

    Joints that follow the commands of other joints are refused. Joints that move before their commands, as
    those of no arm do, are warned of.
    """
    known = np.isfinite(log.q_cmd_rad).all(axis=1)
    if known.sum() < FEWEST_COMMANDS:
        return []
    time_s, q_rad, command_rad = log.time_s[known], log.q_rad[known], log.q_cmd_rad[known]
    rms_rad = np.sqrt(((q_rad[:, :, None] - command_rad[:, None]) ** 2).mean(axis=0))
    joints, commands = scipy.optimize.linear_sum_assignment(rms_rad**2)
    if np.diag(rms_rad).max() > LARGEST_LEFT_RAD and (
        rms_rad[joints, commands].max() < CLEARLY_LESS**2 * np.diag(rms_rad).max()
    ):
        names = log.joint_names
        pairs = zip(joints, commands, strict=True)
        others = [f"{names[j]} follows the command of {names[c]}" for j, c in pairs if j != c]
        fix = "name the columns of q and q_cmd in the order of the joints, from the base on"
        raise StrandcastError("SC-I006", f"the measured {', '.join(others)}", file=file, field="q", fix=fix)
    off_rad, velocity = q_rad - command_rad, np.gradient(command_rad, time_s, axis=0)
    off_rad, velocity = off_rad - off_rad.mean(axis=0), velocity - velocity.mean(axis=0)
    lead_s = (off_rad * velocity).sum() / max((velocity**2).sum(), 1e-12)
    left_rad = off_rad - lead_s * velocity
    if lead_s < 2.0 * np.median(np.diff(time_s)) or (left_rad**2).sum() > 0.5 * (off_rad**2).sum():
        return []
    return [
        f"the measured joints move {1e3 * lead_s:.0f} ms before their commands: the columns of measured and "
        "commanded joints are probably exchanged"
    ]


def _rehearsal_of_no_motion(folder: Path, plans: Mapping[Path, Motion]) -> StrandcastError:
    motion, planned = folder / "motion.json", next(iter(plans), Path("MOTION"))
    return StrandcastError(
        "SC-V020",
        "is missing, and the log does not say which motion was played",
        file=motion,
        fix=f"copy it there before planning again: {shlex.join(['cp', str(planned), str(motion)])}",
    )


def _source(path: Path, reading: Reading, namings: Sequence[list[str]]) -> JointSource:
    """Read a bag, or a CSV by its mapping or its dialect."""
    unit: dict[str, object] = {"angle_unit": "deg"} if reading.degrees else {}
    unit |= {"rate_hz": reading.rate_hz} if reading.rate_hz else {}
    if is_bag(path):
        bag = read_bag(path, reading.topic, reading.clock, namings)
        return replace(bag, columns=bag.columns.model_copy(update=unit))
    table = read_numbers(path)
    name, columns = ("mapping", reading.mapping) if reading.mapping else recognise(table, reading.dialect)
    if "angle_unit" not in columns.model_fields_set | unit.keys() and _are_named_degrees(columns):
        table.notes.append(f"the angles are taken as degrees, as their names say ({columns.q[0]})")
        unit["angle_unit"] = "deg"
    columns = columns.model_copy(update=unit)
    clock = (
        f"the column {columns.time!r} of the log" if columns.time else f"{columns.rate_hz} rows per second"
    )
    notes = table.notes + ([UNNAMED.format(len(table.names))] if name == "ur" else [])
    return JointSource(name, table, columns, namings, sha256_file(path), clock, notes)


def _are_named_degrees(columns: JointMapping) -> bool:
    return all(map(DEGREES.search, (*columns.q, *columns.qd, *columns.q_cmd, *columns.qd_cmd)))


def _log_of(source: JointSource, sync_output: int | None) -> tuple[np.ndarray, JointLog]:
    """Return all times (rows,), and the log without doubled rows."""
    table, columns = source.table, source.columns
    time_s = _times(table, columns)
    q = table.columns(columns.q) * ANGLE_UNITS[columns.angle_unit]
    table.require_finite(np.column_stack([time_s, q]), [columns.time or "time", *columns.q])
    _refuse_unsorted(table, columns.time or "time", time_s)
    _refuse_clock(table, columns, time_s)
    _refuse_unit(table, columns, q)
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


def _times(table: NumberTable, columns: JointMapping) -> np.ndarray:
    if columns.time is not None:
        return table.times(columns.time, TIME_UNITS[columns.time_unit])
    if columns.rate_hz is None:
        what = "the log has no column of the time"
        fix = "record the controller's time (UR: timestamp), or give the rate of an even log: --rate 500"
        raise refusal("SC-I004", table.path, "time", what, fix)
    return np.arange(len(table.values)) / columns.rate_hz


def _sync_high(table: NumberTable, columns: JointMapping, output: int | None) -> np.ndarray:
    """Return (rows,) whether the output of the sync event is high."""
    if output is None:
        return np.zeros(len(table.values), bool)
    if columns.outputs is None:
        raise StrandcastError(
            "SC-I004",
            "the log has no column of digital outputs",
            file=table.path,
            field="sync-output",
            fix="record actual_digital_output_bits, or name the column in the mapping: outputs",
        )
    bits = table.column(columns.outputs)
    table.require_finite(bits[:, None], [columns.outputs])
    wrong = (bits < 0) | (bits >= 1 << OUTPUTS) | (bits % 1 != 0)
    if wrong.any():
        row = int(np.argmax(wrong))
        what = f"{bits[row]:g} is no set of digital outputs"
        raise table.refusal(row, columns.outputs, what, "give the column of the outputs", "SC-I025")
    if output >= OUTPUTS:
        what = f"there is no output {output}; they are numbered from 0 to {OUTPUTS - 1}"
        raise refusal("SC-I025", table.path, "sync-output", what, "give the output that switches the LED")
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
        fix="use the arm's own file, or name every joint of the log, from the base on: --joint NAME …",
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
        what = f"time runs back by {time_s[row - 1] - time_s[row]:.6g} s here ({len(back)} times in all)"
        fix = "sort the rows by time, or give the column of the controller's own clock"
        raise table.refusal(row, name, what, fix, "SC-I007")


def _refuse_clock(table: NumberTable, columns: JointMapping, time_s: np.ndarray) -> None:
    problem = clock_problem(time_s)
    fix = "give the unit of the time (time_unit in a mapping), and cut the log to the throw"
    if problem is None and columns.time is not None and columns.rate_hz is not None:
        rate_hz = _rate_hz(time_s)
        if rate_hz > (1.0 + RATES_DIFFER) * columns.rate_hz:
            problem = f"the times are those of {rate_hz:.4g} rows per second, the rate is {columns.rate_hz:g}"
            fix = "give the unit of the times (time_unit in a mapping), or leave --rate out"
    if problem is not None:
        raise refusal("SC-I028", table.path, columns.time or "rate_hz", problem, fix)


def _rate_hz(time_s: np.ndarray) -> float:
    steps = np.diff(time_s)
    return 1.0 / float(np.median(steps[steps > 0]))


def _refuse_unit(table: NumberTable, columns: JointMapping, q: np.ndarray) -> None:
    most_rad = float(np.abs(q).max())
    is_small = 0.0 < most_rad < TURN_AS_DEGREES_RAD and not _are_named_degrees(columns)
    if columns.angle_unit == "deg" and is_small:
        what = f"no angle is beyond {np.degrees(most_rad):.1f} degrees"
        fix = "if the log is in radians, leave out --degrees, or angle_unit: deg of the mapping"
        raise refusal("SC-I008", table.path, columns.q[0], what, fix)
    largest = np.unravel_index(np.argmax(np.abs(q)), q.shape)
    if abs(q[largest]) > LARGEST_ANGLE_RAD:
        row, joint = int(largest[0]), columns.q[largest[1]]
        fix = "if the log is in degrees, use --degrees, or angle_unit: deg in a mapping"
        raise table.refusal(row, joint, f"an angle of {q[largest]:.1f} rad", fix, "SC-I008")


def _command_span(log: JointLog) -> tuple[float, float] | None:
    """Return the first and the last change of the commanded joints; None without commands."""
    has_command = np.isfinite(log.q_cmd_rad).all(axis=1)
    if not has_command.any():
        return None
    times, command = log.time_s[has_command], log.q_cmd_rad[has_command]
    changes = np.flatnonzero(np.abs(np.diff(command, axis=0)).max(axis=1) > COMMAND_MOVES_RAD)
    if not len(changes):
        return None
    return float(times[changes[0]]), float(times[changes[-1] + 1])
