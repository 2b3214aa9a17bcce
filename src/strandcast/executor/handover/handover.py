"""A planned motion, checked as for playing, ready for export."""

from dataclasses import dataclass
from pathlib import Path

from strandcast.arm.load import Arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.executor.checks import check_motion, check_reach, check_set_points
from strandcast.executor.joint_mapping import ControllerJoints
from strandcast.executor.preflight import HASH_DIGITS, read_motion, slowed
from strandcast.records.motion import Motion


@dataclass(frozen=True, eq=False)
class Handover:
    """A motion as it is to be played.

    Attributes
    ----------
    motion
        Slowed by `time_scale`, within the arm's limits; a slowed motion is another one, with its own hash.
    time_scale
        How many times slower than planned; 1 is a throw.
    """

    path: Path  # of the planned motion
    motion: Motion
    arm: Arm
    planned_sha256: str
    time_scale: float

    @property
    def sha256(self) -> str:
        """Content hash of the motion as played; written into every file, to identify its log."""
        return self.motion.content_sha256()

    @property
    def joints(self) -> ControllerJoints:
        """All joints of the arm: the moving ones, and the others with their held angles."""
        return ControllerJoints.of(self.arm, self.arm.all_joints)

    @property
    def short_hash(self) -> str:
        """The hash's first digits, as `strandcast play` shows them."""
        return self.sha256[:HASH_DIGITS]

    def command(self, rate_hz: float) -> JointTrajectory:
        """Return the set points at a rate, within the arm's limits (SC-X004)."""
        return check_set_points(self.path, self.motion, self.arm, rate_hz)

    def about(self) -> list[str]:
        """Return the file's header lines, in ASCII."""
        held = ", ".join(f"{name} {angle:.9g}" for name, angle in self.arm.held.items())
        start = zip(self.motion.joint_names, self.motion.points[0].positions, strict=True)
        slow = f" (slow: not a throw), of motion {self.planned_sha256}"
        return [
            f"strandcast motion: {self.motion.experiment} trial {self.motion.trial}, arm {self.arm.name}",
            f"motion_sha256: {self.sha256}",
            f"time_scale: {self.time_scale:g}{'' if self.time_scale == 1 else slow}",
            f"duration_s: {self.motion.trajectory().end_s:.9f}, from rest to rest",
            f"start_rad: {', '.join(f'{name} {angle:.9g}' for name, angle in start)}",
            f"held_rad: {held or 'none'}",
        ]


def prepare(path: Path, arm: Arm, hanging_m: float, time_scale: float = 1.0) -> Handover:
    """Read a motion and check it as in a dry run (`strandcast.executor.preflight`), with the same errors.

    Parameters
    ----------
    hanging_m
        Length of string hanging from the hand, with its weights [m].
    time_scale
        1 as planned; 4: four times slower, as the first run of a motion should be.
    """
    planned = read_motion(path)
    check_motion(path, planned, arm)
    motion = slowed(planned, time_scale)
    check_reach(path, arm, check_motion(path, motion, arm), hanging_m)
    return Handover(path, motion, arm, planned.content_sha256(), time_scale)
