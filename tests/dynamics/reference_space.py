"""The string's equations in space once more, in plain numpy from the energies, for an independent integrator.

Frames are carried along the string as three vectors each; all forces are derivatives by complex steps.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from reference import smooth
from scipy.integrate import solve_ivp

TICK = 1e-30
NEXT, LAST = [1, 2, 0], [2, 0, 1]  # coordinates, each shifted by one and by two


class ClampState(NamedTuple):
    """A clamp: place, velocity, frame (direction away from the clamp and two normals, in rows), turn rate."""

    place: np.ndarray
    velocity: np.ndarray
    frame: np.ndarray
    rate: np.ndarray


def dot(a, b):
    return (a * b).sum(-1)


def cross(a, b):
    """The cross product; of small arrays, `numpy.cross` takes several times as long."""
    return a[..., NEXT] * b[..., LAST] - a[..., LAST] * b[..., NEXT]


def unit(d):
    return d / np.sqrt(dot(d, d))[..., None]


@dataclass(frozen=True)
class SpatialEquations:
    """What is fixed about one string, and the accelerations of its free points."""

    parameters: np.ndarray
    masses: np.ndarray
    rest_m: float
    reading: str = "rate"
    switch: float = 0.5
    curl_rad_m: np.ndarray = field(default_factory=lambda: np.zeros(2))
    factor: np.ndarray | float = 1.0
    drag_along: float = 0.0
    gravity_m_s2: float = 9.81
    friction: float = 0.0
    stick_rad: float = 0.0
    torsion_rad_m: float = 0.0

    def accelerations(self, x, v, clamp, far=None, held=None):
        """Accelerations of the free points (m, 3); x, v (n+1, 3) include the driven ends.

        `held` (J, 2): share of the full moment of friction at each joint.
        """
        k_s, c_s, _, _, _, _, c1, c2, _, _ = self.parameters
        d, w = np.diff(x, axis=0), np.diff(v, axis=0)
        length, u = np.linalg.norm(d, axis=1), unit(d)
        pull = k_s * (length - self.rest_m)
        tension = ((pull + c_s * dot(w, u))[:, None]) * u
        air = (c1 + c2 * np.linalg.norm(v, axis=1))[:, None] * v
        if self.drag_along:
            t = unit(np.vstack([d[:1], d[:-1] + d[1:], d[-1:]]))
            air -= (1.0 - self.drag_along) * dot(air, t)[:, None] * t
        force = self.bending(x, v, pull, clamp, far, held) - air
        force[:-1] += tension
        force[1:] -= tension
        free = slice(1, len(x) if far is None else -1)
        a = force[free] / self.masses[: len(x[free]), None]
        return a - [0.0, 0.0, self.gravity_m_s2]

    def bending(self, x, v, pull, clamp, far, held):
        """Forces (n+1, 3) of all joints: stiffness times an energy's gradient, damping times a rate's."""
        energy, rate, bends = self.derivatives(x, clamp, far)
        force = np.zeros(x.size)
        if held is not None:
            factor = np.append(np.broadcast_to(self.factor, len(x) - 1), self.factor[0])
            for own, share, gradient in zip(factor, held, bends, strict=False):
                force -= own * self.friction * gradient[:-1] @ share
        for j, (gradient, turning) in enumerate(zip(energy, rate, strict=True)):
            now = turning[:-1].T @ v.ravel() + turning[-1]  # the last derivative is that of moving clamps
            half_square_rate = gradient[:-1] @ v.ravel() + gradient[-1]
            k, c = self.stiffness(j, len(x) - 1, half_square_rate, pull)
            force -= k * gradient[:-1] + c * turning[:-1] @ now
        return force.reshape(x.shape)

    def derivatives(self, x, clamp, far):
        """Derivatives of each joint's half squared bend (J, D) and of its relative turn (J, D, 3).

        By all coordinates of the points, and last by the time in which only the clamps turn.
        """
        count = x.size + 1
        moved = np.broadcast_to(x.ravel().astype(complex), (count, x.size)).copy()
        moved[: x.size] += 1j * TICK * np.eye(x.size)
        u = unit(np.diff(moved.reshape(count, *x.shape), axis=1))
        frame = self.turning(clamp, count)
        directions = [frame[:, 0], *u.swapaxes(0, 1)]
        if far is not None:
            directions.append(-self.turning(far, count)[:, 0])
        energy, rate, bends = [], [], []
        for j, (a, b) in enumerate(pairwise(directions)):
            across, cosine = cross(a, b), dot(a, b)
            sine = np.sqrt(dot(across, across) + 1e-300)
            bend = across * (2.0 * np.arctan(sine / (1.0 + cosine)) / sine)[:, None]
            bends.append(dot(bend[:, None], frame[:, 1:]).imag / TICK)
            if 0 < j < len(x) - 1:
                turned = j * self.rest_m * self.torsion_rad_m
                left = np.cos(turned) * self.curl_rad_m[0] - np.sin(turned) * self.curl_rad_m[1]
                up = np.sin(turned) * self.curl_rad_m[0] + np.cos(turned) * self.curl_rad_m[1]
                bend = bend - self.rest_m * (left * frame[:, 2] - up * frame[:, 1])
            energy.append(0.5 * dot(bend, bend).imag / TICK)
            axis = across[:, None]
            along = dot(axis, frame) / (1.0 + cosine)[:, None]
            carried = cosine[:, None, None] * frame + cross(axis, frame) + axis * along[..., None]
            rate.append(spin_of(carried) - spin_of(frame))
            frame = carried
        return energy, rate, bends

    def build_up(self, x, v, clamp, far, held):
        """Rates (J, 2) of the shares `held`, which follow the bend over `stick_rad`."""
        bends = np.array(self.derivatives(x, clamp, far)[2])
        rate = np.einsum("jdk,d->jk", bends[:, :-1], v.ravel()) + bends[:, -1]
        return (rate - held * np.linalg.norm(rate, axis=1)[:, None]) / self.stick_rad

    @staticmethod
    def turning(clamp, count):
        """The clamp's frame (count, 3, 3), turned on only in the last derivative."""
        frame = np.broadcast_to(clamp.frame.astype(complex), (count, 3, 3)).copy()
        frame[-1] += 1j * TICK * cross(clamp.rate, clamp.frame)
        return frame

    def stiffness(self, j, n, half_square_rate, pull):
        """Stiffness and damping of joint j of n + 1."""
        _, _, k_h, c_h, k_sh, c_sh, _, _, k_ph, c_ph = self.parameters
        factor = np.broadcast_to(self.factor, n)
        if j in (0, n):
            return factor[0] * k_ph, factor[0] * c_ph
        switch = half_square_rate
        if self.reading == "strain":
            switch = -(pull[j] + pull[j - 1]) / 2 / (self.masses[j - 1] * self.gravity_m_s2)
        share = smooth(switch, self.switch)
        return factor[j] * (k_sh + (k_h - k_sh) * share), factor[j] * (c_sh + (c_h - c_sh) * share)


def spin_of(frame):
    """Turn rates (D, 3) of frames (D, 3, 3) with their derivatives in the imaginary parts."""
    return 0.5 * cross(frame.real, frame.imag / TICK).sum(axis=1)


def integrate(equations, clamp, start, times, start_velocity=None, far=None):
    """DOP853 with clamps as functions of time to `ClampState`: free points at `times` (F, m, 3) [m]."""
    shape = start.shape

    def derivative(t, state):
        at, end = clamp(t), None if far is None else far(t)
        y, w = (each.reshape(shape) for each in np.split(state[: 2 * start.size], 2))
        x = np.vstack([at.place, y] if end is None else [at.place, y, end.place])
        v = np.vstack([at.velocity, w] if end is None else [at.velocity, w, end.velocity])
        if not equations.stick_rad:
            return np.r_[w.ravel(), equations.accelerations(x, v, at, end).ravel()]
        held = state[2 * start.size :].reshape(-1, 2)
        a = equations.accelerations(x, v, at, end, held)
        return np.r_[w.ravel(), a.ravel(), equations.build_up(x, v, at, end, held).ravel()]

    velocity = np.zeros(shape) if start_velocity is None else start_velocity
    joints = len(start) + (0 if far is None else 2)
    first = np.r_[start.ravel(), velocity.ravel(), np.zeros(2 * joints if equations.stick_rad else 0)]
    result = solve_ivp(
        derivative, times[[0, -1]], first, "DOP853", times, rtol=1e-8, atol=1e-10, max_step=4e-3
    )
    return result.y[: start.size].T.reshape(len(times), *shape)
