"""The UR driver's stream: servoJ set points out, RTDE packages in."""

import contextlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from strandcast.executor.drivers.ur_sender import OUTPUT, SERVO
from strandcast.executor.drivers.ur_sender_handle import UrSender
from strandcast.executor.drivers.ur_settings import UrSettings
from strandcast.executor.drivers.ur_state import FRESH_S, fault_of, program_runs
from strandcast.executor.joint_mapping import ControllerJoints
from strandcast.executor.streaming.clock import wait_until
from strandcast.executor.streaming.easing import EASE_S, Easing
from strandcast.executor.streaming.link import ControllerState, ControllerStopped
from strandcast.records.joint_log import SYNC_HIGH, JointLog, SyncEvent

PACKAGE_S = 0.05  # chosen: several packages even at 125 Hz
SAME_PACKAGE_TRIES = 5


class UrLink:
    """A UR arm's `strandcast.executor.streaming.link.StreamLink`.

    `receive` is ur_rtde's RTDEReceiveInterface; without `joints`, all six joints move.
    """

    paces = False

    def __init__(
        self, receive: Any, sender: UrSender, joints: ControllerJoints | None, settings: UrSettings
    ) -> None:
        self._receive, self._sender, self._settings = receive, sender, settings
        self._all: Callable[[np.ndarray], np.ndarray] = joints.all_angles if joints else np.asarray
        self._moving: Callable[[np.ndarray], np.ndarray] = joints.moving if joints else np.asarray
        self._easing: Easing | None = None
        self._bit = 0 if settings.sync_output is None else 1 << settings.sync_output

    def start(self) -> None:
        """Arm the controller's watchdog: from now on it ends the program if set points stop arriving."""
        self.signal(False)  # the first call is slow: it opens a connection of its own
        self._sender.arm_watchdog()
        if not wait_until(lambda: program_runs(self._receive), FRESH_S):
            raise ControllerStopped("the program does not run on the controller")
        # Read half a cycle after the packages arrive, so that none is missed that is a little early or late.
        before = self._receive.getTimestamp()
        wait_until(lambda: self._receive.getTimestamp() != before, PACKAGE_S)
        time.sleep(0.5 / self._settings.rate_hz)

    def read(self) -> ControllerState:
        """Return the newest package's state."""
        return self._state(self._fault())

    def _fault(self) -> str | None:
        fault = fault_of(self._receive)
        if fault is None and not program_runs(self._receive):
            return "the program on the controller was stopped"
        return fault

    def _state(self, fault: str | None) -> ControllerState:
        receive = self._receive
        # ur_rtde returns one value per call; all of them must come from the same package.
        for _ in range(SAME_PACKAGE_TRIES):
            time_s = receive.getTimestamp()
            q, qd = receive.getActualQ(), receive.getActualQd()
            bits = receive.getActualDigitalOutputBits()
            scaling = receive.getSpeedScaling() * receive.getTargetSpeedFraction()
            if receive.getTimestamp() == time_s:
                break
        sync_high = bool(bits & self._bit)
        return ControllerState(time_s, self._moving(q), self._moving(qd), fault, scaling, sync_high)

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        """Pass one set point to the sender; servoJ takes no speeds.

        Raises
        ------
        ControllerStopped
            An earlier set point was refused.
        ConnectionError
            The sender is behind, or has ended: the connection is broken.
        """
        wanted = self._all(q_rad)
        if self._easing is None:
            stands_rad = np.array(self._receive.getActualQ())
            self._easing = Easing(1.0 / self._settings.rate_hz, EASE_S, stands_rad - wanted)
        self._sender.send(SERVO, wanted + self._easing.next())
        if not self._sender.accepted():
            raise ControllerStopped(self._fault() or "the controller refused a set point")

    def signal(self, high: bool) -> None:
        """Switch the sync output, if the arm's file names one."""
        if self._settings.sync_output is not None:
            self._sender.send(OUTPUT, [self._settings.sync_output, high, 0, 0, 0, 0])

    def finish(self) -> None:
        """Leave servo mode and end the program; the sender's process has ended afterwards in any case."""
        with contextlib.suppress(OSError):
            self.signal(False)
        self._sender.end()


def sync_events(log: JointLog) -> list[SyncEvent]:
    """Return when the sync output switched: between two packages, with the uncertainty of their interval."""
    high = (log.flags & SYNC_HIGH) != 0
    return [
        SyncEvent(
            kind="led_on" if high[k + 1] else "led_off",
            time_s=round(float(log.time_s[k] + log.time_s[k + 1]) / 2.0, 6),
            sigma_s=round(float(log.time_s[k + 1] - log.time_s[k]) / 12**0.5, 6),
        )
        for k in np.flatnonzero(np.diff(high))
    ]
