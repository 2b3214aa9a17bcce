"""The host's clock, and how the process that keeps time is left undisturbed."""

from __future__ import annotations

import ctypes
import gc
import os
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

PRIORITY = 80
MCL_CURRENT = 1


class Clock(Protocol):
    """What the streaming loop needs of a clock; the tests bring one that does not sleep."""

    def now_ns(self) -> int:
        """Return the time [ns]; never backwards."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns`, or at once when it is past."""

    def undisturbed(self) -> AbstractContextManager[str]:
        """Return a context in which the caller is interrupted as little as the system allows."""


class HostClock:
    """CLOCK_MONOTONIC.

    It sleeps, and never spins: without real-time scheduling the scheduler punishes spinning with gaps of
    tens of milliseconds.
    """

    def __init__(self, realtime: bool = True) -> None:
        self._realtime = realtime

    def now_ns(self) -> int:
        """Return CLOCK_MONOTONIC [ns]."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep; Python waits by clock_nanosleep up to an absolute deadline."""
        wait_ns = deadline_ns - time.monotonic_ns()
        if wait_ns > 0:
            time.sleep(wait_ns * 1e-9)

    def undisturbed(self) -> AbstractContextManager[str]:
        """Collect no garbage; lock the memory and take SCHED_FIFO where allowed. Yields what was granted."""
        return undisturbed(self._realtime)


@contextmanager
def undisturbed(realtime: bool) -> Iterator[str]:
    """Hold garbage collection off, and with `realtime` lock memory and take SCHED_FIFO, as far as allowed."""
    collecting = gc.isenabled()
    gc.collect()
    gc.disable()
    granted, before = [], None
    try:
        if realtime and _lock_memory():
            granted.append("memory locked")
        before = _take_fifo() if realtime else None
        if before is not None:
            granted.insert(0, f"SCHED_FIFO {PRIORITY}")
        yield ", ".join(granted) or ("normal (real-time scheduling not allowed)" if realtime else "normal")
    finally:
        if before is not None:
            os.sched_setscheduler(0, before[0], os.sched_param(before[1]))
        if "memory locked" in granted:
            ctypes.CDLL(None).munlockall()
        if collecting:
            gc.enable()


def _lock_memory() -> bool:
    # What is there now, not what comes: a limit on locked memory must not fail a later allocation.
    try:
        return ctypes.CDLL(None).mlockall(MCL_CURRENT) == 0
    except (OSError, AttributeError):
        return False


def _take_fifo() -> tuple[int, int] | None:
    """Return the policy and priority to go back to, or None if the system does not grant SCHED_FIFO."""
    if not hasattr(os, "sched_setscheduler"):
        return None
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return None
    return before
