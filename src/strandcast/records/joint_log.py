"""joints.csv and run.json: the commanded and measured joints, on the controller's clock."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.csv_cells import Cells, read_cells
from strandcast.records.files import sha256_file, write_text
from strandcast.records.manifest import Gap
from strandcast.records.record import Part, Record, refusal

# Bits of `flags`; 2 and 4 are not used.
LATE = 1
SYNC_HIGH = 8
AFTER_DUPLICATE = 16


@dataclass
class JointLog:
    """A joint log as arrays: time_s (T,) on the controller's clock; q_rad, q_cmd_rad… (T, J), NaN if unknown.

    `since_start_s` is the commanded time along the trajectory, NaN outside the motion.
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

    def in_order(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Return strictly rising times (R,) [s] and the angles (R, J) [rad] of these joints.

        Of rows at one time the first counts. ValueError: the log has no joint of that name.
        """
        time_s, rows = np.unique(self.time_s, return_index=True)
        return time_s, self.q_rad[rows][:, [self.joint_names.index(name) for name in names]]

    def blocks(self) -> list[np.ndarray]:
        """Return commanded and measured positions and speeds, each (T, J), in the order of the file."""
        return [self.q_cmd_rad, self.qd_cmd_rad_s, self.q_rad, self.qd_rad_s]


class LogTiming(Part):
    """Regularity of the log's sampling."""

    nominal_rate_hz: float | None
    rate_hz: float
    gaps: list[Gap]
    duplicates: int
    unsorted: int = 0
    uneven: int = 0  # steps more than 10 % off the usual one, gaps and duplicates included


class StreamingJitter(Part):
    """Delay of the set points that the computer sent, for drivers that stream."""

    cycles: int
    p50_ms: float
    p99_ms: float
    max_ms: float
    missed: int  # set points that were never sent
    scheduling: str  # the real-time scheduling that the system granted
    degraded: bool  # too late for good data: p99 beyond 0.25 ms, or more than 0.1 % missed


class Following(Part):
    """Following error of each joint during the motion."""

    lag_s: list[float]  # the lag that explains most of the error
    peak_error_rad: list[float]  # the remaining peak, without a constant offset


class SyncEvent(Part):
    """An event that the camera can detect too, on the controller's clock."""

    kind: str  # "led_on" and "led_off" for an LED, or any other name
    time_s: float
    sigma_s: float = 0.0  # its standard deviation


class Run(Record):
    """run.json, written last: its presence means that the log beside it is complete."""

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
    timing: LogTiming
    video: dict[str, str | float | int | None]  # facts about the video file, if the rig knows them
    warnings: list[str] = []
    time_scale: float = 1.0  # 4: played four times slower than planned
    lateness: StreamingJitter | None = None
    following: Following | None = None


# Stem and unit of the columns of the joints, in their order.
GROUPS = (("q_cmd", "rad"), ("qd_cmd", "rad_s"), ("q", "rad"), ("qd", "rad_s"))


def column_names(joint_names: list[str]) -> list[str]:
    """Return the column names of joints.csv."""
    joints = [f"{stem}_{name}_{unit}" for stem, unit in GROUPS for name in joint_names]
    return ["seq", "host_time_ns", "controller_time_s", "since_start_s", *joints, "flags"]


def write_joint_log(path: str | Path, log: JointLog) -> str:
    """Write joints.csv atomically and return its SHA-256. Unknown values are empty cells."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(column_names(log.joint_names))
    host = [str(int(t)) for t in log.host_time_ns] or [""] * len(log.time_s)
    for k, time_s in enumerate(log.time_s):
        joints = [_cell(value) for block in log.blocks() for value in block[k]]
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
        SC-J001 the file is missing, cut off, or has a cell that is not a number (with line and column).
    """
    path = Path(path)
    _require(path)
    cells = read_cells(path, "SC-J001")
    commands = [name for name in cells.names if name.startswith("q_cmd_")]
    names = [name.removeprefix("q_cmd_").removesuffix("_rad") for name in commands]
    if not names or cells.names != column_names(names):
        what = "is not the header of a strandcast joint log"
        raise refusal("SC-J001", path, None, what, "import the file with `strandcast import joints`", 1)
    cells.require_even()
    table = np.transpose([cells.column(k, empty=frozenset({""})) for k in range(len(cells.names))])
    joints = np.split(table[:, 4:-1], len(GROUPS), axis=1)
    blocks = {f"{stem}_{unit}": block for (stem, unit), block in zip(GROUPS, joints, strict=True)}
    whole = np.isfinite(blocks["q_rad"]).all(axis=1) & np.isfinite(table[:, 2])
    if not whole.all():
        what = "a time or a joint position is missing"
        raise refusal("SC-J001", path, None, what, line=cells.lines[np.argmin(whole)])
    return JointLog(
        joint_names=names,
        time_s=table[:, 2],
        since_start_s=table[:, 3],
        flags=_flags(cells),
        # Exactly: a float would round it after 104 days of uptime.
        host_time_ns=cells.integers("host_time_ns"),
        **blocks,
    )


def _flags(cells: Cells) -> np.ndarray:
    flags = cells.integers("flags")
    wrong = (flags < 0) | (flags > np.iinfo(np.int32).max)
    if wrong.any():
        row = int(np.argmax(wrong))
        what = f"{flags[row]} is no set of bits"
        raise refusal("SC-J001", cells.path, "flags", what, line=cells.lines[row])
    return flags.astype(np.int32)


def read_run(folder: str | Path) -> tuple[Run, JointLog]:
    """Read run.json and joints.csv of a trial; a log that is not the one of run.json is not parsed."""
    record_file, log_file = Path(folder) / "run.json", Path(folder) / "joints.csv"
    run = Run.read(record_file)
    if not run.complete:
        what = f"the run is not complete ({run.reason})"
        raise refusal("SC-J003", record_file, "complete", what)
    if run.time_scale != 1.0:
        what = f"the motion was played {run.time_scale:g} times slower than planned: that is no throw"
        raise refusal("SC-J003", record_file, "time_scale", what)
    _require(log_file)
    sha256 = sha256_file(log_file)
    if sha256 != run.joints_sha256:
        what = (
            f"is not the log that run.json describes: its hash is {sha256[:12]}, not {run.joints_sha256[:12]}"
        )
        raise refusal("SC-X020", log_file, None, what)
    log = read_joint_log(log_file)
    if len(log.time_s) != run.rows:
        what = f"is not the log that run.json describes: it has {len(log.time_s)} rows, not {run.rows}"
        raise refusal("SC-X020", log_file, None, what)
    return run, log


def _require(path: Path) -> None:
    if not path.is_file():
        raise refusal("SC-J001", path, None, "the joint log is missing", "play or import the trial")


def timing_of(time_s: np.ndarray, nominal_rate_hz: float | None = None) -> LogTiming:
    """Return rate, gaps (steps above 1.5 times the usual) and duplicates (steps of zero) of sorted times."""
    steps = np.diff(time_s)
    if not (steps > 0).any():
        raise StrandcastError("SC-J001", "the joint log has fewer than two instants")
    usual = 1.0 / nominal_rate_hz if nominal_rate_hz else float(np.median(steps[steps > 0]))
    late = np.nonzero(steps > 1.5 * usual)[0]
    gaps = [Gap(index=int(k), duration_s=float(steps[k]), missing=round(steps[k] / usual) - 1) for k in late]
    return LogTiming(
        nominal_rate_hz=nominal_rate_hz,
        rate_hz=1.0 / usual,
        gaps=gaps,
        duplicates=int((steps == 0).sum()),
        unsorted=int((steps < 0).sum()),
        uneven=int((np.abs(steps - usual) > 0.1 * usual).sum()),
    )
