"""A planned motion, checked as for playing, ready to be written in another format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.reach import reach_of
from strandcast.player.checks import CHECK_STEP_S, check_motion, check_reach, sample
from strandcast.player.rehearsal import HASH_DIGITS, read_motion, slowed
from strandcast.records.motion import Motion

APPROACH_RAD_S = 0.25  # how fast, at most, an arm is brought to the start


@dataclass(frozen=True, eq=False)
class HandOver:
    """A motion as it is to be played.

    Attributes
    ----------
    motion
        In slow motion already, where that was asked for; that is another motion, with a hash of its own.
    arm
        Checked against its limits.
    planned_sha256
        Content hash of the motion as planned.
    time_scale
        How many times slower than planned; 1 is a throw.
    """

    motion: Motion
    arm: Arm
    planned_sha256: str
    time_scale: float

    @property
    def sha256(self) -> str:
        """Content hash of the motion as it is to be played, written into every file to know its log by."""
        return self.motion.content_sha256()

    @property
    def short_hash(self) -> str:
        """Its first digits, as `strandcast play` shows them."""
        return self.sha256[:HASH_DIGITS]

    def about(self) -> list[str]:
        """Return what a reader of the file must know, line by line, in ASCII."""
        held = ", ".join(f"{name} {angle:.9g}" for name, angle in self.arm.held.items())
        start = zip(self.motion.joint_names, self.motion.points[0].positions, strict=True)
        slow = f" (slow: not a throw), of motion {self.planned_sha256}"
        return [
            f"strandcast motion: {self.motion.experiment} trial {self.motion.trial}, arm {self.arm.name}",
            f"motion_sha256: {self.sha256}",
            f"time_scale: {self.time_scale:g}{'' if self.time_scale == 1 else slow}",
            f"duration_s: {self.motion.time_s()[-1]:.9f}, from rest to rest",
            f"start_rad: {', '.join(f'{name} {angle:.9g}' for name, angle in start)}",
            f"held_rad: {held or 'none'}",
        ]


def prepare(path: Path, arm: Arm, hanging_m: float, time_scale: float = 1.0) -> HandOver:
    """Read a motion and check it as the player does before it speaks to the arm.

    Parameters
    ----------
    path
        motion.json.
    arm
        The arm that will play it.
    hanging_m
        Length of what hangs from the hand, its weights included [m].
    time_scale
        1 as planned; 4 four times slower, which the first run of a motion should be.

    Raises
    ------
    StrandcastError
        What `player.rehearsal` refuses of a motion.
    """
    planned = read_motion(path)
    check_motion(path, planned, arm)
    motion = slowed(planned, time_scale)
    check_motion(path, motion, arm)
    dense = sample(motion, CHECK_STEP_S)
    reach = reach_of(arm, dense.time_s, dense.q_rad, dense.qd_rad_s, dense.qdd_rad_s2, hanging_m)
    check_reach(path, arm, reach, hanging_m)
    return HandOver(motion, arm, planned.content_sha256(), time_scale)


def times_ns(motion: Motion) -> np.ndarray:
    """Return the points' times (T,) in whole nanoseconds."""
    return np.array([p.time_from_start.sec * 10**9 + p.time_from_start.nanosec for p in motion.points])
