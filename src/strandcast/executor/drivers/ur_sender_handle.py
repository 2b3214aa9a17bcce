"""The player's end of the sending process (`ur_sender`): start, messages, answers, end."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
from typing import Any

from strandcast.errors import StrandcastError
from strandcast.executor.drivers.ur_sender import (
    ANSWER,
    MAX_MESSAGE_BYTES,
    MESSAGE,
    READY,
    SERVO,
    STOP,
    WATCHDOG,
)
from strandcast.executor.drivers.ur_settings import UrSettings

CONNECT_S, STOP_S = 10.0, 2.0  # chosen
MAX_UNANSWERED = 10  # set points by which the sender may be behind
FIRST_S = 0.2  # patience for the first answer: ur_rtde waits for its program, and the arm does not move yet


class UrSender:
    """The sending process, from its start, when the program is uploaded, to its end."""

    def __init__(self, settings: UrSettings) -> None:
        self._settings = settings
        self._unanswered, self._max_unanswered = 0, FIRST_S * settings.rate_hz
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> UrSender:
        """Start the process, and wait until the controller runs its program."""
        s = self._settings
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        numbers = [str(x) for x in (s.look_ahead_s, s.gain, s.rate_hz)]
        module = [sys.executable, "-m", "strandcast.executor.drivers.ur_sender"]
        command = [*module, str(theirs.fileno()), s.host, *numbers]
        with theirs:
            self._process = subprocess.Popen(
                command,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        self._link.settimeout(CONNECT_S)
        what, well, text = self._answer() or (STOP, False, f"no answer for {CONNECT_S:.0f} s")
        if what != READY or not well:
            self.__exit__()
            raise StrandcastError(
                "SC-X005",
                f"the controller does not accept external control: {text}",
                field="driver.settings.host",
                cost="the arm was not moved",
                fix="see the pendant; end other programs and clients",
            )
        self._link.setblocking(False)
        return self

    def __exit__(self, *error: object) -> None:
        """Kill the process if it still runs."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
            self._link.close()

    def _answer(self) -> tuple[bytes, bool, str] | None:
        """Return the next answer; None if there is none (yet)."""
        try:
            message = self._link.recv(MAX_MESSAGE_BYTES)
        except (BlockingIOError, TimeoutError):
            return None
        if not message:
            return STOP, False, "the sending process has ended"
        what, well = ANSWER.unpack(message[: ANSWER.size])
        return what, well, message[ANSWER.size :].decode(errors="replace")

    def send(self, what: bytes, numbers: Any) -> None:
        """Pass on one message without waiting."""
        self._link.send(MESSAGE.pack(what, *numbers))
        self._unanswered += what == SERVO

    def arm_watchdog(self) -> None:
        """Arm the controller's watchdog and wait for it: that takes longer than a set point may."""
        self.send(WATCHDOG, [self._settings.watchdog_hz, 0, 0, 0, 0, 0])
        self._link.settimeout(CONNECT_S)
        while (answer := self._answer()) is not None and answer[0] not in (WATCHDOG, STOP):
            pass
        self._link.setblocking(False)
        if answer is None or answer[0] == STOP:
            raise ConnectionError(answer[2] if answer else "the controller did not accept the watchdog")

    def accepted(self) -> bool:
        """Read the answers so far; return whether all set points among them were accepted.

        Raises
        ------
        ConnectionError
            The sender has ended, or its answers have stopped.
        """
        well = True
        while (answer := self._answer()) is not None:
            what, good, text = answer
            if what == STOP:
                raise ConnectionError(text or "the sending process has ended")
            if what == SERVO:
                self._unanswered, self._max_unanswered = 0, MAX_UNANSWERED
                well = well and good
        if self._hangs():
            raise ConnectionError(f"ur_rtde did not return from servoJ for {self._unanswered} set points")
        return well

    def _hangs(self) -> bool:
        return self._unanswered > self._max_unanswered

    def end(self) -> None:
        """Ask for the stop, wait for it briefly, end the process.

        A process that hangs in a set point is killed at once: it would send it when the connection is back.
        """
        with contextlib.suppress(OSError):
            if not self._hangs():
                self._link.settimeout(STOP_S)
                self.send(STOP, [self._settings.stop_rad_s2, 0, 0, 0, 0, 0])
                while (answer := self._answer()) is not None and answer[0] != STOP:
                    pass
        self.__exit__()
