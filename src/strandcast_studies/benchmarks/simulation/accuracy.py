"""The tip's error at a time step, against the same scheme at a tiny step and an independent integrator."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from strandcast.dynamics.parameters import Array
from strandcast_studies.benchmarks.simulation import ours
from strandcast_studies.benchmarks.simulation.numpy_string import accelerations
from strandcast_studies.benchmarks.simulation.swing import (
    COMMON_S,
    LENGTH_M,
    SEGMENTS,
    HandSwing,
    rms_mm,
    stays_regular,
    stretched_m,
    table_2,
)

TINY_S = 1e-3 / 64  # step of the reference
LADDER_S = (2e-3, 1.6e-3, 1.25e-3, 1e-3, 2e-3 / 3, 5e-4, 4e-4, 2e-3 / 6, 2.5e-4, 2e-4, 1.25e-4, 1e-4)
BOUND_MM = 0.1  # allowed median error; chosen


@dataclass(frozen=True, eq=False)
class Reference:
    """Strings within the model's validity, and their reference positions."""

    parameters: Array  # (B, 10) of the draws that stay regular
    positions: Array  # (B, F, n+1, 2) [m] at the common times, with steps of `TINY_S`
    drawn: int  # number of draws


def reference(swing: HandSwing, parameters: Array, mode: ours.Mode = ours.F64) -> Reference:
    """Simulate strings with tiny steps and keep those that stay regular."""
    simulated = ours.positions(mode, swing, parameters, TINY_S)
    kept = stays_regular(simulated)
    return Reference(parameters[kept], simulated[kept], len(parameters))


def drawn_reference(swing: HandSwing, draws: int, mode: ours.Mode = ours.F64) -> Reference:
    """Simulate log-uniform draws of Table 2 with tiny steps."""
    return reference(swing, table_2(draws, seed=5), mode)


def tip_errors_mm(mode: ours.Mode, swing: HandSwing, truth: Reference, dt_s: float) -> Array:
    """Return the error of each string's tip at a step, rms over the second (B,) [mm]."""
    simulated = ours.positions(mode, swing, truth.parameters, dt_s)
    return rms_mm(simulated[:, :, -1], truth.positions[:, :, -1])


def errors_by_step(mode: ours.Mode, swing: HandSwing, truth: Reference) -> dict[float, Array]:
    """Return the tip errors (B,) [mm] at every step of `LADDER_S`."""
    return {dt_s: tip_errors_mm(mode, swing, truth, dt_s) for dt_s in LADDER_S}


def coarsest_step(errors_mm: dict[float, Array]) -> float:
    """Return the coarsest step such that it and all finer ones have median errors within `BOUND_MM`.

    If the finest step exceeds the bound too, return the finest.
    """
    chosen = min(errors_mm)
    for dt_s in sorted(errors_mm):
        if np.median(errors_mm[dt_s]) > BOUND_MM:
            break
        chosen = dt_s
    return chosen


def independent_mm(swing: HandSwing, truth: Reference, strings: int) -> Array:
    """Return distances (strings,) [mm] of the reference's tips from an independent integration by DOP853.

    For the least damped strings: an explicit integrator is very slow on the others.
    """
    c_h, c_sh = truth.parameters[:, 3], truth.parameters[:, 5]
    chosen = np.argsort(c_h + c_sh)[:strings]
    tips = np.array([_integrated(swing, truth.parameters[i]) for i in chosen])
    return rms_mm(tips, truth.positions[chosen, :, -1])


def _integrated(swing: HandSwing, parameters: Array) -> Array:
    """Return the tip (F, 2) of one string by DOP853 on the equations of `numpy_string`."""
    p, spacing = parameters[:, None, None], LENGTH_M / SEGMENTS
    n = SEGMENTS

    def derivative(time_s: float, state: Array) -> Array:
        (x, y, angle), (vx, vy, turn) = (row[0] for row in swing.at(np.array([time_s])))
        z, w = state.view(complex).reshape(2, n)
        hand, hand_rate = complex(x, y), complex(vx, vy)
        a = accelerations(np.r_[hand, z][None], np.r_[hand_rate, w][None], angle, turn, p, spacing)
        return np.concatenate([w, a[0]]).view(float)

    (x, y, _), _ = (row[0] for row in swing.at(np.zeros(1)))
    start = complex(x, y) - 1j * np.cumsum(stretched_m(parameters[0]))
    state = np.concatenate([start, np.zeros(n)]).view(float)
    done = solve_ivp(
        derivative, (0.0, COMMON_S[-1]), state, "DOP853", COMMON_S, rtol=1e-8, atol=1e-10, max_step=2e-3
    )
    return np.asarray(done.y[2 * n - 2 : 2 * n].T)
