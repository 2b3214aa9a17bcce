"""Least squares with a Jacobian from one batch of simulations."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from strandcast.dynamics.parameters import Array

TOLERANCE = 1e-5
INVALID = 1.0  # residual of a failed simulation: far larger than any other; chosen


@dataclass(frozen=True)
class FreeParameter:
    """One unknown of a fit, with initial value and bounds."""

    name: str  # ``log_…`` for the logarithm of a positive quantity that may span several decades
    start: float
    low: float
    high: float
    step: float  # difference for the derivative; the solver's scale is a hundred steps


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of a fit."""

    values: Array  # (d,) of the unknowns
    sum_of_squares: float  # of the residuals
    residuals: Array  # (R,)


def solve(
    residuals: Callable[[Array], Array], unknowns: list[FreeParameter], start: Array | None = None
) -> Solution:
    """Minimise the sum of squares of residuals over a box.

    Parameters
    ----------
    residuals
        From candidates (B, d) to residuals (B, R); non-finite ones count as `INVALID`.
    unknowns
        The d unknowns.
    start
        (d,) initial values instead of the unknowns' own.
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
        max_nfev=30,
    )
    return Solution(found.x, 2.0 * float(found.cost), found.fun)
