"""The same string in numpy, vectorised over candidates and points; semi-implicit Euler."""

import numpy as np

from strandcast.dynamics.parameters import Array
from strandcast_studies.benchmarks.simulation.swing import (
    DURATION_S,
    GRAVITY_M_S2,
    LENGTH_M,
    MASSES,
    SEGMENTS,
    HandSwing,
    every,
    stretched_m,
)

SWITCH_WIDTH = 0.02  # rad, of the reading "sign"; as in our model


def accelerations(z: Array, w: Array, hand_angle: float, hand_rate: float, p: Array, spacing: float) -> Array:
    """Return complex accelerations (B, n) of the free points from complex `z`, `w` (B, n+1); p (10, B, 1)."""
    k_s, c_s, k_h, c_h, k_sh, c_sh, c1, c2, k_ph, c_ph = p
    d, dw = np.diff(z, axis=1), np.diff(w, axis=1)
    length = np.abs(d)
    u = d / length
    across = dw / d  # real part: relative stretch rate, imaginary part: turn rate
    turn = across.imag
    pull = (k_s * (length - spacing) + c_s * across.real * length) * u
    bend = np.angle(u[:, 1:] / u[:, :-1])
    rate = np.diff(turn, axis=1)
    t = np.clip(0.5 + 0.5 * bend / SWITCH_WIDTH, 0.0, 1.0)
    share = t * t * (3.0 - 2.0 * t)
    inner = (k_sh + (k_h - k_sh) * share) * bend + (c_sh + (c_h - c_sh) * share) * rate
    clamp = np.angle(u[:, :1] * np.exp(-1j * hand_angle))
    held = k_ph * clamp + c_ph * (turn[:, :1] - hand_rate)
    moment = np.concatenate([held, inner, np.zeros_like(held)], axis=1)
    # Force on a segment's outer end: against the pull, and across by the difference of the moments.
    push = -pull + 1j * u * np.diff(moment, axis=1) / length
    force = push - (c1 + c2 * np.abs(w[:, 1:])) * w[:, 1:]
    force[:, :-1] -= push[:, 1:]
    return np.asarray(force / MASSES - 1j * GRAVITY_M_S2)


class NumpyString:
    """The peer."""

    def __init__(self, swing: HandSwing, parameters: Array, dt_s: float, threads: int = 1) -> None:
        self.steps = round(DURATION_S / dt_s)
        pose, rate = swing.at(np.linspace(0.0, DURATION_S, self.steps + 1))
        self.hand, self.hand_rate = pose[:, 0] + 1j * pose[:, 1], rate[:, 0] + 1j * rate[:, 1]
        self.angle, self.turn = pose[:, 2], rate[:, 2]
        self.p = parameters.T[:, :, None].copy()
        self.dt_s, self.each = dt_s, every(dt_s)

    def positions(self) -> Array:
        """Simulate; return positions (B, F, n+1, 2) [m] at the common times."""
        spacing = LENGTH_M / SEGMENTS
        below = np.cumsum(np.insert(stretched_m(self.p[0, :, 0]), 0, 0.0, axis=1), axis=1)
        z = self.hand[0] - 1j * below
        w = np.zeros_like(z)
        out = np.empty((z.shape[0], self.steps // self.each, SEGMENTS + 1, 2))
        with np.errstate(all="ignore"):  # a divergence shows in the result
            for k in range(self.steps):
                w[:, 0] = self.hand_rate[k]
                w[:, 1:] += self.dt_s * accelerations(z, w, self.angle[k], self.turn[k], self.p, spacing)
                z[:, 1:] += self.dt_s * w[:, 1:]
                z[:, 0] = self.hand[k + 1]
                if (k + 1) % self.each == 0:
                    frame = out[:, (k + 1) // self.each - 1]
                    frame[..., 0], frame[..., 1] = z.real, z.imag
        return out
