"""All that can be known of a run before the arm is spoken to: the dry run, and half of a live one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.arm.limits import peaks
from strandcast.arm.load import Arm
from strandcast.arm.reach import Reach, reach_of
from strandcast.errors import REFUSED, StrandcastError
from strandcast.player.checks import CHECK_STEP_S, check_motion, check_reach, sample
from strandcast.player.clock import Clock
from strandcast.player.lateness import preflight
from strandcast.player.protocol import Driver
from strandcast.player.surroundings import NOTHING_SENT, check_clock, check_folder
from strandcast.records.joint_log import Lateness
from strandcast.records.motion import Motion, points_of

HASH_DIGITS = 8


@dataclass(frozen=True, eq=False)
class Terms:
    """How a motion is to be played.

    Attributes
    ----------
    time_scale
        4: the same path, four times slower.
    hanging_m
        Length of what hangs from the hand, its weights included [m].
    move_to_start
        Move slowly to the start first, instead of refusing when the arm stands elsewhere.
    settle_s
        How long to wait at the start before the throw, for the string to hang still again [s].
    soft_realtime
        Stream even where the host keeps time badly.
    """

    time_scale: float = 1.0
    hanging_m: float = 0.0
    move_to_start: bool = False
    settle_s: float = 0.0
    soft_realtime: bool = False


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A motion that has passed every check that needs no arm, as it will be played.

    Attributes
    ----------
    motion_path, out_dir, arm, terms
        As given.
    motion
        Slowed down, if so wished.
    peaks
        (J,) each: the largest speed, acceleration, jerk and torque.
    reach
        What it sweeps.
    lateness
        The host's timing, for a driver that streams.
    """

    motion_path: Path
    out_dir: Path
    arm: Arm
    terms: Terms
    motion: Motion
    peaks: dict[str, np.ndarray]
    reach: Reach
    lateness: Lateness | None

    @property
    def short_hash(self) -> str:
        """What must be typed for this motion, at this time scale, to be played live."""
        return self.motion.content_sha256()[:HASH_DIGITS]


def rehearse(
    motion_path: str | Path,
    arm: Arm,
    driver: Driver,
    out_dir: str | Path,
    terms: Terms | None = None,
    clock: Clock | None = None,
) -> Rehearsal:
    """Check everything that can be checked without the arm. Nothing is sent.

    Parameters
    ----------
    motion_path
        The planned motion; its content hash is verified.
    arm
        The arm that it is for, from its own file: its limits are checked, not the motion's words.
    driver
        Not connected to; its rate is used, and whether it streams.
    out_dir
        The trial's raw folder; a run that is already there is never written over.
    terms, clock
        How to play it; the host's clock.

    Raises
    ------
    StrandcastError
        Refused (exit code 2): why, and what to do.
    """
    motion_path, out_dir, terms = Path(motion_path), Path(out_dir), terms or Terms()
    check_folder(out_dir)
    motion = slowed(read_motion(motion_path), terms.time_scale)
    check_clock(motion_path)
    check_motion(motion_path, motion, arm)
    dense = sample(motion, CHECK_STEP_S)
    moves = (dense.time_s, dense.q_rad, dense.qd_rad_s, dense.qdd_rad_s2)
    reach = reach_of(arm, *moves, terms.hanging_m)
    check_reach(motion_path, arm, reach, terms.hanging_m)
    lateness = _timing(driver, terms, clock) if driver.streams else None
    return Rehearsal(motion_path, out_dir, arm, terms, motion, peaks(arm, *moves), reach, lateness)


def read_motion(path: str | Path) -> Motion:
    """Read a motion to be played; whatever is wrong with it is a refusal."""
    try:
        return Motion.read(path)
    except StrandcastError as error:
        error.cost, error.exit_code = NOTHING_SENT, REFUSED
        raise


def slowed(motion: Motion, scale: float) -> Motion:
    """Return the same path `scale` times slower: a motion with a hash of its own and nothing predicted."""
    if scale == 1.0:
        return motion
    if not 1.0 < scale <= 100.0:
        raise StrandcastError(
            "SC-X017", f"a time scale of {scale} is not slower", cost=NOTHING_SENT,
            fix="give 4, then 2, then 1")  # fmt: skip
    time_ns = np.array([p.time_from_start.sec * 10**9 + p.time_from_start.nanosec for p in motion.points])
    q, qd, qdd = motion.joints()
    points = points_of(np.round(time_ns * scale).astype(np.int64), q, qd / scale, qdd / scale**2)
    return motion.model_copy(update={"points": points, "bezier": None, "predicted": None})


def _timing(driver: Driver, terms: Terms, clock: Clock | None) -> Lateness:
    lateness, trouble = preflight(driver.rate_hz, clock)
    if trouble and not terms.soft_realtime:
        raise StrandcastError(
            "SC-X018", f"the host cannot stream set points at {driver.rate_hz:.0f} Hz: {trouble} "
            f"({lateness.scheduling})", cost=NOTHING_SENT,
            fix="allow real-time scheduling (docs/player.md), stop what else runs, "
                "or know what you do: --accept-soft-realtime")  # fmt: skip
    return lateness
