"""Handle signals that would end the process while the arm moves or its log is written."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from strandcast.errors import ENDING_SIGNALS


class _Note:
    """A handler of signals that reports them, and remembers them for a block within."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self.reasons: list[str] = []

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.reasons.append(f"interrupted by {signal.Signals(number).name}")
        self._report(self.reasons[-1])


@contextmanager
def interrupts(report: Callable[[str], None]) -> Iterator[None]:
    """Call `report` with the reason instead of ending the process; works in the main thread only.

    What a block around this one has held off before is reported at once.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Under nohup, a closed terminal is not a request to stop.
    unwanted = {signal.SIGHUP} if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else set()
    note, outer = _Note(report), signal.getsignal(signal.SIGINT)
    before = {number: signal.signal(number, note) for number in ENDING_SIGNALS if number not in unwanted}
    for reason in outer.reasons if isinstance(outer, _Note) else ():
        report(reason)
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
