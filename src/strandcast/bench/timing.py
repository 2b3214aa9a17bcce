"""CPU and wall time of a piece of work, several times over."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any


@dataclass(frozen=True)
class Spread:
    """Median, least and greatest of several measurements."""

    value: float
    least: float
    greatest: float

    def per(self, amount: float) -> Spread:
        """Return the same per unit of `amount`."""
        return Spread(self.value / amount, self.least / amount, self.greatest / amount)

    def rate(self) -> Spread:
        """Their inverses."""
        return Spread(1.0 / self.value, 1.0 / self.greatest, 1.0 / self.least)


def spread(values: list[float]) -> Spread:
    """Summarise measurements."""
    return Spread(float(median(values)), min(values), max(values))


@dataclass(frozen=True)
class Timing:
    """CPU time of the process, all its threads together, and wall time of the same runs [s]."""

    cpu: Spread
    wall: Spread

    def per(self, amount: float) -> Timing:
        """Return the same per unit of `amount`."""
        return Timing(self.cpu.per(amount), self.wall.per(amount))


def timed(work: Callable[[], Any], repeats: int) -> Timing:
    """Time `work`, after one run that is not counted: it compiles and fills the caches.

    Every run hands its result over, so none can be left out, and makes it anew, so none can be remembered.
    """
    work()
    cpu, wall = [], []
    for _ in range(repeats):
        cpu_0, wall_0 = time.process_time(), time.perf_counter()
        result = work()
        wall.append(time.perf_counter() - wall_0)
        cpu.append(time.process_time() - cpu_0)
        assert result is not None
    return Timing(spread(cpu), spread(wall))
