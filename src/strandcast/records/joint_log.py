"""joints.csv and run.json: what the arm was told and what it did, on the controller's clock."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import sha256_file, write_text
from strandcast.records.manifest import Gap
from strandcast.records.record import Part, Record

# Bits of `flags`.
LATE = 1
EXTRAPOLATED = 2
CLAMPED = 4
SYNC_HIGH = 8
AFTER_DUPLICATE = 16


@dataclass
class JointLog:
    """A joint log as arrays: time_s (T,) on the controller's clock; q_rad, q_cmd_rad… (T, J), NaN if unknown.

    `since_start_s` is the trajectory time that was commanded, NaN outside the swing.
    """

    joint_names: list[str]
    time_s: np.ndarray
    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    q_cmd_rad: np.ndarray
    qd_cmd_rad_s: np.ndarray
    since_start_s: np.ndarray
    flags: np.ndarray
    host_time_ns: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


class Timing(Part):
    """How evenly the log was taken."""

    nominal_rate_hz: float | None
    rate_hz: float
    gaps: list[Gap]
    duplicates: int
    unsorted: int = 0
    uneven: int = 0  # steps more than a tenth off the usual one, gaps and duplicates included


class Lateness(Part):
    """How late the host was with its set points, where it had to keep time."""

    cycles: int
    p50_ms: float
    p99_ms: float
    max_ms: float
    missed: int  # set points never sent
    scheduling: str  # what of real-time scheduling the system granted
    degraded: bool  # later than a lab would like: p99 beyond 0.25 ms, or more than one in a thousand missed


class Following(Part):
    """How the joints followed their command during the motion, joint by joint."""

    lag_s: list[float]  # that explains the most
    peak_error_rad: list[float]  # what it leaves, a constant offset aside


class SyncEvent(Part):
    """An event that the camera can see too, on the controller's clock."""

    kind: str  # "led_on" and "led_off" for an LED, or a name of one's own
    time_s: float
    sigma_s: float = 0.0  # standard deviation of that, where the controller knows it no better


class Run(Record):
    """run.json, written last: its presence says that the log beside it is complete."""

    SCHEMA: ClassVar[str] = "strandcast/run"

    complete: bool
    status: str  # "ok", "aborted", "refused", "fault" or "imported"
    reason: str | None
    joints_sha256: str
    rows: int
    motion_sha256: str | None
    arm_sha256: str | None
    driver: str
    controller: dict[str, str]
    joint_names: list[str]
    clock: str
    motion_start_s: float | None  # controller time of the first commanded sample
    motion_end_s: float | None
    sync_events: list[SyncEvent]
    timing: Timing
    video: dict[str, str | float | int | None]  # name of the video file, if the rig knows it
    warnings: list[str] = []
    time_scale: float = 1.0  # 4: played four times slower than planned
    lateness: Lateness | None = None
    following: Following | None = None


GROUPS = (
    ("q_cmd_rad", "q_cmd", "rad"),
    ("qd_cmd_rad_s", "qd_cmd", "rad_s"),
    ("q_rad", "q", "rad"),
    ("qd_rad_s", "qd", "rad_s"),
)


def column_names(joint_names: list[str]) -> list[str]:
    """Return the header of joints.csv."""
    joints = [f"{stem}_{name}_{unit}" for _, stem, unit in GROUPS for name in joint_names]
    return ["seq", "host_time_ns", "controller_time_s", "since_start_s", *joints, "flags"]


def write_joint_log(path: str | Path, log: JointLog) -> str:
    """Write joints.csv atomically and return its SHA-256. Unknown values are empty cells."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(column_names(log.joint_names))
    host = [str(int(t)) for t in log.host_time_ns] or [""] * len(log.time_s)
    blocks = [getattr(log, name) for name, _, _ in GROUPS]
    for k, time_s in enumerate(log.time_s):
        joints = [_cell(value) for block in blocks for value in block[k]]
        row = [k, host[k], _cell(time_s), _cell(log.since_start_s[k])]
        writer.writerow([*row, *joints, int(log.flags[k])])
    write_text(path, out.getvalue())
    return sha256_file(path)


def _cell(value: float) -> str:
    return "" if np.isnan(value) else repr(float(value))


def read_joint_log(path: str | Path) -> JointLog:
    """Read joints.csv as strandcast writes it.

    Raises
    ------
    StrandcastError
        The file is missing, cut, or has a cell that is not a number (line and column are named).
    """
    path = Path(path)
    try:
        lines = path.read_bytes().decode("utf-8").splitlines()
    except FileNotFoundError:
        raise _refusal(path, None, None, "the joint log is not there", "play or import the trial") from None
    except UnicodeDecodeError as error:
        raise _refusal(path, None, None, f"is not text (byte {error.start})", "copy it again") from None
    rows = list(csv.reader(lines))
    if len(rows) < 2:
        raise _refusal(path, None, None, "the joint log has no rows", "play or import the trial again")
    header = rows[0]
    names = [
        c.removeprefix("q_").removesuffix("_rad")
        for c in header
        if c.startswith("q_") and c.endswith("_rad") and not c.startswith("q_cmd_")
    ]
    if not names or header != column_names(names):
        raise _refusal(
            path,
            1,
            None,
            "is not the header of a strandcast joint log",
            "bring the file in with `strandcast import joints`",
        )
    table = np.empty((len(rows) - 1, len(header)))
    for k, row in enumerate(rows[1:]):
        if len(row) != len(header):
            raise _refusal(
                path, k + 2, None, f"{len(row)} cells, the header has {len(header)}", "copy it again"
            )
        table[k] = [_number(path, k + 2, header[c], cell) for c, cell in enumerate(row)]
    count = len(names)
    blocks = {name: table[:, 4 + i * count : 4 + (i + 1) * count] for i, (name, _, _) in enumerate(GROUPS)}
    if not np.isfinite(blocks["q_rad"]).all() or not np.isfinite(table[:, 2]).all():
        whole = np.isfinite(blocks["q_rad"]).all(axis=1) & np.isfinite(table[:, 2])
        raise _refusal(
            path,
            int(np.argmin(whole)) + 2,
            None,
            "a time or a joint position is missing",
            "import the log again",
        )
    return JointLog(
        joint_names=names,
        time_s=table[:, 2],
        since_start_s=table[:, 3],
        flags=table[:, -1].astype(np.int32),
        host_time_ns=np.array(
            [_whole(path, k + 2, row[1]) for k, row in enumerate(rows[1:])], dtype=np.int64
        ),
        **blocks,
    )


def _number(path: Path, line: int, column: str, cell: str) -> float:
    try:
        value = float(cell) if cell else float("nan")
    except ValueError:
        raise _refusal(
            path, line, column, f"{cell!r} is not a number", "copy or import the log again"
        ) from None
    if cell and not np.isfinite(value):
        raise _refusal(path, line, column, f"{cell!r} is not a finite number", "copy or import the log again")
    return value


def _whole(path: Path, line: int, cell: str) -> int:
    """Return a time in nanoseconds exactly: a float would round it after 104 days of uptime."""
    try:
        return int(cell or 0)
    except ValueError:
        fix = "copy or import the log again"
        raise _refusal(path, line, "host_time_ns", f"{cell!r} is not a whole number", fix) from None


def read_run(folder: str | Path) -> tuple[Run, JointLog]:
    """Read run.json and joints.csv of a trial, holding one against the other."""
    folder = Path(folder)
    run = Run.read(folder / "run.json")
    if not run.complete:
        raise _refusal(
            folder / "run.json",
            None,
            "complete",
            f"the run is not complete ({run.reason})",
            "throw again, or exclude the trial with a reason",
        )
    if run.time_scale != 1.0:
        raise _refusal(
            folder / "run.json",
            None,
            "time_scale",
            f"the motion was played {run.time_scale:g} times slower than planned: that is no throw",
            "play it at its own speed, or exclude the trial with a reason",
        )
    log = read_joint_log(folder / "joints.csv")
    if sha256_file(folder / "joints.csv") != run.joints_sha256 or len(log.time_s) != run.rows:
        raise _refusal(
            folder / "joints.csv",
            None,
            None,
            "is not the log that run.json speaks of",
            "copy both files again from the machine that played the motion",
        )
    return run, log


def timing_of(time_s: np.ndarray, nominal_rate_hz: float | None = None) -> Timing:
    """Return rate, gaps (steps beyond 1.5 of the usual) and duplicates (steps of zero) of sorted times."""
    steps = np.diff(time_s)
    if not (steps > 0).any():
        raise StrandcastError(
            "SC-J002", "the joint log has fewer than two instants", fix="record the whole throw"
        )
    usual = 1.0 / nominal_rate_hz if nominal_rate_hz else float(np.median(steps[steps > 0]))
    late = np.nonzero(steps > 1.5 * usual)[0]
    gaps = [Gap(index=int(k), duration_s=float(steps[k]), missing=round(steps[k] / usual) - 1) for k in late]
    return Timing(
        nominal_rate_hz=nominal_rate_hz,
        rate_hz=1.0 / usual,
        gaps=gaps,
        duplicates=int((steps == 0).sum()),
        unsorted=int((steps < 0).sum()),
        uneven=int((np.abs(steps - usual) > 0.1 * usual).sum()),
    )


def _refusal(path: Path, line: int | None, column: str | None, what: str, fix: str) -> StrandcastError:
    return StrandcastError("SC-J001", what, file=path, line=line, field=column, fix=fix, exit_code=INTEGRITY)
