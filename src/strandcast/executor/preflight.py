"""The checks before connecting to the arm: a dry run, and the first half of a live run."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.arm.limits import peaks
from strandcast.arm.load import Arm
from strandcast.arm.reach import Reach
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import REFUSED, StrandcastError
from strandcast.executor.checks import check_motion, check_reach, check_set_points
from strandcast.executor.drivers.protocol import Driver
from strandcast.executor.locks import NOTHING_SENT, check_clock, check_folder
from strandcast.executor.streaming.clock import Clock
from strandcast.executor.streaming.jitter import check_timing
from strandcast.records.joint_log import StreamingJitter
from strandcast.records.motion import Motion, points_of

HASH_DIGITS = 8


@dataclass(frozen=True, eq=False)
class PlayOptions:
    """The options of a run.

    Attributes
    ----------
    time_scale
        4: the same path, four times slower.
    hanging_m
        Length of string hanging from the hand, with its weights [m].
    move_to_start
        Move slowly to the start first; otherwise an arm elsewhere is refused.
    settle_s
        Wait at the start before the throw, until the string hangs still again [s].
    soft_realtime
        Stream even if the host's timing is poor.
    """

    time_scale: float = 1.0
    hanging_m: float = 0.0
    move_to_start: bool = False
    settle_s: float = 0.0
    soft_realtime: bool = False


@dataclass(frozen=True, eq=False)
class Preflight:
    """A motion that has passed every check that needs no arm; of the host's timing, what was measured.

    Attributes
    ----------
    motion
        As it will be played: slowed by the time scale.
    command
        Its set points at the driver's rate: what was checked is what is sent.
    peaks
        (J,) each: peak speed, acceleration, jerk and torque; (8,) of the whole arm.
    reach
        The region that the arm and the string sweep.
    jitter
        The host's timing; None for a driver that does not stream.
    refused_live
        Why a live run is refused at this moment, though the motion is right; None: it is not.
    """

    motion_path: Path
    out_dir: Path
    arm: Arm
    options: PlayOptions
    motion: Motion
    command: JointTrajectory
    peaks: dict[str, np.ndarray]
    reach: Reach
    jitter: StreamingJitter | None
    refused_live: StrandcastError | None

    @property
    def short_hash(self) -> str:
        """The hash to type before this motion, at this time scale, is played live."""
        return self.motion.content_sha256()[:HASH_DIGITS]


class Elsewhere(NamedTuple):
    """In place of the driver, for an arm that another computer moves: what is asked before a throw."""

    rate_hz: float
    streams: bool = False


def run_preflight(
    motion_path: str | Path,
    arm: Arm,
    driver: Driver | Elsewhere,
    out_dir: str | Path,
    options: PlayOptions | None = None,
    clock: Clock | None = None,
) -> Preflight:
    """Check a motion without connecting to the arm; refuse it (exit code 2) with the reason and the fix.

    A host too late to stream is no reason against the motion: `play` refuses it, a dry run reports it.

    Parameters
    ----------
    motion_path
        The planned motion; its content hash is verified.
    arm
        The arm, from its own file: its limits count, not those stored in the motion.
    driver
        Not connected.
    out_dir
        The trial's raw folder; an existing run is never overwritten.
    """
    motion_path, out_dir, options = Path(motion_path), Path(out_dir), options or PlayOptions()
    check_folder(out_dir)
    motion = slowed(read_motion(motion_path), options.time_scale)
    check_clock(motion_path)
    dense = check_motion(motion_path, motion, arm)
    command = check_set_points(motion_path, motion, arm, driver.rate_hz)
    getattr(driver, "check", lambda command: None)(command)  # limits that only this driver knows
    reach = check_reach(motion_path, arm, dense, options.hanging_m)
    jitter, late = _timing(driver, options, clock) if driver.streams else (None, None)
    most = peaks(arm, dense)
    return Preflight(motion_path, out_dir, arm, options, motion, command, most, reach, jitter, late)


def read_motion(path: str | Path) -> Motion:
    """Read a motion to be played; an invalid file is a refusal (exit code 2)."""
    try:
        return Motion.read(path)
    except StrandcastError as error:
        error.cost, error.exit_code = NOTHING_SENT, REFUSED
        raise


def slowed(motion: Motion, scale: float) -> Motion:
    """Return the same path, `scale` times slower: a motion with its own hash and no prediction."""
    if scale == 1.0:
        return motion
    if not 1.0 < scale <= 100.0:
        raise StrandcastError(
            "SC-W020",
            f"a time scale of {scale} is not slower",
            cost=NOTHING_SENT,
            fix="give 4, then 2, then 1",
        )
    played = motion.trajectory()
    points = points_of(
        np.round(times_ns(motion) * scale).astype(np.int64),
        played.q_rad,
        played.qd_rad_s / scale,
        played.qdd_rad_s2 / scale**2,
    )
    return motion.model_copy(update={"points": points, "bezier": None, "predicted": None})


def times_ns(motion: Motion) -> np.ndarray:
    """Return the points' times (T,) in whole nanoseconds."""
    return np.array([p.time_from_start.sec * 10**9 + p.time_from_start.nanosec for p in motion.points])


def _timing(
    driver: Driver | Elsewhere, options: PlayOptions, clock: Clock | None
) -> tuple[StreamingJitter, StrandcastError | None]:
    """Return the host's timing, and why it is not good enough to stream to an arm, or None."""
    jitter, problem = check_timing(driver.rate_hz, clock)
    if problem is None or options.soft_realtime:
        return jitter, None
    return jitter, StrandcastError(
        "SC-X018",
        f"the host cannot stream set points at {driver.rate_hz:.0f} Hz: {problem} ({jitter.scheduling})",
        cost=NOTHING_SENT,
    )
