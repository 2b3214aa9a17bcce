"""The protocol of drivers: a new arm needs a class with these five methods (docs/extending/arm-driver.md)."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from strandcast.core.trajectory import JointTrajectory
from strandcast.records.joint_log import JointLog, StreamingJitter, SyncEvent


@dataclass(frozen=True, eq=False)
class ArmState:
    """The current state of an arm.

    Attributes
    ----------
    q_rad, qd_rad_s
        (J,) measured angles [rad] and speeds [rad/s] of the moving joints.
    fault
        Why the arm cannot play (emergency stop, protective stop, mode, no remote control), or None.
    q_held_rad
        Measured angle of each joint that the arm's file holds, by name.
    speed_scaling
        1.0 is full speed.
    payload_kg
        The payload set on the controller, if it can be read back.
    time_s
        The controller's own clock, if it has one.
    """

    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    fault: str | None = None
    q_held_rad: dict[str, float] = field(default_factory=dict)
    speed_scaling: float = 1.0
    payload_kg: float | None = None
    time_s: float | None = None


@dataclass(frozen=True)
class Recording:
    """The result of a throw, from a driver.

    Attributes
    ----------
    log
        From before the motion until at least 0.5 s after its end.
    status, reason
        "ok", "aborted" (by our soft stop) or "fault" (the controller stopped it); the reason if not "ok".
    motion_start_s, motion_end_s
        Times of the first and the last commanded sample on the controller's clock [s].
    clock
        The clock of the log's times.
    controller
        Facts about the controller, for run.json.
    sync_events
        Events that the camera can see too.
    video
        Name of the video file, if the driver records one.
    jitter
        How late the host was, if it had to keep time.
    """

    log: JointLog
    status: str
    reason: str | None
    motion_start_s: float
    motion_end_s: float
    clock: str
    controller: dict[str, str] = field(default_factory=dict)
    sync_events: list[SyncEvent] = field(default_factory=list)
    video: dict[str, str | float | int | None] = field(default_factory=dict)
    jitter: StreamingJitter | None = None


class Driver(Protocol):
    """An arm that can play a motion.

    Where a controller has limits of its own, a method `check` of the command refuses what is beyond them,
    before anything is sent.

    Attributes
    ----------
    name
        As written into run.json.
    rate_hz
        Rate of commands and log rows.
    streams
        Whether the host must send set points in time; if so, its timing is tested before the throw.
    address
        Identifies the arm, so that no two runs move it at once; None for a virtual arm.
    """

    name: str
    rate_hz: float
    streams: bool
    address: str | None

    def connect(self) -> None:
        """Open the connection; raise StrandcastError if the arm does not answer."""

    def state(self) -> ArmState:
        """Return the current state of the arm."""

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Move slowly to (J,) angles, straight in joint space, the held joints to theirs; return at rest."""

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        """Play and log the motion, sampled at `rate_hz`; return when the arm is at rest, also after a stop.

        A camera that the driver controls records into `folder`. Drivers that do not stream receive Ctrl-C as
        KeyboardInterrupt; they must then bring the arm to rest.
        """

    def stop(self) -> None:
        """Bring the arm to rest and close the connection; safe to call at any time."""
