"""The string's equations once more, in plain numpy from the energies, for an independent integrator."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

Path = Callable[[float], tuple[np.ndarray, np.ndarray]]


def smooth(value, width):
    t = np.clip(0.5 + 0.5 * value / width, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True)
class Equations:
    """What is fixed about one string, and the accelerations of its points."""

    parameters: np.ndarray
    masses: np.ndarray
    spacing_m: float
    reading: str
    switch: float
    curl_rad_m: float = 0.0
    clamp_offset_rad: float = 0.0
    factor: np.ndarray | float = 1.0
    gravity_m_s2: float = 9.81
    drag_along: float = 0.0
    friction: float = 0.0
    stick_rad: float = 0.0

    def accelerations(self, x, v, clamp, clamp_rate, held=0.0):
        """Accelerations of points 1…n (n, 2); x, v (n+1, 2) include the hand. With complex numbers.

        `held`: share of the full moment of friction at each joint.
        """
        k_s, c_s, _, _, _, _, c1, c2, k_ph, c_ph = self.parameters
        z, w = x[:, 0] + 1j * x[:, 1], v[:, 0] + 1j * v[:, 1]
        d, dw = np.diff(z), np.diff(w)
        length, u = np.abs(d), d / np.abs(d)
        log_rate = dw / d  # real part: relative stretching, imaginary part: turning
        turn = log_rate.imag
        pull = k_s * (length - self.spacing_m)
        tension = pull + c_s * log_rate.real * length
        air = (c1 + c2 * np.abs(w)) * w
        if self.drag_along:
            tangent = np.r_[1.0, d[:-1] + d[1:], d[-1]]
            tangent /= np.abs(tangent)
            air -= (1.0 - self.drag_along) * (air * tangent.conj()).real * tangent
        total = -air - 1j * self.gravity_m_s2 * np.r_[0, self.masses]
        total[1:] -= tension * u
        total[:-1] += tension * u
        at_clamp = k_ph * wrap(np.angle(d[0]) - clamp - self.clamp_offset_rad)
        at_clamp += c_ph * (turn[0] - clamp_rate)
        bend = wrap(np.diff(np.angle(d))) - self.curl_rad_m * self.spacing_m
        at_joints = np.r_[at_clamp, self.moments(bend, np.diff(turn), pull)] + self.friction * held
        at_joints = at_joints * self.factor
        # The difference of the moments over the length, turned by +90 degrees.
        shear = np.diff(np.r_[at_joints, 0.0]) / length * 1j * u
        total[1:] += shear
        total[:-1] -= shear
        return (total[1:] / self.masses).view(float).reshape(-1, 2)

    def build_up(self, x, v, clamp_rate, held):
        """Rate of the shares `held` (n,), which follow the bend over `stick_rad` until friction is full."""
        d, dw = np.diff(x, axis=0), np.diff(v, axis=0)
        turn = (d[:, 0] * dw[:, 1] - d[:, 1] * dw[:, 0]) / (d**2).sum(1)
        rate = np.diff(np.r_[clamp_rate, turn])
        return (rate - np.abs(rate) * held) / self.stick_rad

    def moments(self, bend, rate, pull):
        """Moments at joints 1…n-1 before their factors (n-1,)."""
        _, _, k_h, c_h, k_sh, c_sh, *_ = self.parameters
        if self.reading == "rate":
            share = smooth(bend * rate, self.switch)
        elif self.reading == "sign":
            share = smooth(bend, self.switch)
        else:
            weight = self.masses[:-1] * self.gravity_m_s2
            share = smooth(-(pull[1:] + pull[:-1]) / 2 / weight, self.switch)
        return (k_sh + (k_h - k_sh) * share) * bend + (c_sh + (c_h - c_sh) * share) * rate


def integrate(equations: Equations, path: Path, start, times, start_velocity=None):
    """DOP853 along `path(t) -> (x, y, angle), (vx, vy, rate)`: points 1…n at `times` (F, n, 2) [m]."""
    n = len(equations.masses)

    def derivative(t, state):
        pose, speed = path(t)
        place, moving, held = np.split(state, [2 * n, 4 * n])
        x = np.vstack([pose[:2], place.reshape(n, 2)])
        v = np.vstack([speed[:2], moving.reshape(n, 2)])
        if not equations.stick_rad:
            return np.r_[moving, equations.accelerations(x, v, pose[2], speed[2]).ravel()]
        a = equations.accelerations(x, v, pose[2], speed[2], held)
        return np.r_[moving, a.ravel(), equations.build_up(x, v, speed[2], held)]

    velocity = np.zeros((n, 2)) if start_velocity is None else start_velocity
    first = np.r_[start.ravel(), velocity.ravel(), np.zeros(n if equations.stick_rad else 0)]
    result = solve_ivp(
        derivative, times[[0, -1]], first, "DOP853", times, rtol=1e-9, atol=1e-11, max_step=2e-3
    )
    return result.y[: 2 * n].T.reshape(len(times), n, 2)
