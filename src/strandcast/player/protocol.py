"""What a driver must be able to do. A new arm needs one class with these five methods."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from strandcast.records.joint_log import JointLog, Lateness, SyncEvent


@dataclass(frozen=True, eq=False)
class State:
    """How the arm stands now.

    Attributes
    ----------
    q_rad, qd_rad_s
        (J,) measured angles [rad] and speeds [rad/s] of the moving joints.
    trouble
        Why it cannot play (emergency stop, protective stop, mode, remote control off), or None.
    q_held_rad
        Measured angle of each joint that the arm's file holds, by name.
    speed_scaling
        1.0 is full speed.
    payload_kg
        What the controller believes that the flange carries, where it can be read back.
    time_s
        The controller's own clock, where it has one.
    """

    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    trouble: str | None = None
    q_held_rad: dict[str, float] = field(default_factory=dict)
    speed_scaling: float = 1.0
    payload_kg: float | None = None
    time_s: float | None = None


@dataclass(frozen=True, eq=False)
class Command:
    """The whole motion at the driver's rate: time_s (T,) from its start; angles and so on (T, J)."""

    time_s: np.ndarray
    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    qdd_rad_s2: np.ndarray


@dataclass(frozen=True)
class Recording:
    """What a driver brings back from a throw.

    Attributes
    ----------
    log
        From before the motion until at least 0.5 s after its end.
    status
        "ok", "aborted" (by our soft stop) or "fault" (the controller stopped it); the reason if not "ok".
    motion_start_s, motion_end_s
        Of the first and the last commanded sample, on the controller's clock [s].
    clock
        Which clock the log's times are of.
    video
        Name of the video file, if the driver knows it.
    lateness
        How late the host was, where it had to keep time.
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
    lateness: Lateness | None = None


class Driver(Protocol):
    """An arm that can play a motion.

    Attributes
    ----------
    name
        As written into run.json.
    rate_hz
        At which it takes commands and logs.
    streams
        Whether the host must feed it set points in time, so that the host's timing is tried before.
    address
        What names the one arm that it moves, so that no two runs move it at once; None for a virtual one.
    """

    name: str
    rate_hz: float
    streams: bool
    address: str | None

    def connect(self) -> None:
        """Open the connection; StrandcastError if the arm does not answer."""

    def state(self) -> State:
        """Return how the arm stands now."""

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Move slowly, straight in joint space, to (J,) angles, the held joints to theirs; return at rest."""

    def play(self, command: Command, folder: Path) -> Recording:
        """Play the motion and log it, and return when the arm rests; stopped before its time too.

        A camera that the driver controls records into `folder`. Drivers that do not stream get Ctrl-C as
        KeyboardInterrupt: they must bring the arm to rest then.
        """

    def stop(self) -> None:
        """Come to rest and close the connection; safe to call at any time."""
