"""A standard deviation that is not known: its prior, and what deviations teach about it, on a grid."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

GRID = np.linspace(-6.0, 6.0, 241)  # logarithms of size / median, in the prior's standard deviations


class SizePrior(NamedTuple):
    """A standard deviation before any throw: its logarithm is normal, two in three within the factor."""

    median: float
    factor: float


@dataclass(frozen=True, eq=False)
class SizePosterior:
    """A standard deviation that is not known: sizes (G,), increasing, and their probabilities (G,)."""

    sizes: np.ndarray
    weights: np.ndarray

    @property
    def rms(self) -> float:
        """Root of the mean square size: standard deviation of the next throw's deviation."""
        return float(np.sqrt(self.weights @ self.sizes**2))


def prior_of(prior: SizePrior) -> SizePosterior:
    """Return a prior as sizes and probabilities."""
    return size_posterior(prior, np.zeros((0, 1)), np.zeros((0, 1)))


def size_posterior(prior: SizePrior, values: np.ndarray, errors: np.ndarray) -> SizePosterior:
    """Return what deviations about an unknown mean teach about their standard deviation.

    Parameters
    ----------
    values, errors
        (N, J) deviations, NaN where not measured, and the standard errors of their measurement; every column
        has the same standard deviation.
    """
    sizes = prior.median * np.exp(np.log(prior.factor) * GRID)
    log_weight = -0.5 * GRID**2
    for column, error in zip(values.T, errors.T, strict=True):
        known = np.isfinite(column)
        if not known.any():
            continue
        precision = 1.0 / (sizes[:, None] ** 2 + error[known] ** 2)
        total = precision.sum(axis=1)
        mean = (precision @ column[known]) / total
        log_weight += 0.5 * np.log(precision).sum(axis=1)
        log_weight -= 0.5 * (precision * (column[known] - mean[:, None]) ** 2).sum(axis=1)
        log_weight -= 0.5 * np.log(total)
    weight = np.exp(log_weight - log_weight.max())
    return SizePosterior(sizes, weight / weight.sum())
