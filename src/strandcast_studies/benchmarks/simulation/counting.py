"""Operations of one step, counted by running the kernels' own source on counting numbers.

An addition, subtraction, multiplication, division or square root is one operation, an inverse root is two,
however they are computed. Signs, comparisons and selections do not count, and neither do values shared by all
candidates, which LLVM moves out of the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from strandcast.dynamics import banded, elements, simd, step
from strandcast.dynamics.model import READINGS, StringModel
from strandcast.dynamics.parameters import RANGES
from strandcast.dynamics.string_state import ROWS, StepSettings, StringArrays, StringMotion
from strandcast.dynamics.vectors import VectorSpec
from strandcast_studies.benchmarks.simulation.swing import LENGTH_M, MASSES, SEGMENTS


class Counted:
    """A number that counts its operations in `Counted.operations`."""

    operations = 0
    __slots__ = ("value",)

    def __init__(self, value: float) -> None:
        self.value = float(value)

    @classmethod
    def result(cls, value: float, operations: int = 1) -> Counted:
        """Return the result of a number of operations."""
        cls.operations += operations
        return cls(value)

    def __add__(self, other: Any) -> Counted:
        return self.result(self.value + plain(other))

    def __sub__(self, other: Any) -> Counted:
        return self.result(self.value - plain(other))

    def __rsub__(self, other: Any) -> Counted:
        return self.result(plain(other) - self.value)

    def __mul__(self, other: Any) -> Counted:
        return self.result(self.value * plain(other))

    def __truediv__(self, other: Any) -> Counted:
        return self.result(self.value / plain(other))

    def __rtruediv__(self, other: Any) -> Counted:
        return self.result(plain(other) / self.value)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Counted:
        return Counted(-self.value)

    def __lt__(self, other: Any) -> bool:
        return self.value < plain(other)

    def __gt__(self, other: Any) -> bool:
        return self.value > plain(other)


def plain(number: Any) -> float:
    """Return a counting or an ordinary number as a float."""
    return number.value if isinstance(number, Counted) else float(number)


def _store(kind: Any, array: Any, row: int, value: Any) -> None:
    array[row, 0] = value


# Python replacements, by name, for numba's intrinsics, which have no Python source.
_STAND_INS: dict[str, Callable[..., Any]] = {
    "load": lambda kind, array, row: array[row, 0],
    "store": _store,
    "splat": lambda kind, number: Counted(plain(number)),
    "select": lambda mask, a, b: a if mask else b,
    "all_of": lambda mask: mask,
    "root": lambda a: Counted.result(math.sqrt(plain(a))),
    "inverse_root": lambda kind, a: Counted.result(1.0 / math.sqrt(plain(a)), 2),
    "inverse": lambda kind, a: Counted.result(1.0 / plain(a)),
    "is_double": lambda kind: kind.bits == 64,
}


@contextmanager
def interpreted() -> Iterator[None]:
    """Replace the kernels' compiled functions by their Python source within the context."""
    before = [(module, dict(vars(module))) for module in (simd, elements, banded, step)]
    try:
        for module, names in before:
            for name, value in names.items():
                if name in _STAND_INS:
                    setattr(module, name, _STAND_INS[name])
                elif isinstance(value, Dispatcher):
                    setattr(module, name, value.py_func)
        yield
    finally:
        for module, names in before:
            vars(module).update(names)


def _column(values: Any) -> Any:
    """Return an array (rows, 1) of counting numbers."""
    return np.array([Counted(value) for value in values], dtype=object)[:, None]


def step_operations(bits: int, points: int = SEGMENTS) -> float:
    """Count the operations of one step, per point of one candidate."""
    n, l0 = points, LENGTH_M / points
    middle = np.sqrt(RANGES["paper"][:, 0] * RANGES["paper"][:, 1])
    k_s, c_s, k_h, c_h, k_sh, c_sh, c1, c2, k_ph, c_ph = middle
    coefficients = _column(
        [k_s, c_s, k_sh, k_h - k_sh, c_sh, c_h - c_sh, c1, c2, k_ph, c_ph, 0.0, 0.0, 0.9, 0.0, 0.0]
    )
    hand = tuple(Counted(value) for value in (1.0, 0.5, 0.0, -1.0, 2.0, 0.01, 0.01, 0.02))
    segments = _column(np.column_stack([0.1 * l0 * np.sin(np.arange(n)), np.full(n, -l0)]).ravel())
    velocities = _column(np.tile([1.0, 0.5], n + 1) + 0.1 * np.sin(np.arange(2 * n + 2)))
    changes, work = _column(np.zeros(2 * n + 2)), _column(np.zeros(ROWS * (n + 1)))
    model = StringModel(LENGTH_M, points)
    with interpreted():
        Counted.operations = 0
        string = StringArrays(n, coefficients, _column(np.resize(MASSES, n)), _column(np.ones(n)))
        motion = StringMotion(segments, velocities, changes)
        reading, per_width = READINGS.index(model.reading), 1.0 / model.switch()
        settings = StepSettings(1e-3, 1.0, l0, model.gravity_m_s2, reading, per_width, False, None)
        step.advance(VectorSpec(bits, 1), string, motion, hand, work, settings)
    return Counted.operations / n
