"""The commanded joints by elapsed time: the motion between two holds, or the soft stop."""

import math

import numpy as np

from strandcast.arm.stop import SoftStop
from strandcast.core.trajectory import JointTrajectory


class SetPoints:
    """The newest set point: (J,) angles `q`, speeds `qd` and accelerations `qdd`, updated in place.

    Parameters
    ----------
    motion
        From rest to rest; before it the arm is held for `lead_s`, after it until the end.
    stop
        Brings the joints to rest once `begin_stop` was called.
    """

    def __init__(self, motion: JointTrajectory, lead_s: float, stop: SoftStop) -> None:
        self._motion, self._lead_s, self._stop = motion, lead_s, stop
        self._stop_began_s: float | None = None
        self.q, self.qd, self.qdd = self._motion_at(0.0)

    @property
    def stopping(self) -> bool:
        """Whether the soft stop has begun."""
        return self._stop_began_s is not None

    def advance(self, elapsed_s: float) -> None:
        """Update the set point to that of an elapsed time."""
        if self._stop_began_s is None:
            self.q[:], self.qd[:], self.qdd[:] = self._motion_at(elapsed_s - self._lead_s)
        else:
            self.q[:], self.qd[:], self.qdd[:] = self._stop.at(elapsed_s - self._stop_began_s)

    def _motion_at(self, time_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        point = self._motion.at(np.array([time_s]))
        return point.q_rad[0], point.qd_rad_s[0], point.qdd_rad_s2[0]

    def begin_stop(self, elapsed_s: float) -> float:
        """Begin the soft stop from the present set point; return its duration [s]."""
        self._stop_began_s = elapsed_s
        return self._stop.begin(self.q, self.qd, self.qdd)

    def rest(self) -> None:
        """Take the arm to stand at the newest set point."""
        self.qd[:], self.qdd[:] = 0.0, 0.0

    def since_start_s(self, elapsed_s: float) -> float:
        """Return the time since the motion's start [s], NaN outside the motion."""
        since_s = elapsed_s - self._lead_s
        return max(0.0, since_s) if -1e-9 <= since_s <= self._motion.end_s + 1e-9 else math.nan

    def moving(self, elapsed_s: float) -> bool:
        """Return whether the motion is being played."""
        return 0.0 <= elapsed_s - self._lead_s < self._motion.end_s and not self.stopping
