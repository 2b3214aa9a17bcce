"""Error of the tip at a step, against the same scheme at a tiny one and against an independent integrator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from strandcast.bench import ours
from strandcast.bench.numpy_string import accelerations
from strandcast.bench.swing import (
    COMMON_S,
    LENGTH_M,
    SEGMENTS,
    Swing,
    rms_mm,
    stays_regular,
    stretched_m,
    table_2,
)
from strandcast.string.parameters import Array

TINY_S = 1e-3 / 64
LADDER_S = (2e-3, 1.6e-3, 1.25e-3, 1e-3, 2e-3 / 3, 5e-4, 4e-4, 2e-3 / 6, 2.5e-4, 2e-4, 1.25e-4, 1e-4)
BOUND_MM = 0.1
SEED = 5
_C_H, _C_SH = 3, 5


@dataclass(frozen=True, eq=False)
class Reference:
    """Strings that the model describes, and where they truly go.

    Attributes
    ----------
    parameters
        (B, 10) those of the draws that stay regular.
    positions
        (B, F, n+1, 2) [m] at the common times, by steps of `TINY_S`.
    drawn
        How many were drawn.
    """

    parameters: Array
    positions: Array
    drawn: int


def reference(swing: Swing, parameters: Array, way: ours.Way = ours.F64) -> Reference:
    """Simulate strings by tiny steps and keep those that stay regular."""
    seen = ours.positions(way, swing, parameters, TINY_S)
    kept = stays_regular(seen)
    return Reference(parameters[kept], seen[kept], len(parameters))


def drawn_reference(swing: Swing, draws: int, way: ours.Way = ours.F64) -> Reference:
    """Simulate log-uniform draws of Table 2 by tiny steps."""
    return reference(swing, table_2(draws, SEED), way)


def tip_errors_mm(way: ours.Way, swing: Swing, truth: Reference, dt_s: float) -> Array:
    """Error of each string's tip at a step, rms over the second (B,) [mm]."""
    seen = ours.positions(way, swing, truth.parameters, dt_s)
    return rms_mm(seen[:, :, -1], truth.positions[:, :, -1])


def errors_by_step(way: ours.Way, swing: Swing, truth: Reference) -> dict[float, Array]:
    """Return the tip errors (B,) [mm] at every step of `LADDER_S`."""
    return {dt_s: tip_errors_mm(way, swing, truth, dt_s) for dt_s in LADDER_S}


def coarsest_step(errors_mm: dict[float, Array]) -> float:
    """Return the coarsest step whose median error is within `BOUND_MM`, as are those of all finer ones.

    The finest step if even that is not.
    """
    chosen = min(errors_mm)
    for dt_s in sorted(errors_mm):
        if np.median(errors_mm[dt_s]) > BOUND_MM:
            break
        chosen = dt_s
    return chosen


def witness_mm(swing: Swing, truth: Reference, strings: int) -> Array:
    """Distance of the reference's tips from an eighth-order Runge-Kutta integration of other code [mm].

    Of the least damped strings: an explicit integrator crawls with the others. (strings,)
    """
    chosen = np.argsort(truth.parameters[:, _C_H] + truth.parameters[:, _C_SH])[:strings]
    tips = np.array([_witness(swing, truth.parameters[i]) for i in chosen])
    return rms_mm(tips, truth.positions[chosen, :, -1])


def _witness(swing: Swing, parameters: Array) -> Array:
    """Tip (F, 2) of one string by DOP853 on the equations of `numpy_string`."""
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
