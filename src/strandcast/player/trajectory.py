"""The quintic through a motion's points: it has their positions, speeds and accelerations.

That is what controllers interpolate too (ROS' joint_trajectory_controller, UR's client library).
"""

from __future__ import annotations

import numpy as np


class Trajectory:
    """Joints over time; before its first point and after its last it stands still there.

    Parameters
    ----------
    time_s
        (K,) rising [s].
    q, qd, qdd
        (K, J) angles [rad], speeds [rad/s], accelerations [rad/s²].
    """

    def __init__(self, time_s: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> None:
        self._knots = np.ascontiguousarray(time_s, float)
        self._step = np.diff(time_s)
        h = self._step[:, None]
        speed, bend = qd[:-1] * h, 0.5 * qdd[:-1] * h * h
        # What the last three coefficients must add: of place, slope and half curvature at the step's end.
        place = q[1:] - q[:-1] - speed - bend
        slope = qd[1:] * h - speed - 2.0 * bend
        curve = 0.5 * qdd[1:] * h * h - bend
        cubic = 10.0 * place - 4.0 * slope + curve
        quartic = -15.0 * place + 7.0 * slope - 2.0 * curve
        quintic = 6.0 * place - 3.0 * slope + curve
        self._c = np.stack([q[:-1], speed, bend, cubic, quartic, quintic])

    @property
    def end_s(self) -> float:
        """Time of the last point [s]."""
        return float(self._knots[-1])

    def at(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angles, speeds and accelerations at times (T,): (T, J) each."""
        time_s = np.asarray(time_s, float)
        k = np.clip(np.searchsorted(self._knots, time_s, side="right") - 1, 0, len(self._step) - 1)
        h = self._step[k][:, None]
        s = np.clip((time_s - self._knots[k])[:, None] / h, 0.0, 1.0)
        c0, c1, c2, c3, c4, c5 = self._c[:, k]
        q = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
        qd = (c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h
        qdd = (2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (h * h)
        still = ((time_s < self._knots[0]) | (time_s > self._knots[-1]))[:, None]
        return q, np.where(still, 0.0, qd), np.where(still, 0.0, qdd)
