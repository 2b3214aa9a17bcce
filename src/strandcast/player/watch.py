"""What is looked at in every cycle, and stops the arm when it is wrong twice running."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.player.bounds import Bounds
from strandcast.player.rows import Rows

GAP_TICKS = 5
FROZEN_TICKS = 10
RUNNING = 2  # cycles for which a measurement must be wrong
FULL_SPEED = 0.999


@dataclass(slots=True)
class Reading:
    """The newest state that the controller told; a link may change one and the same in place.

    Attributes
    ----------
    time_s
        The controller's own clock [s].
    q_rad, qd_rad_s
        (J,) measured.
    trouble
        Why the controller stops or has stopped by itself (protective stop, reflex, emergency stop), or None.
    speed_scaling
        1.0 is full speed.
    sync_high
        The sync output, read back in the same packet.
    """

    time_s: float
    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    trouble: str | None = None
    speed_scaling: float = 1.0
    sync_high: bool = False


class Watch:
    """Looks at each reading; keeps in mind since when the controller's clock stands still.

    Parameters
    ----------
    bounds
        What the measured joints must keep.
    joint_names
        For the reasons.
    period_s
        Of the streaming loop.
    """

    def __init__(self, bounds: Bounds, joint_names: list[str], period_s: float) -> None:
        self._bounds = bounds
        self._names = joint_names
        self._reach = GAP_TICKS + FROZEN_TICKS + int(np.ceil(bounds.lag_s.max(initial=0.0) / period_s))
        self._controller_s = -np.inf
        self._stands = 0
        self._outside = 0

    def frozen(self, reading: Reading) -> bool:
        """Return whether the controller's clock has stood still for too long (or runs backwards)."""
        self._stands = 0 if reading.time_s > self._controller_s else self._stands + 1
        self._controller_s = max(self._controller_s, reading.time_s)
        return self._stands > FROZEN_TICKS

    def problem(self, reading: Reading, elapsed_s: float, rows: Rows) -> str | None:
        """Return why the arm must be stopped: what was wrong in this reading and in the one before."""
        if reading.speed_scaling < FULL_SPEED:
            return f"the controller's speed scaling fell to {100 * reading.speed_scaling:.0f} %"
        found = self._wrong(reading, elapsed_s, rows)
        self._outside = self._outside + 1 if found else 0
        return found if self._outside >= RUNNING else None

    def _wrong(self, reading: Reading, elapsed_s: float, rows: Rows) -> str | None:
        bounds = self._bounds
        if rows.count:
            wanted = rows.command_of(elapsed_s - bounds.lag_s, self._reach)
            over = np.abs(reading.q_rad - wanted) - bounds.tracking_rad
            j = int(np.argmax(over))
            if not over[j] <= 0.0:
                allowed = bounds.tracking_rad[j]
                return (
                    f"{self._names[j]} is {over[j] + allowed:.3f} rad off its command, allowed {allowed:.3f}"
                )
        fast = np.abs(reading.qd_rad_s) - bounds.velocity_rad_s
        j = int(np.argmax(fast))
        if not fast[j] <= 0.0:
            return f"{self._names[j]} moves at {reading.qd_rad_s[j]:.2f} rad/s"
        if bounds.outside is not None and bounds.outside(reading.q_rad):
            return "the hand is out of the workspace"
        return None
