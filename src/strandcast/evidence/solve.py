"""Least squares whose Jacobian is one batch of simulations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from strandcast.string.parameters import Array

Residuals = Callable[[Array], Array]

TOLERANCE = 1e-5
INVALID = 1.0  # residual of a simulation that failed: far worse than any that did not


@dataclass(frozen=True)
class Unknown:
    """One unknown of a fit.

    Attributes
    ----------
    name
        Its name; one that is positive over decades is solved for as its logarithm and named ``log_…``.
    start, low, high
        First guess and bounds.
    step
        Difference for the derivative; also the scale on which the solver walks, a hundred steps long.
    """

    name: str
    start: float
    low: float
    high: float
    step: float


@dataclass(frozen=True, eq=False)
class Solution:
    """What a fit found.

    Attributes
    ----------
    values
        (d,) the unknowns.
    sum_of_squares
        Of the residuals.
    residuals
        (R,) at the solution.
    """

    values: Array
    sum_of_squares: float
    residuals: Array


def solve(
    residuals: Residuals, unknowns: list[Unknown], start: Array | None = None, rounds: int = 30
) -> Solution:
    """Minimise the sum of squares of residuals over a box.

    Parameters
    ----------
    residuals
        From candidates (B, d) to residuals (B, R); what is not finite counts as `INVALID`.
    unknowns
        The d unknowns.
    start
        (d,) where to start instead of the unknowns' own starts.
    rounds
        Steps at most.
    """
    low, high, step = (np.array([getattr(u, name) for u in unknowns]) for name in ("low", "high", "step"))
    first = np.array([u.start for u in unknowns]) if start is None else start

    def safe(candidates: Array) -> Array:
        values = residuals(candidates)
        return np.where(np.isfinite(values), values, INVALID)

    def one(x: Array) -> Array:
        return np.asarray(safe(x[None])[0])

    def jacobian(x: Array) -> Array:
        sign = np.where(x + step > high, -1.0, 1.0)
        values = safe(np.vstack([x, x + np.diag(sign * step)]))
        return np.asarray(((values[1:] - values[0]) / (sign * step)[:, None]).T)

    found = least_squares(
        one,
        np.clip(first, low, high),
        jacobian,
        (low, high),
        x_scale=100.0 * step,
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        max_nfev=rounds,
    )
    return Solution(found.x, 2.0 * float(found.cost), found.fun)
