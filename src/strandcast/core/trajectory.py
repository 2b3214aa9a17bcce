"""Joint trajectories: the angles, speeds and accelerations of an arm's moving joints over time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """Samples of T instants and J joints; the trajectory between them is a quintic.

    Controllers interpolate the same way (ROS' joint_trajectory_controller, UR's client library). Before its
    first sample and after its last the trajectory stands still.
    """

    time_s: np.ndarray  # (T,) rising; the others (T, J)
    q_rad: np.ndarray
    qd_rad_s: np.ndarray
    qdd_rad_s2: np.ndarray

    @property
    def end_s(self) -> float:
        """Time of the last sample [s]."""
        return float(self.time_s[-1])

    def at(self, time_s: np.ndarray) -> JointTrajectory:
        """Return the trajectory at times (K,), in any order [s]."""
        time_s = np.asarray(time_s, float)
        knots, step = self.time_s, self._step_s
        k = np.clip(np.searchsorted(knots, time_s, side="right") - 1, 0, len(step) - 1)
        h = step[k][:, None]
        s = np.clip((time_s - knots[k])[:, None] / h, 0.0, 1.0)
        c0, c1, c2, c3, c4, c5 = self._coefficients[:, k]
        q = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
        qd = (c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h
        qdd = (2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (h * h)
        outside = ((time_s < knots[0]) | (time_s > knots[-1]))[:, None]
        return JointTrajectory(time_s, q, np.where(outside, 0.0, qd), np.where(outside, 0.0, qdd))

    def resampled(self, step_s: float) -> JointTrajectory:
        """Return the trajectory every `step_s` from time 0, and at its end."""
        count = max(1, round(self.end_s / step_s))
        time_s = np.minimum(np.arange(count + 1) * step_s, self.end_s)
        if time_s[-1] < self.end_s - 1e-9:
            time_s = np.append(time_s, self.end_s)
        return self.at(time_s)

    def finer(self) -> JointTrajectory:
        """Return the trajectory at its samples and at three instants between each two."""
        between = self.time_s[:-1, None] + self._step_s[:, None] * np.arange(4) / 4
        return self.at(np.append(between, self.end_s))

    @cached_property
    def _step_s(self) -> np.ndarray:
        return np.diff(self.time_s)

    @cached_property
    def _coefficients(self) -> np.ndarray:
        """Return (6, T-1, J) coefficients in s = 0…1 along each step, from the constant up."""
        q, qd, qdd = self.q_rad, self.qd_rad_s, self.qdd_rad_s2
        h = self._step_s[:, None]
        speed, curvature = qd[:-1] * h, 0.5 * qdd[:-1] * h * h
        # Contributions of the last three terms at the end of the step: value, slope, half the curvature.
        value = q[1:] - q[:-1] - speed - curvature
        slope = qd[1:] * h - speed - 2.0 * curvature
        bend = 0.5 * qdd[1:] * h * h - curvature
        cubic = 10.0 * value - 4.0 * slope + bend
        quartic = -15.0 * value + 7.0 * slope - 2.0 * bend
        quintic = 6.0 * value - 3.0 * slope + bend
        return np.stack([q[:-1], speed, curvature, cubic, quartic, quintic])
