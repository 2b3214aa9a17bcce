"""Operations of one step, counted by running the kernels' own source on numbers that count.

An addition, subtraction, multiplication, division or square root is one operation, an inverse root two, by
whatever estimates and refinements they are made. Signs, comparisons and choices count nothing, nor does what
is the same for all candidates, which LLVM keeps out of the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from strandcast.bench.swing import LENGTH_M, MASSES, SEGMENTS
from strandcast.string import elements, explicit, implicit, lanes
from strandcast.string.model import READINGS, StringModel
from strandcast.string.parameters import RANGES

_MODULES = (lanes, elements, implicit, explicit)


class Counted:
    """A number that counts what is done with it, in `Counted.operations`."""

    operations = 0
    __slots__ = ("value",)

    def __init__(self, value: float) -> None:
        self.value = float(value)

    @classmethod
    def result(cls, value: float, operations: int = 1) -> Counted:
        """Return a value that took that many operations."""
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
    """Return the number that a counting or an ordinary one is."""
    return number.value if isinstance(number, Counted) else float(number)


def _store(kind: Any, array: Any, row: int, value: Any) -> None:
    array[row, 0] = value


# What has no Python that could count: numba's intrinsics, and what only stands for them, by name.
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
def interpreted(modules: tuple[ModuleType, ...] = _MODULES) -> Iterator[None]:
    """Let the kernels of `modules` be plain Python: compiled functions give way to their source."""
    before = [(module, dict(vars(module))) for module in modules]
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
    """Return a work array (rows, 1) of counting numbers."""
    return np.array([Counted(value) for value in values], dtype=object)[:, None]


def step_operations(bits: int, points: int = SEGMENTS) -> float:
    """Count the operations of one step of the default scheme, per point of one candidate."""
    n, l0 = points, LENGTH_M / points
    middle = np.sqrt(RANGES["paper"][:, 0] * RANGES["paper"][:, 1])
    k_s, c_s, k_h, c_h, k_sh, c_sh, c1, c2, k_ph, c_ph = middle
    coefficients = _column(
        [k_s, c_s, k_sh, k_h - k_sh, c_sh, c_h - c_sh, c1, c2, k_ph, c_ph, 0.0, 0.0, 0.9, 0.0]
    )
    hand = tuple(Counted(value) for value in (1.0, 0.5, 0.0, -1.0, 2.0, 0.01, 0.01, 0.02))
    segments = _column(np.column_stack([0.1 * l0 * np.sin(np.arange(n)), np.full(n, -l0)]).ravel())
    velocities = _column(np.tile([1.0, 0.5], n + 1) + 0.1 * np.sin(np.arange(2 * n + 2)))
    changes, work = _column(np.zeros(2 * n + 2)), _column(np.zeros(implicit.ROWS * (n + 1)))
    model = StringModel(LENGTH_M, points)
    with interpreted():
        Counted.operations = 0
        implicit.kick_and_drift(
            lanes.Kind(bits, 1), n, coefficients, _column(np.resize(MASSES, n)), _column(np.ones(n)), hand,
            segments, velocities, changes, work, 1e-3, 1.0, l0, model.gravity_m_s2,
            READINGS.index(model.reading), 1.0 / model.switch(), False,
        )  # fmt: skip
    return Counted.operations / n
