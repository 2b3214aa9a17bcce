"""Progress of long work: lines with n/N on standard error, one every few seconds at most.

Progress is for the person who waits. Warnings and debugging messages of library code go through ``logging``,
by loggers named after their modules.
"""

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")
INTERVAL_S = 3.0  # between two lines; chosen
_context = ""


def set_context(context: str) -> None:
    """Put a context, e.g. an experiment and a trial, before all progress lines of this process."""
    global _context
    _context = f"{context} "


def print_line(text: str) -> None:
    """Print a line on standard error in one write, so that the lines of parallel jobs do not mix.

    The no-break spaces of a page's numbers become spaces: what a terminal shows is searched and copied.
    """
    sys.stderr.write(text.replace("\u00a0", " ") + "\n")
    sys.stderr.flush()


class Progress:
    """Print how far a stage has come: ``Progress("track", total=900)(300, "1 frame uncertain")``."""

    def __init__(self, what: str, total: int | None = None, interval_s: float = INTERVAL_S) -> None:
        self.what = what
        self.total = total
        self.interval_s = interval_s
        self._last_s = time.monotonic()

    def __call__(self, done: int, note: str = "") -> None:
        """Print ``what: done/total note`` if the last line is old enough or the work is complete."""
        now = time.monotonic()
        if now - self._last_s < self.interval_s and done != self.total:
            return
        self._last_s = now
        of = f"/{self.total}" if self.total is not None else ""
        after = f"  {note}" if note else ""
        print_line(f"{_context}{self.what}: {done}{of}{after}")


def progress(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """Yield the items and print how many are done."""
    report = Progress(what, total)
    for done, item in enumerate(items, start=1):
        yield item
        report(done)
