"""Joint paths of many motions side by side, and how close each comes to the arm's limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numba import njit

from strandcast.arm.dynamics import NO_DYNAMICS, Dynamics, PlanarDynamics, chain_torques
from strandcast.arm.load import Arm
from strandcast.arm.reach import ROUGHLY_EVERY_S
from strandcast.arm.whole_arm import whole_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.planning.bezier import Curve, sample
from strandcast.threads import over_ranges

# Between the samples a controller goes a little further. Chosen.
WITHIN = 0.995
# From rest into a curve that begins with an acceleration, the quintic through the first two points overshoots
# it by this factor, at 0.355 of the step.
ONSET = 1.374
# Between the points where the whole arm is checked, its values may be this much higher (power; measured).
BETWEEN = 1.04


@dataclass(frozen=True, eq=False)
class Curves:
    """P motions of J joints without a ramp: q0_rad (P, J), duration_s (P,), heights_rad_s (P, J, H)."""

    q0_rad: np.ndarray
    duration_s: np.ndarray
    heights_rad_s: np.ndarray

    def __len__(self) -> int:
        return len(self.q0_rad)

    def __getitem__(self, p: int) -> Curve:
        return Curve(self.q0_rad[p], float(self.duration_s[p]), self.heights_rad_s[p])

    def take(self, members: Sequence[int] | np.ndarray) -> Curves:
        """Return some of the motions."""
        at = np.asarray(members, int)
        return Curves(self.q0_rad[at], self.duration_s[at], self.heights_rad_s[at])


def packed(curves: Sequence[Curve]) -> Curves:
    """Return motions without ramps, side by side."""
    return Curves(
        np.array([curve.q0_rad for curve in curves]),
        np.array([curve.duration_s for curve in curves]),
        np.array([curve.heights_rad_s for curve in curves]),
    )


@dataclass(frozen=True, eq=False)
class JointPaths:
    """The joint paths of P motions, and their extremes.

    Attributes
    ----------
    q
        (P, T, J) commanded angles, held after the end [rad].
    last
        (P,) last sample of each motion.
    low, high, speed, acceleration, jerk, torque
        (P, J) least and greatest angle, greatest magnitudes of the rates, and of the torque or 0; the
        acceleration is also that of a controller between the first two points.
    effort_rad_s
        (P,) rms speed.
    step_s
        Time between the samples [s].
    """

    q: np.ndarray
    last: np.ndarray
    low: np.ndarray
    high: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    torque: np.ndarray
    effort_rad_s: np.ndarray
    step_s: float

    def excess(self, arm: Arm) -> np.ndarray:
        """Return (P,) by how much motions break the limits: summed over joints and kinds; 1 = the limit."""
        return np.asarray(sum(np.maximum(part, 0.0).sum(axis=1) for part in self.excesses(arm)))

    def excesses(self, arm: Arm) -> list[np.ndarray]:
        """Return by how much motions exceed every kind of limit; 1 = the limit.

        (P, J) each of the joints', and (P, 8) of the arm as a whole if anything of it is limited.
        """
        limits = arm.limits
        span = limits.upper_rad - limits.lower_rad
        room = np.where(np.isfinite(span), span, np.pi)
        of_arm = [self.whole_arm_shares(arm) - WITHIN] if limits.whole_arm_limited.any() else []
        return [
            (self.high - limits.upper_rad) / room,
            (limits.lower_rad - self.low) / room,
            self.speed / limits.velocity_rad_s - WITHIN,
            self.acceleration / limits.acceleration_rad_s2 - WITHIN,
            self.jerk / limits.jerk_rad_s3 - WITHIN,
            self.torque / limits.torque_n_m - WITHIN,
            *of_arm,
        ]

    def whole_arm_shares(self, arm: Arm) -> np.ndarray:
        """Return (P, 8) the greatest values of `WHOLE_ARM`, relative to their limits."""
        every = max(1, round(ROUGHLY_EVERY_S / self.step_s))
        q = self.q[:, ::every]
        values = whole_arm(arm, q, every * self.step_s * np.arange(q.shape[1]), arm.limits.whole_arm_limited)
        return np.asarray(BETWEEN * values.max(axis=1) / arm.limits.whole_arm)


def paths_of(
    curves: Curves,
    step_s: float,
    after_s: float = 0.0,
    dynamics: Dynamics = NO_DYNAMICS,
) -> JointPaths:
    """Sample motions every `step_s` until `after_s` after the longest one's end; they last whole steps."""
    steps = np.rint(curves.duration_s / step_s).astype(np.int64)
    count = int(steps.max()) + 1 + round(after_s / step_s)
    degree = curves.heights_rad_s.shape[2] - 1
    powers = np.ascontiguousarray(curves.heights_rad_s @ _to_powers(degree).T)
    motions, joints = powers.shape[:2]
    q, facts, effort = np.empty((motions, count, joints)), np.zeros((motions, 6, joints)), np.zeros(motions)
    planar = dynamics if isinstance(dynamics, PlanarDynamics) else NO_DYNAMICS  # the kernel knows no others
    given = curves.q0_rad, powers, steps, step_s, planar.links, planar.gravity_m_s2
    over_ranges(motions, lambda first, last: _sample(first, last, *given, q, facts, effort))
    if planar is not dynamics:
        facts[:, 5] = [_greatest_torque(sample(curves[p], step_s), dynamics) for p in range(motions)]
    low, high, speed, acceleration, jerk, torque = np.moveaxis(facts, 1, 0)
    return JointPaths(q, steps, low, high, speed, acceleration, jerk, torque, effort, step_s)


def paths_of_any(
    curves: Sequence[Curve],
    step_s: float,
    after_s: float = 0.0,
    dynamics: Dynamics = NO_DYNAMICS,
) -> JointPaths:
    """Sample motions that may have a stop ramp; see `paths_of`."""
    if not any(curve.ramp_s for curve in curves):
        return paths_of(packed(curves), step_s, after_s, dynamics)
    motions = [sample(curve, step_s) for curve in curves]
    last = np.array([len(motion.time_s) - 1 for motion in motions])
    after = int(last.max()) + round(after_s / step_s) - last
    q = np.array(
        [np.pad(m.q_rad, [(0, more), (0, 0)], mode="edge") for m, more in zip(motions, after, strict=True)]
    )
    low, high, speed, acceleration, jerk, torque = (
        np.array([extreme(m) for m in motions])
        for extreme in (
            lambda m: m.q_rad.min(axis=0),
            lambda m: m.q_rad.max(axis=0),
            lambda m: np.abs(m.qd_rad_s).max(axis=0),
            lambda m: np.abs(m.qdd_rad_s2).max(axis=0),
            lambda m: np.abs(np.diff(m.qdd_rad_s2, axis=0)).max(axis=0) / step_s,
            lambda m: _greatest_torque(m, dynamics),
        )
    )
    acceleration = np.maximum(acceleration, [ONSET * _onset_rad_s2(curve) for curve in curves])
    effort = np.array([np.sqrt(np.mean(m.qd_rad_s**2)) for m in motions])
    return JointPaths(q, last, low, high, speed, acceleration, jerk, torque, effort, step_s)


def _onset_rad_s2(curve: Curve) -> np.ndarray:
    """Return the acceleration (J,) with which the curve leaves rest."""
    heights = curve.heights_rad_s
    return np.asarray(np.abs(heights[:, 1] - heights[:, 0]) * (heights.shape[1] - 1) / curve.duration_s)


def _greatest_torque(motion: JointTrajectory, dynamics: Dynamics) -> np.ndarray:
    rows = slice(None, None, dynamics.stride)
    found = dynamics.torques(motion.q_rad[rows], motion.qd_rad_s[rows], motion.qdd_rad_s2[rows])
    return np.asarray(dynamics.between * np.abs(found).max(axis=0))


def _to_powers(degree: int) -> np.ndarray:
    """(degree+1, degree+1) from Bernstein heights to the coefficients of powers of s."""
    matrix = np.zeros((degree + 1, degree + 1))
    for k in range(degree + 1):
        for j in range(k, degree + 1):
            matrix[j, k] = comb(degree, k) * comb(degree - k, j - k) * (-1.0) ** (j - k)
    return matrix


@njit(cache=True, nogil=True)
def _sample(
    first: int,
    end: int,
    q0: np.ndarray,
    powers: np.ndarray,
    steps: np.ndarray,
    step_s: float,
    links: np.ndarray,
    gravity: np.ndarray,
    q: np.ndarray,
    facts: np.ndarray,
    effort: np.ndarray,
) -> None:
    """Fill angles (P, count, J), least, greatest, peaks of rates and torque (P, 6, J), rms speed (P,)."""
    _, joints, terms = powers.shape
    count = q.shape[1]
    for p in range(first, end):
        last = steps[p]
        duration_s = last * step_s
        qd, qdd = np.empty((last + 1, joints)), np.empty((last + 1, joints))
        for j in range(joints):
            facts[p, 0, j] = facts[p, 1, j] = q0[p, j]
            before = 0.0
            for t in range(last + 1):
                s = t / last
                place, speed, slope = 0.0, 0.0, 0.0
                for k in range(terms - 1, -1, -1):
                    c = powers[p, j, k]
                    place = place * s + c / (k + 1)
                    speed = speed * s + c
                    if k:
                        slope = slope * s + k * c
                q[p, t, j] = q0[p, j] + duration_s * s * place
                bent = 0.0 if t in (0, last) else slope / duration_s
                qd[t, j], qdd[t, j] = speed, bent
                facts[p, 0, j] = min(facts[p, 0, j], q[p, t, j])
                facts[p, 1, j] = max(facts[p, 1, j], q[p, t, j])
                facts[p, 2, j] = max(facts[p, 2, j], abs(speed))
                facts[p, 3, j] = max(facts[p, 3, j], abs(bent))
                if t:
                    facts[p, 4, j] = max(facts[p, 4, j], abs(bent - before) / step_s)
                before = bent
                effort[p] += speed * speed
            for t in range(last + 1, count):
                q[p, t, j] = q[p, last, j]
        effort[p] = np.sqrt(effort[p] / ((last + 1) * joints))
        if len(links):
            torque = chain_torques(q[p, : last + 1], qd, qdd, links, gravity)
            for j in range(joints):
                facts[p, 5, j] = _peak(torque, j)


@njit(cache=True)
def _peak(rates: np.ndarray, j: int) -> float:
    """Greatest magnitude in column j."""
    peak = 0.0
    for t in range(len(rates)):
        peak = max(peak, abs(rates[t, j]))
    return peak
