"""Set points that begin where the arm stands: a controller that follows them at once would jerk at a step."""

import numpy as np

EASE_S = 0.3  # chosen: the time over which the set points go from where the arm stands to the motion's start


class StartEasing:
    """The way from where an arm stands, (J,) angles, to the set points that it is given."""

    def __init__(self, stands_rad: np.ndarray, first_rad: np.ndarray, rate_hz: float) -> None:
        self._offset_rad = stands_rad - first_rad
        self._cycles, self._sent = EASE_S * rate_hz, 0

    def eased(self, q_rad: np.ndarray) -> np.ndarray:
        """Return (J,) what to send for the next set point."""
        s = min(1.0, self._sent / self._cycles)
        self._sent += 1
        eased: np.ndarray = q_rad + self._offset_rad * (1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s * s))
        return eased
