"""Handle signals that would end the process while the arm moves or its log is written."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from strandcast.errors import ENDING_SIGNALS


@contextmanager
def interrupts(report: Callable[[str], None]) -> Iterator[None]:
    """Call `report` with the reason instead of ending the process; works in the main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def note(number: int, frame: FrameType | None) -> None:
        report(f"interrupted by {signal.Signals(number).name}")

    # Under nohup, a closed terminal is not a request to stop.
    unwanted = {signal.SIGHUP} if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else set()
    before = {number: signal.signal(number, note) for number in ENDING_SIGNALS if number not in unwanted}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def held_off() -> Iterator[None]:
    """Ignore such signals during a short step that must be completed."""
    with interrupts(lambda reason: None):
        yield
