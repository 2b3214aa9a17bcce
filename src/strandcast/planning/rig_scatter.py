"""How much throws differ on a rig: a prior for each standard deviation, and what the trials teach about it.

The logarithm of a standard deviation is normal before any throw. A trial's deviations are normal with that
standard deviation and the known error of their measurement. They scatter about the mean of the trials, which
is unknown: the zero of a length or of a joint is only a number in a file, and the string at rest is only the
model's. A rate of turning is about zero. The posterior is computed on a grid.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from strandcast.config.plan import PlanSettings
from strandcast.core.disturbances import DISTURBING, TYPICAL_SIZES
from strandcast.records.motion import RigScatter

UNITS = {
    "grasp_angle_rad": "rad",
    "grasp_length_m": "m",
    "sway_rad": "rad",
    "sway_rad_s": "rad/s",
    "joint_zero_rad": "rad",
    "servo_gain": "1",
    "servo_lag_s": "s",
}
ABOUT_ZERO = ("sway_rad_s",)  # the others scatter about their mean over the trials
GRID = np.linspace(-6.0, 6.0, 241)  # logarithms of size / median, in the prior's standard deviations
INTERVAL = (0.05, 0.95)
FAR_SD = 4.0  # a deviation this far out is no scatter; chosen
DRIFT_TRIALS, DRIFT_SD = 4, 3.0  # least trials, and standard errors of a slope that is called a drift; chosen


class SizePrior(NamedTuple):
    """A standard deviation before any throw: its logarithm is normal, two in three within the factor."""

    median: float
    factor: float


class TrialDeviations(NamedTuple):
    """What one trial shows of the rig: by quantity, values (1,) or (J,) and their standard errors.

    A value that was not measured is NaN.
    """

    trial: int
    values: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class SizePosterior:
    """A standard deviation that is not known: sizes (G,), increasing, and their probabilities (G,)."""

    sizes: np.ndarray
    weights: np.ndarray

    def quantile(self, share: float | np.ndarray) -> np.ndarray:
        """Return the size that is exceeded with probability 1 - share."""
        below = np.cumsum(self.weights) - 0.5 * self.weights
        return np.asarray(np.exp(np.interp(share, below, np.log(self.sizes))))

    @property
    def rms(self) -> float:
        """Root of the mean square size: standard deviation of the next throw's deviation."""
        return float(np.sqrt(self.weights @ self.sizes**2))


@dataclass(frozen=True, eq=False)
class LearntSize:
    """A quantity of a rig: its prior, the trials that show it, and its standard deviation.

    ``values`` and ``errors`` (N, 1 or J) are those of `trials`.
    """

    quantity: str
    prior: SizePrior
    trials: list[int]
    values: np.ndarray
    errors: np.ndarray
    posterior: SizePosterior

    @property
    def about(self) -> np.ndarray:
        """The values about which they scatter: (1 or J,)."""
        columns = self.values.shape[1]
        if self.quantity in ABOUT_ZERO or not len(self.values):
            return np.zeros(columns)
        return np.array(
            [np.median(one[~np.isnan(one)]) if (~np.isnan(one)).any() else 0.0 for one in self.values.T]
        )

    def warnings(self) -> list[str]:
        """Return what is no scatter: a value far outside the prior, or a drift from trial to trial."""
        found = []
        usual = prior_of(self.prior).rms
        away = np.abs(self.values - self.about) / np.hypot(usual, np.nan_to_num(self.errors))
        for trial, far in zip(self.trials, np.nan_to_num(away).max(axis=1, initial=0.0), strict=True):
            if far > FAR_SD:
                found.append(
                    f"{self.quantity}: trial {trial} is {far:.0f} standard deviations of the prior away"
                )
        for joint, column in enumerate(self.values.T, start=1):
            known = np.isfinite(column)
            if known.sum() >= DRIFT_TRIALS and drifts(np.array(self.trials)[known], column[known]):
                where = f", joint {joint}" if self.values.shape[1] > 1 else ""
                found.append(f"{self.quantity}{where}: drifts from trial to trial")
        return found

    def to_record(self) -> RigScatter:
        """Return it as a part of a record."""
        low, median, high = self.posterior.quantile(np.array([INTERVAL[0], 0.5, INTERVAL[1]])).tolist()
        return RigScatter(
            quantity=self.quantity,
            unit=UNITS[self.quantity],
            prior_median=self.prior.median,
            prior_factor=self.prior.factor,
            measured=dict(zip(self.trials, map(_known, self.values), strict=True)),
            errors=dict(zip(self.trials, map(_known, self.errors), strict=True)),
            median=median,
            low=low,
            high=high,
            warnings=self.warnings(),
        )


def _known(values: np.ndarray) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def learnt_sizes(settings: PlanSettings, seen: Sequence[TrialDeviations]) -> list[LearntSize]:
    """Return every quantity of a rig with what the trials teach about it."""
    return [_learnt(name, SizePrior(*getattr(settings.scatter, name)), seen) for name in UNITS]


def _learnt(name: str, prior: SizePrior, seen: Sequence[TrialDeviations]) -> LearntSize:
    with_it = [one for one in seen if np.isfinite(one.values.get(name, np.array([np.nan]))).any()]
    values, errors = (
        np.array([found[name] for found in columns]) if columns else np.zeros((0, 1))
        for columns in ([one.values for one in with_it], [one.errors for one in with_it])
    )
    return LearntSize(
        name,
        prior,
        [one.trial for one in with_it],
        values,
        errors,
        size_posterior(prior, values, errors, about_mean=name not in ABOUT_ZERO),
    )


def prior_of(prior: SizePrior) -> SizePosterior:
    """Return a prior as sizes and probabilities."""
    return size_posterior(prior, np.zeros((0, 1)), np.zeros((0, 1)), about_mean=False)


def size_posterior(
    prior: SizePrior, values: np.ndarray, errors: np.ndarray, *, about_mean: bool
) -> SizePosterior:
    """Return what deviations teach about their standard deviation.

    Parameters
    ----------
    values, errors
        (N, J) deviations, NaN where not measured, and the standard errors of their measurement; every column
        has the same standard deviation.
    about_mean
        Whether each column scatters about an unknown mean instead of zero.
    """
    sizes = prior.median * np.exp(np.log(prior.factor) * GRID)
    log_weight = -0.5 * GRID**2
    for column, error in zip(values.T, errors.T, strict=True):
        known = np.isfinite(column)
        if not known.any():
            continue
        precision = 1.0 / (sizes[:, None] ** 2 + error[known] ** 2)
        total = precision.sum(axis=1)
        mean = (precision @ column[known]) / total if about_mean else np.zeros(len(sizes))
        log_weight += 0.5 * np.log(precision).sum(axis=1)
        log_weight -= 0.5 * (precision * (column[known] - mean[:, None]) ** 2).sum(axis=1)
        if about_mean:
            log_weight -= 0.5 * np.log(total)
    weight = np.exp(log_weight - log_weight.max())
    return SizePosterior(sizes, weight / weight.sum())


def drawn_sizes(settings: PlanSettings, seen: Sequence[TrialDeviations]) -> np.ndarray:
    """Return sizes (M, 5) of the disturbances, in the order of `DISTURBING`.

    With ``disturbances: learnt`` one row for each string of the ensemble: every quantity has evenly spread
    quantiles of its posterior, in an order that differs from quantity to quantity (a Latin hypercube). The
    disturbances of all strings together then have the tails that not knowing the sizes gives them.
    """
    if settings.disturbances != "learnt":
        return settings.disturbances * TYPICAL_SIZES
    count = settings.ensemble
    shares = (np.arange(count) + 0.5) / count
    order = np.random.default_rng(0)  # the same order for every experiment
    known = {one.quantity: one.posterior for one in learnt_sizes(settings, seen)}
    columns = [order.permutation(_even_draws(known[name], shares)) for name in DISTURBING]
    return np.stack(columns, axis=1)


def _even_draws(posterior: SizePosterior, shares: np.ndarray) -> np.ndarray:
    """Return the quantiles, scaled so that few of them have the rms of all sizes."""
    draws = posterior.quantile(shares)
    return np.asarray(draws * posterior.rms / np.sqrt(np.mean(draws**2)))


def drifts(trials: np.ndarray, values: np.ndarray) -> bool:
    """Return whether values change with the number of their trial by more than their scatter explains."""
    since = trials - trials.mean()
    slope = (since @ values) / (since @ since)
    left = values - values.mean() - slope * since
    error = np.sqrt((left @ left) / (len(values) - 2) / (since @ since))
    return bool(abs(slope) > DRIFT_SD * error)
