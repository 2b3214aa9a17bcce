"""Signals that would end the process while the arm moves, or while its log is written."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

# Ctrl-C, the system's wish to end, and a terminal that is closed or a connection to it that breaks.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def interrupts(ask: Callable[[str], None]) -> Iterator[None]:
    """Tell `ask` of such a signal instead of ending, where Python lets us (in the main thread)."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def note(number: int, frame: FrameType | None) -> None:
        ask(f"interrupted by {signal.Signals(number).name}")

    # Under nohup a closed terminal is nobody's wish to stop.
    unwanted = {signal.SIGHUP} if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else set()
    before = {number: signal.signal(number, note) for number in ENDING if number not in unwanted}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def held_off() -> Iterator[None]:
    """Let such signals pass unheard for a moment: what goes on is short, and must come to its end."""
    with interrupts(lambda reason: None):
        yield
