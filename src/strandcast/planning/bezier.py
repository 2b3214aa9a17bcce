"""Velocity curves of the joints: Bezier curves over the motion's time, given by their control heights.

The paper builds the heights by V_k = V_{k-1} + alpha_k dt (eq. 1) and leaves the end free. An arm must stop:

* ``rest``: the first two and the last two heights are zero: speed and acceleration are zero at both ends;
* ``paper``: V_0 = 0 and the rest is free; a ramp after the curve takes the arm to rest.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from math import comb

import numpy as np
from numba import njit

from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import StrandcastError

LONGEST_RAMP_S = 1.0  # chosen


@dataclass(frozen=True, eq=False)
class Curve:
    """A motion of J joints.

    Attributes
    ----------
    q0_rad
        (J,) posture at the start.
    duration_s
        Time T of the Bezier curve.
    heights_rad_s
        (J, N+1) control heights V_0…V_N of each joint's velocity.
    ramp_s
        Time of the stop ramp after the curve, 0 without.
    """

    q0_rad: np.ndarray
    duration_s: float
    heights_rad_s: np.ndarray
    ramp_s: float = 0.0

    @property
    def end_s(self) -> float:
        """When the arm is at rest again, from the motion's start [s]."""
        return self.duration_s + self.ramp_s


def rest_heights(free: np.ndarray) -> np.ndarray:
    """Return control heights (..., F+4) that start and end at rest from the free ones (..., F) [rad/s]."""
    return np.pad(free, [(0, 0)] * (np.ndim(free) - 1) + [(2, 2)])


def paper_heights(accelerations: np.ndarray, duration_s: float) -> np.ndarray:
    """Return heights (J, N+1) by eq. 1: V_0 = 0, V_k = V_{k-1} + alpha_k T/N, from alpha (J, N) [rad/s²]."""
    step_s = duration_s / accelerations.shape[-1]
    rises = np.cumsum(accelerations * step_s, axis=-1)
    return np.concatenate([np.zeros((*rises.shape[:-1], 1)), rises], axis=-1)


def sample(curve: Curve, step_s: float) -> JointTrajectory:
    """Return the motion every `step_s`; curve and ramp last a whole number of steps."""
    steps = round(curve.duration_s / step_s)
    place, speed, acceleration = _bases(curve.heights_rad_s.shape[1] - 1, steps)
    heights = curve.heights_rad_s.T
    q = curve.q0_rad + curve.duration_s * (place @ heights)
    qd = speed @ heights
    qdd = acceleration @ heights / curve.duration_s
    # The arm rests until the first sample.
    qdd[0] = 0.0
    if curve.ramp_s > 0.0:
        ramp = _ramp(q[-1], qd[-1], qdd[-1], curve.ramp_s, round(curve.ramp_s / step_s))
        q, qd, qdd = (np.concatenate([a, b]) for a, b in zip((q, qd, qdd), ramp, strict=True))
    else:
        qdd[-1] = 0.0
    return JointTrajectory(np.arange(len(q)) * step_s, q, qd, qdd)


def with_stop_ramp(curve: Curve, acceleration_rad_s2: np.ndarray, step_s: float) -> Curve | None:
    """Return the curve with the shortest stop ramp within the acceleration limits (J,), None if none is."""
    heights = curve.heights_rad_s
    last_acceleration = (heights.shape[1] - 1) / curve.duration_s * (heights[:, -1] - heights[:, -2])
    steps = _least_ramp(heights[:, -1], last_acceleration, acceleration_rad_s2, step_s)
    return replace(curve, ramp_s=steps * step_s) if steps else None


def whole_steps(duration_s: float, step_s: float) -> float:
    """Return the duration rounded to whole steps."""
    return round(duration_s / step_s) * step_s


@lru_cache(maxsize=512)
def _bases(degree: int, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the (steps+1, degree+1) factors of the heights in unit-time integral, curve and derivative."""
    if steps < 4:
        raise StrandcastError("SC-P004", f"{steps} samples are too few", fix="plan a longer motion")
    s = np.linspace(0.0, 1.0, steps + 1)
    higher, same, lower = (_bernstein(d, s) for d in (degree + 1, degree, degree - 1))
    # The integral of a Bezier curve is one of the next degree, whose heights are the running sums.
    place = np.cumsum(higher[:, ::-1], axis=1)[:, ::-1][:, 1:] / (degree + 1)
    slope = np.zeros_like(same)
    slope[:, 1:] += degree * lower
    slope[:, :-1] -= degree * lower
    return place, same, slope


def _bernstein(degree: int, s: np.ndarray) -> np.ndarray:
    """Return the Bernstein polynomials of a degree at places s: (len(s), degree+1)."""
    return np.stack([comb(degree, k) * s**k * (1 - s) ** (degree - k) for k in range(degree + 1)], axis=1)


@njit(cache=True)
def _least_ramp(qd: np.ndarray, qdd: np.ndarray, most: np.ndarray, step_s: float) -> int:
    """Return the steps of the shortest ramp (see `_ramp`) that brakes by at most `most`, 0 if none does."""
    for steps in range(2, round(LONGEST_RAMP_S / step_s)):
        ramp_s, fine = steps * step_s, True
        for k in range(steps):
            s = ((steps // 2 + k) % steps + 1) / steps  # from the middle on, where it brakes most
            for j in range(len(qd)):
                braking = qd[j] / ramp_s * (6 * s**2 - 6 * s) + qdd[j] * (3 * s**2 - 4 * s + 1)
                fine = fine and abs(braking) <= most[j]
            if not fine:
                break
        if fine:
            return steps
    return 0


def _ramp(
    q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, ramp_s: float, steps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return q, qd, qdd (steps, J) after a state: the speed falls to zero along a smooth cubic."""
    s = (np.arange(1, steps + 1) / steps)[:, None]
    speed = qd * (2 * s**3 - 3 * s**2 + 1) + ramp_s * qdd * (s**3 - 2 * s**2 + s)
    acceleration = qd / ramp_s * (6 * s**2 - 6 * s) + qdd * (3 * s**2 - 4 * s + 1)
    travel = qd * ramp_s * (s**4 / 2 - s**3 + s) + ramp_s**2 * qdd * (s**4 / 4 - 2 * s**3 / 3 + s**2 / 2)
    return q + travel, speed, acceleration
