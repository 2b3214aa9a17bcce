"""The string's equations once more, in plain numpy from the energies, for an independent integrator."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp


def smooth(value, width):
    t = np.clip(0.5 + 0.5 * value / width, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def accelerations(x, v, clamp, clamp_rate, p, masses, spacing, reading, width, curl=0.0, gravity=9.81):
    """Accelerations of points 1…n; x, v include the hand. Written with complex numbers."""
    k_s, c_s, k_h, c_h, k_sh, c_sh, c1, c2, k_ph, c_ph = p
    z, w = x[:, 0] + 1j * x[:, 1], v[:, 0] + 1j * v[:, 1]
    d, dw = np.diff(z), np.diff(w)
    length, u = np.abs(d), d / np.abs(d)
    log_rate = dw / d  # real part: relative stretching, imaginary part: turning
    turn = log_rate.imag
    tension = k_s * (length - spacing) + c_s * log_rate.real * length
    total = -(c1 + c2 * np.abs(w)) * w - 1j * gravity * np.r_[0, masses]
    total[1:] -= tension * u
    total[:-1] += tension * u
    bend = wrap(np.diff(np.angle(d))) - curl * spacing
    rate = np.diff(turn)
    if reading == "rate":
        share = smooth(bend * rate, width)
    elif reading == "sign":
        share = smooth(bend, width)
    else:
        pull = k_s * (length - spacing)
        share = smooth(-(pull[1:] + pull[:-1]) / 2 / (masses[:-1] * gravity), width)
    moment = (k_sh + (k_h - k_sh) * share) * bend + (c_sh + (c_h - c_sh) * share) * rate
    shear = np.zeros(len(d), dtype=complex)  # moment difference over the length, turned by +90 degrees
    moments = np.r_[k_ph * wrap(np.angle(d[0]) - clamp) + c_ph * (turn[0] - clamp_rate), moment, 0.0]
    shear = (moments[1:] - moments[:-1]) / length * 1j * u
    total[1:] += shear
    total[:-1] -= shear
    return (total[1:] / masses).view(float).reshape(-1, 2)


def integrate(path, start, p, masses, spacing, reading, width, times, curl=0.0, start_velocity=None):
    """DOP853 along `path(t) -> (x, y, angle), (vx, vy, rate)`; positions of points 1…n at `times`."""
    n = len(masses)

    def derivative(t, state):
        pose, speed = path(t)
        x = np.vstack([pose[:2], state[: 2 * n].reshape(n, 2)])
        v = np.vstack([speed[:2], state[2 * n :].reshape(n, 2)])
        a = accelerations(x, v, pose[2], speed[2], p, masses, spacing, reading, width, curl)
        return np.r_[state[2 * n :], a.ravel()]

    velocity = np.zeros((n, 2)) if start_velocity is None else start_velocity
    first = np.r_[start.ravel(), velocity.ravel()]
    result = solve_ivp(
        derivative, times[[0, -1]], first, "DOP853", times, rtol=1e-9, atol=1e-11, max_step=2e-3
    )
    return result.y[: 2 * n].T.reshape(len(times), n, 2)
