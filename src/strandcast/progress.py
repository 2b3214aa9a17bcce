"""Long work says what it is doing: a line with n/N on standard error, at most every few seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")
INTERVAL_S = 3.0
_context = ""


def set_context(context: str) -> None:
    """Say whose work the lines of this process are about, e.g. an experiment and a trial."""
    global _context
    _context = f"{context} "


def tell(words: str) -> None:
    """Print a line on standard error in one piece, so that two jobs do not write into each other's."""
    sys.stderr.write(words + "\n")
    sys.stderr.flush()


class Progress:
    """Tell how far a stage has come: ``Progress("track", total=900)(300, "1 frame unsure")``."""

    def __init__(self, what: str, total: int | None = None, interval_s: float = INTERVAL_S) -> None:
        self.what = what
        self.total = total
        self.interval_s = interval_s
        self._last_s = time.monotonic()

    def __call__(self, done: int, note: str = "") -> None:
        """Print ``what: done/total note`` if the last line is old enough, or the work is complete."""
        now = time.monotonic()
        if now - self._last_s < self.interval_s and done != self.total:
            return
        self._last_s = now
        of = f"/{self.total}" if self.total is not None else ""
        after = f"  {note}" if note else ""
        tell(f"{_context}{self.what}: {done}{of}{after}")


def progress(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """Yield the items, telling how many are done."""
    tell = Progress(what, total)
    for done, item in enumerate(items, start=1):
        yield item
        tell(done)
