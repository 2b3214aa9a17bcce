"""The common task: a string of 0.5 m in 20 segments, hanging at rest, swung by the hand for one second."""

from dataclasses import dataclass

import numpy as np

from strandcast.dynamics.parameters import Array, random_strings

LENGTH_M = 0.5
SEGMENTS = 20
GRAVITY_M_S2 = 9.81
DURATION_S = 1.0
KNOTS_S = 2e-3
MASSES = np.ones(SEGMENTS)
SHAPE_HZ = 500.0  # rate of the times at which strings are compared
REGULAR = (0.3, 3.0)  # rest lengths of a segment: beyond them the model is invalid and no step converges
_DOWN = -0.5 * np.pi


@dataclass(frozen=True)
class HandSwing:
    """A hand on a straight arm that sweeps about its shoulder from rest to rest, with minimum jerk."""

    start_rad: float  # angle of the arm at the start
    sweep_rad: float
    lasts_s: float  # duration of the sweep; the hand rests for the remainder of the second
    arm_m: float = 0.8  # shoulder to hand

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Return the pose and its rate at `time_s`: (T, 3) x, y [m], angle [rad], and (T, 3) per second.

        The hand turns with the arm and points straight down at the start, so that a straight string
        hangs at rest with any clamp.
        """
        s = np.clip(np.asarray(time_s) / self.lasts_s, 0.0, 1.0)
        turned = self.sweep_rad * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rate = self.sweep_rad / self.lasts_s * 30.0 * s**2 * (1.0 - s) ** 2
        cos, sin = np.cos(self.start_rad + turned), np.sin(self.start_rad + turned)
        pose = np.stack([self.arm_m * cos, self.arm_m * sin, _DOWN + turned], axis=-1)
        return pose, np.stack([-self.arm_m * sin * rate, self.arm_m * cos * rate, rate], axis=-1)

    def fastest_m_s(self) -> float:
        """Return the greatest speed of the hand [m/s]."""
        return 1.875 * abs(self.sweep_rad) / self.lasts_s * self.arm_m


CAST = HandSwing(-2.6, 2.6, 1.0)
"""The main task: 3.9 m/s at most, a sweep of the whole second, typical for an arm of this size."""
SNAP = HandSwing(-2.6, 2.6, 0.53)
"""7.4 m/s at most, and the string snaps at the stop."""

COMMON_S = np.arange(1, round(DURATION_S * SHAPE_HZ) + 1) / SHAPE_HZ
"""Times at which strings are compared; every time step divides their spacing."""


def stretched_m(stiffness: Array) -> Array:
    """Return the segment lengths (..., n) [m] of a string hanging at rest, from its k_s [N/m/kg]."""
    below = np.cumsum(MASSES[::-1])[::-1] * GRAVITY_M_S2
    return np.asarray(LENGTH_M / SEGMENTS + below / np.asarray(stiffness)[..., None])


def every(dt_s: float) -> int:
    """Return the number of steps of `dt_s` between two common times."""
    steps = round(1.0 / (SHAPE_HZ * dt_s))
    if abs(steps * dt_s * SHAPE_HZ - 1.0) > 1e-9:
        raise ValueError(f"{dt_s} s does not divide {1 / SHAPE_HZ} s")
    return steps


def knots(swing: HandSwing) -> tuple[Array, Array]:
    """Return hand times (T,) and poses (T, 3), as a recorded motion would give them."""
    time_s = np.linspace(0.0, DURATION_S, round(DURATION_S / KNOTS_S) + 1)
    return time_s, swing.at(time_s)[0]


def table_2(count: int, seed: int) -> Array:
    """Return log-uniform draws (count, 10) from the ranges of the paper's Table 2."""
    return random_strings(count, 0, np.random.default_rng(seed)).parameters


def plain(parameters: Array) -> Array:
    """Return the strings as the peers can model them: one bending stiffness and damping, no air drag.

    No peer has two sets of bending coefficients or air drag on mass points; the geometric means of both sets
    keep the range of the table.
    """
    common = parameters.copy()
    for first, second in ((2, 4), (3, 5)):
        common[:, first] = common[:, second] = np.sqrt(parameters[:, first] * parameters[:, second])
    common[:, 6:8] = 0.0
    return common


def stays_regular(positions: Array) -> Array:
    """Return which candidates (B,) of positions (B, F, n+1, 2) keep all segments within `REGULAR`."""
    length = np.linalg.norm(np.diff(positions, axis=2), axis=3) * (SEGMENTS / LENGTH_M)
    inside = (length > REGULAR[0]) & (length < REGULAR[1])
    return np.asarray(inside.all(axis=(1, 2)))


def rms_mm(tip: Array, truth: Array) -> Array:
    """Return the distance of tips (B, F, 2) from the truth, rms over the second [mm]; infinite if lost."""
    error = 1e3 * np.sqrt(((tip - truth) ** 2).sum(-1).mean(-1))
    return np.where(np.isfinite(error), error, np.inf)
