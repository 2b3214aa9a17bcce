"""The process that sends to a UR controller; every command to the arm goes through here.

It is a process of its own because ur_rtde reconnects by itself when a connection breaks and sends the old
command again, or hangs in a call for a minute. Once the watchdog is armed, this process can open no new
connection, and it ends with the streaming, so nothing is ever resumed. The player keeps log and time; this
process passes on its messages, newest first, and ends when the player does.

Each message in (`MESSAGE`: what, six numbers) gets one answer (`ANSWER`: what, whether it succeeded; text).
"""

import contextlib
import os
import resource
import signal
import socket
import struct
import sys
import threading
import time
from pathlib import Path
from typing import Any

MESSAGE = struct.Struct("<c6d")
ANSWER = struct.Struct("<c?")
READY, WATCHDOG, SERVO, OUTPUT, STOP = b"r", b"w", b"j", b"o", b"s"

PRIORITY = 80  # as the streaming loop
POLL_S, GRACE_S = 0.2, 2.0  # chosen
MAX_MESSAGE_BYTES = 256


def main(handle: int, host: str, look_ahead_s: float, gain: float, rate_hz: float) -> None:
    """Serve the player at the socket `handle` until it asks for the stop, or has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with, args=(os.getppid(),), daemon=True).start()
    link = socket.socket(fileno=handle)
    arm = None
    try:
        arm = _Arm(host, look_ahead_s, gain, rate_hz)
        link.send(ANSWER.pack(READY, True))
        while True:
            what, numbers = newest(link)
            link.send(ANSWER.pack(what, arm.do(what, numbers)))
            if what == STOP:
                return
    except Exception as problem:
        with contextlib.suppress(OSError):
            link.send(ANSWER.pack(STOP, False) + str(problem).encode()[: MAX_MESSAGE_BYTES - ANSWER.size])
    finally:
        if arm is not None:
            arm.stop()


def newest(link: socket.socket) -> tuple[bytes, tuple[float, ...]]:
    """Return the next message; skip a set point if a newer one has arrived.

    Raises
    ------
    ConnectionError
        The player has ended.
    """
    what, *numbers = _unpacked(link.recv(MAX_MESSAGE_BYTES))
    while what == SERVO:
        try:
            if link.recv(MAX_MESSAGE_BYTES, socket.MSG_PEEK | socket.MSG_DONTWAIT)[:1] != SERVO:
                break
            what, *numbers = _unpacked(link.recv(MAX_MESSAGE_BYTES))
        except BlockingIOError:
            break
    return what, tuple(numbers)


def _unpacked(message: bytes) -> tuple[Any, ...]:
    if not message:
        raise ConnectionError("the player has ended")
    return MESSAGE.unpack(message)


class _Arm:
    """ur_rtde's control of the arm: set points, one digital output, the stop."""

    def __init__(self, host: str, look_ahead_s: float, gain: float, rate_hz: float) -> None:
        import rtde_control

        self._host, self._period_s, self._look_ahead_s, self._gain = host, 1.0 / rate_hz, look_ahead_s, gain
        self._outputs: Any = None
        self._stopped = False
        self._control = rtde_control.RTDEControlInterface(host, rate_hz)

    def do(self, what: bytes, numbers: tuple[float, ...]) -> bool:
        if what == SERVO:
            servo = self._control.servoJ
            return bool(servo(list(numbers), 0.0, 0.0, self._period_s, self._look_ahead_s, self._gain))
        if what == WATCHDOG:
            return self._arm_watchdog(numbers[0])
        if what == OUTPUT:
            return self._switch(int(numbers[0]), bool(numbers[1]))
        return self.stop(numbers[0])

    def _arm_watchdog(self, min_rate_hz: float) -> bool:
        if not self._control.setWatchdog(min_rate_hz):
            raise ConnectionError("the controller did not accept the watchdog")
        for thread in thread_ids():  # not earlier: ur_rtde spins until its program runs
            make_realtime(thread)
        # No new file or socket from now on: an attempt of ur_rtde to reconnect fails.
        resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0))
        return True

    def _switch(self, output: int, high: bool) -> bool:
        if self._outputs is None:
            import rtde_io

            self._outputs = rtde_io.RTDEIOInterface(self._host)
        return bool(self._outputs.setStandardDigitalOut(output, high))

    def stop(self, deceleration_rad_s2: float = 10.0) -> bool:
        """Leave servo mode, braking if the arm still moves, and end the program on the controller."""
        if self._stopped:
            return True
        self._stopped = True
        well = bool(self._control.servoStop(deceleration_rad_s2))
        self._control.stopScript()
        return well


def thread_ids() -> set[int]:
    """Return the system's ids of this process's threads; empty if it does not report them."""
    tasks = Path("/proc/self/task")
    return {int(task.name) for task in tasks.iterdir()} if tasks.is_dir() else set()


def make_realtime(thread: int) -> None:
    """Schedule a thread in real time, if the system allows it."""
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(PRIORITY))


def end_with(player: int) -> None:
    """End this process shortly after the player's, even if a call of ur_rtde hangs."""
    while os.getppid() == player:
        time.sleep(POLL_S)
    time.sleep(GRACE_S)
    os._exit(1)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], *map(float, sys.argv[3:]))
    os._exit(0)  # ur_rtde's threads may hang in a broken connection
