"""Levenberg-Marquardt on E from several starts at once, and how sharp the valleys are.

E is a sum of weighted distances, not of squares: each step solves the least squares with weights over the
present distances (iteratively reweighted). All starts walk in step: the differences of their Jacobians are
one batch, and their ladders of dampings another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from strandcast.estimation.evaluation import Array
from strandcast.estimation.objective import Ledger, Objective
from strandcast.estimation.space import DEVIATION_COSTS_M

STEP = 2e-3
NEAREST_M = 3e-4  # distances below this weigh no more: they are the measurement's noise
LADDER = 10.0 ** np.arange(-2.0, 4.0)  # dampings tried at once, times the start's own
GAIN = 2e-4  # a relative gain below this is none
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e3
SLOPE_FRAMES = 120  # of each throw: neighbouring frames tell the same slope
APART = 0.15

Slopes = Callable[[Array], tuple[Array, Array]]


@dataclass(eq=False)
class Valleys:
    """Where S descents stand.

    Attributes
    ----------
    chi, value
        (S, d) exponents and (S,) their E and penalty.
    gradient, curvature
        (S, d) and (S, d, d) of E at the last derivative [m].
    damping
        (S,) of the next step.
    known, done
        (S,) whether the derivative is that of the present point, and whether no damping gains any more.
    held
        (S, d) unknowns that stay as they are.
    """

    chi: Array
    value: Array
    gradient: Array
    curvature: Array
    damping: Array
    known: np.ndarray
    done: np.ndarray
    held: np.ndarray

    def pick(self, rows: np.ndarray) -> Valleys:
        """Return some of the descents."""
        return Valleys(**{name: column[rows] for name, column in vars(self).items()})


def valleys(chi: Array, value: Array, held: np.ndarray | None = None) -> Valleys:
    """Return descents that stand at evaluated candidates (S, d)."""
    count, d = chi.shape
    return Valleys(
        chi.copy(),
        value.copy(),
        np.zeros((count, d)),
        np.zeros((count, d, d)),
        np.full(count, FIRST_DAMPING),
        np.zeros(count, dtype=bool),
        np.zeros(count, dtype=bool),
        np.zeros((count, d), dtype=bool) if held is None else held,
    )


def descend(
    ledger: Ledger, slopes: Slopes, now: Valleys, evaluations: int, rounds: int | None = None
) -> Valleys:
    """Walk downhill until all have arrived, the evaluations are spent or the rounds are over.

    Parameters
    ----------
    ledger
        Evaluates and remembers the steps tried, and counts the simulations of the derivatives.
    slopes
        Gradient and curvature of candidates, see `Slope`.
    now
        The starts; changed in place.
    evaluations
        Simulations to spend at most, the Jacobians' included.
    rounds
        Steps to take at most.
    """
    end = ledger.count + evaluations
    d = now.chi.shape[1]
    taken = 0
    while not now.done.all() and (rounds is None or taken < rounds):
        walking = np.flatnonzero(~now.done)
        fresh = walking[~now.known[walking]]
        if ledger.count + len(fresh) * (d + 1) + len(walking) * len(LADDER) > end:
            break
        if len(fresh):
            now.gradient[fresh], now.curvature[fresh] = slopes(now.chi[fresh])
            ledger.count += len(fresh) * (d + 1)
            now.known[fresh] = True
        _step(ledger, now, walking)
        taken += 1
    return now


def _step(ledger: Ledger, now: Valleys, walking: np.ndarray) -> None:
    """Try the ladder of every descent; the best rung is the next point, if it gains."""
    broken = ~np.isfinite(now.gradient[walking]).all(axis=1)
    now.done[walking[broken]] = True
    walking = walking[~broken]
    if not len(walking):
        return
    tried = now.damping[walking, None] * LADDER
    steps = np.array(
        [
            [bounded_step(now.chi[s], now.gradient[s], now.curvature[s], x, now.held[s]) for x in row]
            for s, row in zip(walking, tried, strict=True)
        ]
    )
    candidates = np.clip(now.chi[walking, None] + steps, 0.0, 1.0)
    values = ledger(candidates.reshape(-1, now.chi.shape[1])).reshape(tried.shape)
    for row, s in enumerate(walking):
        k = int(np.argmin(values[row]))
        if values[row, k] < now.value[s] * (1.0 - GAIN):
            now.chi[s], now.value[s] = candidates[row, k], values[row, k]
            now.damping[s] = max(tried[row, k], LEAST_DAMPING)
            now.known[s] = False
        else:
            now.done[s] = now.damping[s] >= MOST_DAMPING
            now.damping[s] *= 1e3


@dataclass(frozen=True, eq=False)
class Slope:
    """Gradient and Gauss-Newton curvature of E and penalty, by one-sided differences.

    Attributes
    ----------
    objective
        What is minimised; its frames are thinned out.
    """

    objective: Objective

    def __call__(self, chi: Array) -> tuple[Array, Array]:
        """Gradients (S, d) and curvatures (S, d, d) [m] of candidates (S, d), in one batch of S (d + 1)."""
        count, d = chi.shape
        step = np.where(chi > 0.5, -STEP, STEP)
        moved = chi[:, None] + np.concatenate([np.zeros((count, 1, d)), step[:, :, None] * np.eye(d)], axis=1)
        difference, weight = self.objective.thinned(SLOPE_FRAMES).residuals(moved.reshape(-1, d))
        gradient, curvature = np.empty((count, d)), np.empty((count, d, d))
        shaped = difference.reshape(count, d + 1, -1, 2)
        for s in range(count):
            gradient[s], curvature[s] = normal_equations(shaped[s], weight, step[s], NEAREST_M)
        space = self.objective.space
        # The penalty is a parabola where it is not flat: its unknowns are linear in chi.
        width = space.bounds[:, 1] - space.bounds[:, 0]
        bent = 2.0 * DEVIATION_COSTS_M * (width / space.prior_sd) ** 2
        gradient += 2.0 * DEVIATION_COSTS_M * space.deviations(chi) * width / space.prior_sd
        return gradient, curvature + np.diag(bent)


@njit(cache=True)
def normal_equations(difference: Array, weight: Array, step: Array, nearest: float) -> tuple[Array, Array]:
    """Gradient (d,) and Gauss-Newton curvature (d, d) of a weighted sum of distances.

    Parameters
    ----------
    difference
        (d+1, R, 2) of the point itself and of the points a `step` (d,) away in each unknown.
    weight
        (R,).
    nearest
        Distances below this weigh no more.
    """
    d, rows = len(step), len(weight)
    gradient, curvature = np.zeros(d), np.zeros((d, d))
    slope = np.empty(d)
    for r in range(rows):
        x, y = difference[0, r, 0], difference[0, r, 1]
        per_square = weight[r] / max(np.hypot(x, y), nearest)
        for c in range(2):
            base = difference[0, r, c]
            for i in range(d):
                slope[i] = (difference[i + 1, r, c] - base) / step[i]
            for i in range(d):
                scaled = per_square * slope[i]
                gradient[i] += scaled * base
                for j in range(i + 1):
                    curvature[i, j] += scaled * slope[j]
    for i in range(d):
        for j in range(i):
            curvature[j, i] = curvature[i, j]
    return gradient, curvature


def bounded_step(
    chi: Array, gradient: Array, curvature: Array, damping: float, held: np.ndarray | None = None
) -> Array:
    """Damped Gauss-Newton step; unknowns that it would push out of the box are held at the bound.

    Those that are `held` (d,) do not move at all.
    """
    scale = damping * (np.diag(curvature) + 1e-9 * np.trace(curvature) + 1e-12)
    free = ~(((chi <= 0.0) & (gradient > 0)) | ((chi >= 1.0) & (gradient < 0)))
    if held is not None:
        free &= ~held
    step = np.zeros_like(chi)
    damped, rigid = curvature + np.diag(scale), np.eye(len(chi))
    for _ in range(len(chi)):
        # The rows of those held say that they are where they are.
        step = np.linalg.solve(np.where(free[:, None], damped, rigid), np.where(free, -gradient, step))
        ends = chi + step
        outside = free & ((ends < 0.0) | (ends > 1.0))
        if not outside.any():
            break
        step[outside] = np.clip(ends, 0.0, 1.0)[outside] - chi[outside]
        free &= ~outside
    return step


def apart(chi: Array, values: Array, count: int) -> np.ndarray:
    """Choose the best candidates that are at least `APART` from each other in some exponent."""
    order = np.argsort(values, kind="stable")
    chosen: list[int] = []
    for k in order[np.isfinite(values[order])]:
        if all(np.abs(chi[k] - chi[other]).max() >= APART for other in chosen):
            chosen.append(int(k))
        if len(chosen) == count:
            break
    return np.array(chosen, dtype=int)
