"""Levenberg-Marquardt on E from several starts at once.

E is a sum of weighted distances, not of squares: each step solves a least-squares problem with weights
divided by the present distances (iteratively reweighted). All starts advance together: the finite differences
of their Jacobians are one batch of simulations, and their ladders of dampings another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.space import DEVIATION_COSTS_M

STEP = 2e-3
NEAREST_M = 3e-4  # smaller distances weigh no more: they are measurement noise
LADDER = 10.0 ** np.arange(-2.0, 4.0)  # dampings tried at once, times the start's own
GAIN = 2e-4  # smallest relative improvement that counts
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e3
DERIVATIVE_FRAMES = 120  # of each throw: neighbouring frames have nearly the same derivatives
APART = 0.15  # least distance of starts in some exponent

GaussNewton = Callable[[Array], tuple[Array, Array]]


@dataclass(eq=False)
class DescentBatch:
    """State of S descents.

    Attributes
    ----------
    chi, value
        (S, d) exponents and (S,) their E and penalty.
    gradient, curvature
        (S, d) and (S, d, d) of E at the last derivative [m].
    damping
        (S,) of the next step.
    known, done
        (S,) whether the derivative belongs to the present point, and whether no damping improves E any more.
    held
        (S, d) unknowns that are held fixed.
    """

    chi: Array
    value: Array
    gradient: Array
    curvature: Array
    damping: Array
    known: np.ndarray
    done: np.ndarray
    held: np.ndarray

    def pick(self, rows: np.ndarray) -> DescentBatch:
        """Return some of the descents."""
        return DescentBatch(**{name: column[rows] for name, column in vars(self).items()})


def descent_batch(chi: Array, value: Array, held: np.ndarray | None = None) -> DescentBatch:
    """Return descents that start at evaluated candidates (S, d)."""
    count, d = chi.shape
    return DescentBatch(
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
    log: EvaluationLog, slopes: GaussNewton, now: DescentBatch, evaluations: int, rounds: int | None = None
) -> DescentBatch:
    """Descend until all have converged, the evaluations are spent or the rounds are over.

    Parameters
    ----------
    log
        Evaluates and logs the steps tried, and counts the simulations of the derivatives.
    slopes
        Gradient and curvature of candidates, see `GaussNewtonModel`.
    now
        The starts; changed in place.
    evaluations
        Simulations to spend at most, the Jacobians' included.
    rounds
        Steps to take at most.
    """
    end = log.count + evaluations
    d = now.chi.shape[1]
    taken = 0
    while not now.done.all() and (rounds is None or taken < rounds):
        walking = np.flatnonzero(~now.done)
        fresh = walking[~now.known[walking]]
        if log.count + len(fresh) * (d + 1) + len(walking) * len(LADDER) > end:
            break
        if len(fresh):
            now.gradient[fresh], now.curvature[fresh] = slopes(now.chi[fresh])
            log.count += len(fresh) * (d + 1)
            now.known[fresh] = True
        _step(log, now, walking)
        taken += 1
    return now


def _step(log: EvaluationLog, now: DescentBatch, walking: np.ndarray) -> None:
    """Try all dampings of every descent; the best one gives the next point if it improves E."""
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
    values = log(candidates.reshape(-1, now.chi.shape[1])).reshape(tried.shape)
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
class GaussNewtonModel:
    """Gradient and Gauss-Newton curvature of E and penalty, by one-sided differences.

    Attributes
    ----------
    objective
        The function to minimise; only some of its frames are used.
    nearest_m
        Smaller distances weigh no more: among them, squares are minimised [m].
    """

    objective: FitObjective
    nearest_m: float = NEAREST_M

    def __call__(self, chi: Array) -> tuple[Array, Array]:
        """Gradients (S, d) and curvatures (S, d, d) [m] of candidates (S, d), in one batch of S (d + 1)."""
        count, d = chi.shape
        step = np.where(chi > 0.5, -STEP, STEP)
        moved = chi[:, None] + np.concatenate([np.zeros((count, 1, d)), step[:, :, None] * np.eye(d)], axis=1)
        difference, weight = self.objective.thinned(DERIVATIVE_FRAMES).residuals(moved.reshape(-1, d))
        gradient, curvature = np.empty((count, d)), np.empty((count, d, d))
        shaped = difference.reshape(count, d + 1, -1, difference.shape[-1])
        for s in range(count):
            gradient[s], curvature[s] = normal_equations(shaped[s], weight, step[s], self.nearest_m)
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
        (d+1, R, 2 or 3) of the point itself and of the points a `step` (d,) away in each unknown.
    weight
        (R,).
    nearest
        Distances below this weigh no more.
    """
    d, rows = len(step), len(weight)
    gradient, curvature = np.zeros(d), np.zeros((d, d))
    slope = np.empty(d)
    for r in range(rows):
        distance = np.hypot(difference[0, r, 0], difference[0, r, 1])
        for c in range(2, difference.shape[2]):
            distance = np.hypot(distance, difference[0, r, c])
        per_square = weight[r] / max(distance, nearest)
        for c in range(difference.shape[2]):
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


def bounded_step(chi: Array, gradient: Array, curvature: Array, damping: float, held: np.ndarray) -> Array:
    """Damped Gauss-Newton step (d,): it ends at the bounds of the box; unknowns `held` (d,) do not move."""
    scale = damping * (np.diag(curvature) + 1e-9 * np.trace(curvature) + 1e-12)
    free = ~(((chi <= 0.0) & (gradient > 0)) | ((chi >= 1.0) & (gradient < 0)) | held)
    step = np.zeros_like(chi)
    damped, rigid = curvature + np.diag(scale), np.eye(len(chi))
    for _ in range(len(chi)):
        # The rows of held unknowns keep them where they are.
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
