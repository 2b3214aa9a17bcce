"""Levenberg-Marquardt on E, batched: the last metres of a fit, and how sharp its valley is.

E is a sum of weighted distances, not of squares: each step solves the least squares with weights over the
present distances (iteratively reweighted). The differences of the Jacobian and a ladder of dampings are
batches.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strandcast.estimation.evaluation import Array
from strandcast.estimation.objective import Ledger

DESCENTS = 3
APART = 0.15
WORTHWHILE = 5  # steps that a descent must be able to afford

Residuals = Callable[[Array], tuple[Array, Array]]

STEP = 2e-3
NEAREST_M = 3e-4  # distances below this weigh no more: they are the measurement's noise
LADDER = np.array([1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0])


def refine(ledger: Ledger, residuals: Residuals, start: Array, evaluations: int) -> tuple[Array, Array]:
    """Walk downhill from `start` until the evaluations are spent or no damping gains 0.02 %.

    Parameters
    ----------
    ledger
        Evaluates and remembers the steps tried, and counts the simulations of the derivatives.
    residuals
        Differences (B, R, 2) and weights (R,) of candidates (B, d).
    start
        (d,) exponents.
    evaluations
        Simulations to spend at most, the Jacobian's included.

    Returns
    -------
    chi
        (d,) the best point.
    curvature
        (d, d) approximate second derivative of E there [m].
    """
    chi = np.clip(start, 0.0, 1.0)
    value = float(ledger(chi[None])[0])
    damping = 1e-2
    begun = ledger.count - 1
    gradient, curvature = np.zeros(len(chi)), np.zeros((len(chi), len(chi)))
    moved = True
    while ledger.count - begun + len(chi) + 1 + len(LADDER) <= evaluations:
        if moved:
            gradient, curvature = slope(residuals, chi)
            ledger.count += len(chi) + 1
        if not np.isfinite(gradient).all():
            break
        scale = np.diag(curvature) + 1e-9 * np.trace(curvature) + 1e-12
        tried = damping * LADDER / LADDER[2]
        steps = np.array([_bounded_step(chi, gradient, curvature, factor * scale) for factor in tried])
        values = ledger(chi + steps)
        k = int(np.argmin(values))
        moved = bool(values[k] < value * (1.0 - 2e-4))
        if not moved:
            if damping > 1e3:
                break
            damping *= 100.0
            continue
        chi, value, damping = np.clip(chi + steps[k], 0.0, 1.0), float(values[k]), max(tried[k], 1e-6)
    return chi, curvature


def descend(
    ledger: Ledger, residuals: Residuals, evaluations: int, starts: int = DESCENTS
) -> tuple[Array, Array]:
    """Refine from several of the best candidates that lie apart, and stay with the best.

    Returns
    -------
    The best point (d,) and the curvature there (d, d), as `refine` does; where no candidate is valid, any.
    """
    chi, values = ledger.all()
    worthwhile = evaluations // (WORTHWHILE * (chi.shape[1] + 1 + len(LADDER)))
    chosen = _apart(chi, values, min(starts, max(worthwhile, 1)))
    ends = [refine(ledger, residuals, chi[k], evaluations // len(chosen)) for k in chosen]
    if not ends:
        return ledger.best()[0], np.eye(chi.shape[1])
    best = ledger.best()[0]
    nearest = int(np.argmin([np.abs(end[0] - best).max() for end in ends]))
    return best, ends[nearest][1]


def _apart(chi: Array, values: Array, count: int) -> list[int]:
    """Choose the best candidates that are at least `APART` from each other in some exponent."""
    order = np.argsort(values, kind="stable")
    chosen: list[int] = []
    for k in order[np.isfinite(values[order])]:
        if all(np.abs(chi[k] - chi[other]).max() >= APART for other in chosen):
            chosen.append(int(k))
        if len(chosen) == count:
            break
    return chosen


def slope(residuals: Residuals, chi: Array) -> tuple[Array, Array]:
    """Gradient (d,) and Gauss-Newton curvature (d, d) of E at `chi`, by one-sided differences."""
    sign = np.where(chi > 0.5, -1.0, 1.0)
    candidates = np.vstack([chi, chi + np.diag(sign * STEP)])
    difference, weight = residuals(candidates)
    base = difference[0]
    jacobian = (difference[1:] - base) / (sign * STEP)[:, None, None]
    per_square = weight / np.maximum(np.hypot(base[:, 0], base[:, 1]), NEAREST_M)
    gradient = np.einsum("r,rc,drc->d", per_square, base, jacobian)
    curvature = np.einsum("r,drc,erc->de", per_square, jacobian, jacobian, optimize=True)
    return gradient, curvature


def _bounded_step(chi: Array, gradient: Array, curvature: Array, damping: Array) -> Array:
    """Damped Gauss-Newton step; unknowns that it would push out of the box are held at the bound."""
    free = ~(((chi <= 0.0) & (gradient > 0)) | ((chi >= 1.0) & (gradient < 0)))
    step = np.zeros_like(chi)
    for _ in range(len(chi)):
        kept = np.flatnonzero(free)
        if len(kept) == 0:
            break
        held = curvature[np.ix_(kept, np.flatnonzero(~free))] @ step[~free]
        matrix = curvature[np.ix_(kept, kept)] + np.diag(damping[kept])
        step[kept] = -np.linalg.solve(matrix, gradient[kept] + held)
        outside = free & ((chi + step < 0.0) | (chi + step > 1.0))
        if not outside.any():
            break
        step[outside] = np.clip(chi + step, 0.0, 1.0)[outside] - chi[outside]
        free &= ~outside
    return step
