"""Uncertainty of a fit: Fisher information, correlations, profile intervals, and the gauge.

Two answers to "how well is this number known?": the Fisher information approximates E by a parabola and the
residuals by noise; a profile moves one unknown and refits all others.
"""

from dataclasses import dataclass

import numpy as np

from strandcast.core.strings import PARAMETERS, PLAIN_MASS, UNKNOWNS
from strandcast.estimation.descent import STEP, GaussNewtonModel, descend, descent_batch
from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.space import DEVIATION_COSTS_M, Space

FLAT = np.sqrt(1.0 / 12.0)  # standard deviation of a uniform distribution over the range of an exponent
# Relative rise of E within which a string explains the throw as well. With 10 % the intervals of 48 of 56
# weights hold the mass that the lab threw, with 4 % of 40 (docs/explanation/claims.md).
RISE = 0.10
REACHES = np.array([-2.5, -1.0, -0.5, 0.5, 1.0, 2.5])  # in widths expected from the parabola
PROFILE_ROUNDS = 2
# Of profiles that are read as intervals: rounds, and shares of the way to the bound, where E has not risen by
# `RISE` before.
LONG_ROUNDS, FARTHER = 6, (0.1, 0.4, 1.0)
RIGID = 1e6  # precision that fixes a direction


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How well each of the d unknowns is known, in its exponent; times `decades` in powers of ten.

    Attributes
    ----------
    decades
        (d,) width of the range in decades; NaN for unknowns that may be negative.
    conditional, marginal
        (d,) standard deviations with all others known, and with none known but their ranges.
    correlation
        (d, d) of the marginal law.
    noise_m
        Standard deviation of a coordinate of the residuals [m].
    per_datum
        Number of measurements that count as one: errors of neighbouring frames and points are correlated.
    gauge_fixed
        Whether the common scale of masses and coefficients, which no throw can reveal, is fixed by the plain
        points' mass of 1. If not, the deviations are those at a fixed scale.
    low, high
        (d,) profile interval: from the least to the greatest exponent at which the best E of all others is
        at most `RISE` above the best, as far as known; NaN where no profile was made.
    open_low, open_high
        (d,) whether the interval extends beyond the given ends: to the bound of the range or beyond what
        was tried.
    """

    decades: Array
    conditional: Array
    marginal: Array
    correlation: Array
    noise_m: float
    per_datum: float
    gauge_fixed: bool
    low: Array
    high: Array
    open_low: np.ndarray
    open_high: np.ndarray


def decades_of(space: Space) -> Array:
    """Return (d,) widths of the ranges in decades, NaN for unknowns that may be zero or negative."""
    low, high = space.bounds.T
    linear = space.is_linear()
    return np.where(linear, np.nan, np.log10(np.where(linear, 1.0, high / np.where(linear, 1.0, low))))


def gauge_direction(space: Space) -> Array | None:
    """Direction (d,) of the exponents that scales all masses and coefficients; None if 1 is a plain mass."""
    if PLAIN_MASS not in space.names:
        return None
    per_mass = [name for name, row in UNKNOWNS.items() if row.unit.endswith("/kg")]
    scaled = (*PARAMETERS, PLAIN_MASS, *per_mass)
    is_scaled = [name in scaled or name.startswith("weight_") for name in space.names]
    direction = np.where(is_scaled, 1.0 / np.nan_to_num(decades_of(space), nan=np.inf), 0.0)
    return np.asarray(direction / np.linalg.norm(direction))


def fisher(objective: FitObjective, chi: Array, log: EvaluationLog) -> tuple[Array, float, float]:
    """Fisher information at `chi` (d,), from the spread and the correlation of the residuals.

    Returns
    -------
    information
        (d, d), priors included.
    noise_m
        Standard deviation of a coordinate [m].
    per_datum
        Number of measurements that count as one.
    """
    d = len(chi)
    step = np.where(chi > 0.5, -STEP, STEP)
    difference, weight = objective.residuals(np.vstack([chi, chi + np.diag(step)]))
    log.count += d + 1
    slope = (difference[1:] - difference[0]) / step[:, None, None]
    share = weight / weight.mean()
    noise = float((share[:, None] * difference[0] ** 2).sum() / max(difference.shape[-1] * len(share) - d, 1))
    per_datum = correlated_count(objective, difference[0])
    information = np.einsum("r,irc,jrc->ij", share, slope, slope) / (max(noise, 1e-12) * per_datum)
    space = objective.space
    width = (space.bounds[:, 1] - space.bounds[:, 0]) / space.prior_sd
    return information + np.diag(width**2), float(np.sqrt(noise)), per_datum


def correlated_count(objective: FitObjective, residual_m: Array) -> float:
    """Return how many measurements count as one: variance of their mean over that of independent ones.

    The residuals (R, 2 or 3) of one point are correlated in time: summed up to the correlation's first zero.
    Neighbouring points are taken to be correlated, too.
    """
    begun, sums = 0, []
    for throw in objective.throws:
        used = throw.weight > 0
        shaped = np.zeros((*used.shape, residual_m.shape[-1]))
        shaped[used] = residual_m[begun : begun + used.sum()]
        begun += int(used.sum())
        sums.append(_correlated_in_time(shaped) * _correlated_along_string(shaped))
    return float(np.mean(sums))


def _correlated_in_time(residual_m: Array) -> float:
    frames = len(residual_m)
    power = (residual_m**2).sum()
    total = 1.0
    for lag in range(1, frames // 2):
        alike = (residual_m[lag:] * residual_m[:-lag]).sum() / max(power, 1e-30)
        if alike <= 0.0:
            break
        total += 2.0 * alike
    return total


def _correlated_along_string(residual_m: Array) -> float:
    series = residual_m.transpose(1, 0, 2).reshape(residual_m.shape[1], -1)
    together = series @ series.T
    return float(max(together.sum() / max(np.trace(together), 1e-30), 1.0))


def uncertainty_of(
    objective: FitObjective, log: EvaluationLog, *, profiles: bool, long: bool = False
) -> Uncertainty:
    """Return the uncertainty of the best string of a log.

    `long`: profiles go on to the bounds where E has not risen before, and are fitted with more steps.
    Profiles cost simulations; a better string that they find is in the log afterwards.
    """
    space = objective.space
    information, noise_m, per_datum = fisher(objective, log.best()[0], log)
    gauge = gauge_direction(space)
    rigid = np.zeros_like(information) if gauge is None else RIGID * np.outer(gauge, gauge)
    covariance = np.linalg.inv(information + rigid + np.eye(len(information)) / FLAT**2)
    marginal = np.sqrt(np.diag(covariance))
    conditional = 1.0 / np.sqrt(np.diag(information) + 1.0 / FLAT**2)
    nothing = np.full(space.dimension, np.nan)
    interval = nothing, nothing, nothing > 0, nothing > 0
    if profiles:
        interval = _profiles(objective, log, long=long)
    return Uncertainty(
        decades_of(space),
        conditional,
        marginal,
        covariance / np.outer(marginal, marginal),
        noise_m,
        per_datum,
        gauge is None,
        *interval,
    )


def _profiles(
    objective: FitObjective, log: EvaluationLog, *, long: bool
) -> tuple[Array, Array, np.ndarray, np.ndarray]:
    """Return the ends of all unknowns' profile intervals and whether they are open, each (d,)."""
    slope = GaussNewtonModel(objective)
    best, value = log.best()
    d = len(best)
    _, curvature = slope(best[None])
    log.count += d + 1
    tried = _tried(best, value, curvature[0])  # (d, G)
    row = np.repeat(np.arange(d), tried.shape[1])
    start = np.clip(_along(best, curvature[0], tried), 0.0, 1.0).reshape(-1, d)
    rounds = LONG_ROUNDS if long else PROFILE_ROUNDS
    chi, cost = _refitted(log, slope, row, start, rounds)
    for share in FARTHER if long else ():
        more, start = _farther(row, chi, cost <= (1.0 + RISE) * log.best()[1], share)
        if not len(more):
            break
        further = more, *_refitted(log, slope, more, start, rounds)
        row, chi, cost = (np.concatenate(pair) for pair in zip((row, chi, cost), further, strict=True))
    rise = cost / log.best()[1] - 1.0
    ends = [_ends(best[k], chi[row == k, k], rise[row == k]) for k in range(d)]
    low, high, open_low, open_high = (np.array(column) for column in zip(*ends, strict=True))
    least, greatest = near_range(log)
    open_low, open_high = open_low | (least <= 0.0), open_high | (greatest >= 1.0)
    return np.minimum(low, least), np.maximum(high, greatest), open_low, open_high


def _refitted(
    log: EvaluationLog, slope: GaussNewtonModel, row: np.ndarray, start: Array, rounds: int
) -> tuple[Array, Array]:
    """Return strings (K, d) fitted from starts (K, d) with one unknown each held, and their cost."""
    held = np.eye(start.shape[1], dtype=bool)[row]
    now = descent_batch(start, log(start), held)
    now = descend(log, slope, now, len(start) * 32 * rounds, rounds)
    return now.chi, now.value


def _farther(row: np.ndarray, chi: Array, allowed: np.ndarray, share: float) -> tuple[np.ndarray, Array]:
    """Return unknowns to move farther (K,), and starts (K, d), where the outermost strings are `allowed`."""
    rows, starts = [], []
    for k in range(chi.shape[1]):
        own = np.flatnonzero(row == k)
        for outermost, bound in ((own[chi[own, k].argmin()], 0.0), (own[chi[own, k].argmax()], 1.0)):
            if allowed[outermost] and chi[outermost, k] != bound:
                rows.append(k)
                starts.append(chi[outermost].copy())
                starts[-1][k] += share * (bound - chi[outermost, k])
    return np.array(rows, dtype=int), np.reshape(starts, (-1, chi.shape[1]))


def near_range(log: EvaluationLog, rise: float = RISE) -> tuple[Array, Array]:
    """Return the least and the greatest exponents (d,) of strings with E within `rise` of the best.

    A profile follows one valley; the search has been in others, too.
    """
    chi, values = log.all()
    near = chi[values <= (1.0 + rise) * log.best()[1]]
    return near.min(axis=0), near.max(axis=0)


def _tried(best: Array, value: float, curvature: Array) -> Array:
    """(d, G) exponents to try for each unknown: where a parabola predicts the ends of the interval."""
    reach = np.minimum(reach_of(curvature, value), FLAT)
    return np.asarray(np.clip(best[:, None] + reach[:, None] * REACHES, 0.0, 1.0))


def reach_of(curvature: Array, value: float) -> Array:
    """Return how far each exponent moves (d,) while E rises from `value` by `RISE`: `curvature` is (d, d)."""
    allowed = 2.0 * RISE * value
    spread = np.diag(np.linalg.inv(curvature + np.eye(len(curvature)) * allowed / FLAT**2))
    return np.asarray(np.sqrt(allowed * spread))


def _along(best: Array, curvature: Array, tried: Array) -> Array:
    """(d, G, d) points along the valley: the others go with the unknown that is moved."""
    d = len(best)
    covariance = np.linalg.inv(curvature + np.eye(d) * (1e-6 * np.trace(curvature) / d + DEVIATION_COSTS_M))
    with_it = covariance / np.diag(covariance)[:, None]
    return np.asarray(best + (tried - best[:, None])[..., None] * with_it[:, None, :])


def _ends(best: float, tried: Array, rise: Array) -> tuple[float, float, bool, bool]:
    """Return where the rise crosses `RISE` on either side, and whether it stays below `RISE` there."""
    order = np.argsort(tried)
    tried, rise = tried[order], rise[order]
    low, open_low = _crossing(best, tried[tried < best][::-1], rise[tried < best][::-1])
    high, open_high = _crossing(best, tried[tried > best], rise[tried > best])
    return low, high, open_low, open_high


def _crossing(best: float, tried: Array, rise: Array) -> tuple[float, bool]:
    """Go outwards from the best; E rises about with the square, so its root is interpolated."""
    at, before = best, 0.0
    for chi, gain in zip(tried, rise, strict=True):
        now = np.sqrt(max(gain, 0.0))
        if gain > RISE:
            if not np.isfinite(now):
                return at, False
            return float(at + (chi - at) * (np.sqrt(RISE) - before) / (now - before)), False
        at, before = float(chi), now
    return float(at), True
