"""Proofs at rest: where the string hangs, how it is stretched, how a clamped one sags."""

import numpy as np
import reference
from arrays import simulate, start_shape
from proof import DOWN, GRAVITY_M_S2, Options, along, largest, parameters, proof, still

from strandcast.dynamics.model import READINGS, StringModel

MASSES = np.array([1.0, 1.0, 3.0, 1.0, 8.0])
STRING = parameters(
    k_s=2e4, c_s=5.0, k_h=0.5, c_h=0.02, k_sh=0.2, c_sh=0.01, C_c1=0.1, C_c2=0.3, k_ph=2.0, c_ph=0.02
)


@proof("mm", lfcn=1e-9, lfcn_f32=1e-3)
def hangs_stretched(options: Options) -> float:
    """A hanging string starts, and stays, with each segment stretched by the weight below it."""
    model = StringModel(0.2, 5, **options)
    below = np.cumsum(MASSES[::-1])[::-1]
    rest = along(np.full(5, -np.pi / 2), model.spacing_m + below * GRAVITY_M_S2 / STRING[0])
    times, pose = still(DOWN, 0.2)
    simulated, _ = simulate(model, STRING, MASSES, times, pose, np.array([0.0, 0.2]))
    placed, _ = simulate(model, STRING, MASSES, times, pose, np.array([0.2]), rest, respace=False)
    return 1e3 * largest(simulated[:, 1:] - rest, placed[:, 1:] - rest)


@proof("N/kg", lfcn=1e-9, lfcn_f32=1e-3)
def starts_where_the_forces_balance(options: Options) -> float:
    """The start shape of a clamped, curled string leaves no force, by the independent equations."""
    pose = np.array([0.3, 0.2, 0.4])
    factor = np.array([1.0, 2.0, 1.0, 0.5, 3.0])
    left = []
    for reading in READINGS:
        model = StringModel(0.2, 5, reading=reading, **options)
        string = {"rest_curl_rad_m": -1.5, "bend_factor": factor, "clamp_offset_rad": 0.2}
        points = start_shape(model, STRING, MASSES, pose, **string)
        equations = reference.Equations(
            STRING, MASSES, model.spacing_m, reading, model.switch(), -1.5, 0.2, factor
        )
        left.append(equations.accelerations(points, np.zeros((6, 2)), pose[2], 0.0))
    return largest(*left)


@proof("mm", lfcn=1e-6, lfcn_f32=1e-2)
def rests_where_it_starts(options: Options) -> float:
    """A clamped, curled string stays where it starts, in every reading."""
    times, pose = still(np.array([0.3, 0.2, 0.4]), 0.2)
    moved = []
    for reading in READINGS:
        model = StringModel(0.2, 5, reading=reading, **options)
        string = {"rest_curl_rad_m": -1.5, "clamp_offset_rad": 0.2}
        simulated, _ = simulate(model, STRING, MASSES, times, pose, np.array([0.0, 0.1, 0.2]), **string)
        moved.append(simulated - simulated[0])
    return 1e3 * largest(*moved)


def sag_m(stiffness: float, root_stiffness: float, masses: np.ndarray, spacing: float, gravity: float):
    """Small deflection of a clamped chain: each joint turns by its moment over its stiffness (n,) [m]."""
    n = len(masses)
    moments = [gravity * spacing * (masses[j:] @ np.arange(1, n + 1 - j)) for j in range(n)]
    turns = np.array(moments) / np.r_[root_stiffness, np.full(n - 1, stiffness)]
    return spacing * np.cumsum(np.cumsum(turns))


@proof("% of the sag", lfcn=1e-3, lfcn_f32=0.1)
def cantilever(options: Options) -> float:
    """A horizontally clamped string settles with the sag of a beam: by k_sh to the right, k_h to the left."""
    model = StringModel(0.3, 6, reading="sign", switch_width=1e-9, gravity_m_s2=0.01, **options)
    masses = np.array([1.0, 1.0, 2.0, 1.0, 1.0, 3.0])
    p = parameters(k_s=1e4, c_s=5.0, k_h=20.0, c_h=3.0, k_sh=10.0, c_sh=2.0, C_c1=2.0, k_ph=30.0, c_ph=1.0)
    off = []
    for angle, stiffness in ((0.0, p[4]), (np.pi, p[2])):
        times, pose = still(np.array([0.0, 0.0, angle]), 8.0)
        straight = along(np.full(6, angle), model.spacing_m)
        simulated, _ = simulate(model, p, masses, times, pose, times[-1:], straight, respace=False)
        expected = sag_m(stiffness, p[8], masses, model.spacing_m, 0.01)
        off.append(simulated[0, 1:, 1] / expected[-1] + expected / expected[-1])
    return 100.0 * largest(*off)


@proof("% of the sag", lfcn=0.2, lfcn_f32=0.2)
def beam(options: Options) -> float:
    """The sag tends to Euler and Bernoulli's w L^4 / 8 EI, EI = k l0: extrapolated over 10 and 20 points."""
    length, k, gravity = 0.3, 10.0, 1e-4
    sags = []
    for n in (10, 20):
        # A uniform beam: half a point at the tip; the first joint is half a joint, the clamp holds the rest.
        masses = np.r_[np.ones(n - 1), 0.5]
        model = StringModel(length, n, gravity_m_s2=gravity, **options)
        p = parameters(k_s=1e6, k_h=k, k_sh=k, k_ph=k)
        factor = (2.0,) + (1.0,) * (n - 1)
        points = start_shape(model, p, masses, np.zeros(3), bend_factor=factor)
        weight, stiffness = gravity / model.spacing_m, k * model.spacing_m
        sags.append(-points[-1, 1] / (weight * length**4 / 8.0 / stiffness))
    return 100.0 * abs((4.0 * sags[1] - sags[0]) / 3.0 - 1.0)
