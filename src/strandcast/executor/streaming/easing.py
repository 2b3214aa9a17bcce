"""Set points that begin where the arm is: a controller that follows them at once would jerk at a step."""

from typing import Any

import numpy as np

EASE_S = 0.3  # chosen: the time over which the set points go from where the arm stands to the motion's start


class Easing:
    """An offset to a command that goes to zero cycle by cycle, along a quintic.

    Parameters
    ----------
    cycle_s, duration_s
        A cycle and the whole [s].
    e, ed, edd
        (J,) offset at the start [rad], its speed and its acceleration.
    """

    def __init__(
        self, cycle_s: float, duration_s: float, e: np.ndarray, ed: Any = 0.0, edd: Any = 0.0
    ) -> None:
        count = round(duration_s / cycle_s)
        s = (np.arange(count + 1) / count)[:, None]
        c0, c1, c2 = e, ed * duration_s, 0.5 * edd * duration_s**2
        c3, c4, c5 = -10 * c0 - 6 * c1 - 3 * c2, 15 * c0 + 8 * c1 + 3 * c2, -6 * c0 - 3 * c1 - c2
        self._rows = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
        self._next = 0

    def next(self) -> np.ndarray:
        """Return (J,) the offset for this cycle [rad], and advance to the next cycle."""
        row: np.ndarray = self._rows[min(self._next, len(self._rows) - 1)]
        self._next += 1
        return row

    def ended(self) -> bool:
        """Return whether the offset has reached zero."""
        return self._next >= len(self._rows)
