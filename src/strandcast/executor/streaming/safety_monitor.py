"""Monitor the arm in every cycle; a problem in two consecutive cycles stops it."""

import numpy as np

from strandcast.executor.streaming.bounds import SafetyBounds
from strandcast.executor.streaming.link import ControllerState
from strandcast.executor.streaming.log_buffer import LogBuffer

# Chosen.
GAP_TICKS = 5  # set points missed in a row
FROZEN_TICKS = 10  # cycles without a new time from the controller
CONSECUTIVE_CYCLES = 2  # with a wrong measurement
FULL_SPEED = 0.999


class SafetyMonitor:
    """Checks each state against the bounds, and whether the controller's clock advances.

    `joint_names` are for messages; `period_s` is the period of the streaming loop.
    """

    def __init__(self, bounds: SafetyBounds, joint_names: list[str], period_s: float) -> None:
        self._bounds = bounds
        self._names = joint_names
        self._reach = GAP_TICKS + FROZEN_TICKS + int(np.ceil(bounds.lag_s.max(initial=0.0) / period_s))
        self._controller_s = -np.inf
        self._frozen_ticks = 0
        self._violations = 0

    def frozen(self, state: ControllerState) -> bool:
        """Return whether the controller's clock has stopped for too long (or runs backwards)."""
        self._frozen_ticks = 0 if state.time_s > self._controller_s else self._frozen_ticks + 1
        self._controller_s = max(self._controller_s, state.time_s)
        return self._frozen_ticks > FROZEN_TICKS

    def problem(self, state: ControllerState, elapsed_s: float, buffer: LogBuffer) -> str | None:
        """Return why the arm must be stopped: a problem in this state and in the previous one; or None."""
        if state.speed_scaling < FULL_SPEED:
            return f"the controller's speed scaling fell to {100 * state.speed_scaling:.0f} %"
        found = self._violation(state, elapsed_s, buffer)
        self._violations = self._violations + 1 if found else 0
        return found if self._violations >= CONSECUTIVE_CYCLES else None

    def _violation(self, state: ControllerState, elapsed_s: float, buffer: LogBuffer) -> str | None:
        bounds = self._bounds
        if buffer.count:
            command = buffer.command_of(elapsed_s - bounds.lag_s, self._reach)
            over = np.abs(state.q_rad - command) - bounds.tracking_rad
            j = int(np.argmax(over))
            if not over[j] <= 0.0:
                allowed = bounds.tracking_rad[j]
                return (
                    f"{self._names[j]} is {over[j] + allowed:.3f} rad from its command, allowed {allowed:.3f}"
                )
        fast = np.abs(state.qd_rad_s) - bounds.velocity_rad_s
        j = int(np.argmax(fast))
        if not fast[j] <= 0.0:
            return f"{self._names[j]} moves at {state.qd_rad_s[j]:.2f} rad/s"
        if bounds.too_fast is not None and (fastest := bounds.too_fast(state.q_rad, state.qd_rad_s)):
            return fastest
        if bounds.outside is not None and bounds.outside(state.q_rad):
            return "the hand is outside the workspace"
        return None
