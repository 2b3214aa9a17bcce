"""The host's clock, and protection of the streaming process against interruptions."""

import ctypes
import gc
import os
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

PRIORITY = 80  # chosen
MCL_CURRENT = 1
POLL_S = 5e-5  # of what a controller reports; chosen


class Clock(Protocol):
    """A clock for the streaming loop; tests pass one that does not sleep."""

    def now_ns(self) -> int:
        """Return the time [ns], which never goes backwards."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns`, or at once if it has passed."""

    def undisturbed(self) -> AbstractContextManager[str]:
        """Return a context with as few interruptions as the system allows; it yields what was granted."""


class HostClock:
    """CLOCK_MONOTONIC.

    It sleeps and never spins: without real-time scheduling, the scheduler interrupts a spinning process for
    tens of milliseconds.
    """

    def __init__(self, realtime: bool = True) -> None:
        self._realtime = realtime

    def now_ns(self) -> int:
        """Return CLOCK_MONOTONIC [ns]."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until an absolute deadline (Python uses clock_nanosleep)."""
        wait_ns = deadline_ns - time.monotonic_ns()
        if wait_ns > 0:
            time.sleep(wait_ns * 1e-9)

    @contextmanager
    def undisturbed(self) -> Iterator[str]:
        """Disable garbage collection; for real time, lock memory and use SCHED_FIFO as far as allowed."""
        was_enabled = gc.isenabled()
        gc.collect()
        gc.disable()
        granted, before = [], None
        try:
            if self._realtime and _lock_memory():
                granted.append("memory locked")
            before = _take_fifo() if self._realtime else None
            if before is not None:
                granted.insert(0, f"SCHED_FIFO {PRIORITY}")
            normal = "normal (real-time scheduling not allowed)" if self._realtime else "normal"
            yield ", ".join(granted) or normal
        finally:
            if before is not None:
                os.sched_setscheduler(0, before[0], os.sched_param(before[1]))
            if "memory locked" in granted:
                ctypes.CDLL(None).munlockall()
            if was_enabled:
                gc.enable()


def _lock_memory() -> bool:
    # Only present memory: otherwise a limit on locked memory could fail a later allocation.
    try:
        return bool(ctypes.CDLL(None).mlockall(MCL_CURRENT) == 0)
    except (OSError, AttributeError):
        return False


def _take_fifo() -> tuple[int, int] | None:
    """Return the policy and priority to restore, or None if the system does not grant SCHED_FIFO."""
    if not hasattr(os, "sched_setscheduler"):
        return None
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return None
    return before


def wait_until(condition: Callable[[], bool], timeout_s: float) -> bool:
    """Wait until a condition holds; return False if it does not within `timeout_s`."""
    until = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(POLL_S)
    return True
