"""CPU and wall time of repeated runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
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
        """Return the values per unit of `amount`."""
        return Spread(self.value / amount, self.least / amount, self.greatest / amount)

    def rate(self) -> Spread:
        """Return the inverses."""
        return Spread(1.0 / self.value, 1.0 / self.greatest, 1.0 / self.least)


def spread(values: Iterable[float]) -> Spread:
    """Return median, least and greatest of measurements."""
    known = [float(value) for value in values]
    return Spread(median(known), min(known), max(known))


@dataclass(frozen=True)
class Timing:
    """CPU time of the process, all its threads together, and wall time of the same runs [s]."""

    cpu: Spread
    wall: Spread

    def per(self, amount: float) -> Timing:
        """Return the times per unit of `amount`."""
        return Timing(self.cpu.per(amount), self.wall.per(amount))


def timed(work: Callable[[], Any], repeats: int) -> Timing:
    """Time `work`, after one uncounted run that compiles and fills the caches.

    Every run must return a result, so that it cannot be optimised away, and compute it again.
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
