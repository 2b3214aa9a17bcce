"""How often, how soon and how closely a method hits: hit rates with intervals, misses by trial.

A *run* is one experiment as the misses of its trials in order [m]: ``[0.081, None, 0.004]``. None stands for
a throw with unknown miss (the tip was not detected, or the trial was excluded); it counts as no hit. Runs may
differ in length: a run ends at its first hit, or where it failed; an empty run failed before its first throw.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from strandcast.core.shares import wilson

Run = Sequence[float | None]

RADII_M = (0.050, 0.020, 0.010, 0.005)


class HitRate(NamedTuple):
    """The share of `runs` within `radius_m` by `trial`, with its 95 % Wilson interval."""

    radius_m: float
    trial: int
    hits: int
    runs: int
    share: float | None  # None without runs
    low: float
    high: float


class MissStatistics(NamedTuple):
    """Statistics of the misses [m] of `known` throws (None without any), and the count of unknown misses."""

    trial: int
    known: int
    unknown: int
    median_m: float | None
    p90_m: float | None
    max_m: float | None


def nearest_m(run: Run, trial: int) -> float | None:
    """Return the least known miss of a run's first `trial` throws, or None."""
    return min((miss for miss in run[:trial] if miss is not None), default=None)


def hit_rate(runs: Iterable[Run], radius_m: float, trial: int) -> HitRate:
    """Return the rate of runs that came within a radius by a trial (in that one or before).

    A run that stopped at a hit within a larger radius is not continued, so for smaller radii the share is a
    lower bound.
    """
    near = [nearest_m(run, trial) for run in runs]
    hits = sum(miss is not None and miss <= radius_m for miss in near)
    share = hits / len(near) if near else None
    return HitRate(radius_m, trial, hits, len(near), share, *wilson(hits, len(near)))


def hit_rates(
    runs: Iterable[Run], radii_m: Sequence[float] = RADII_M, trials: Sequence[int] = (1, 2, 3)
) -> list[HitRate]:
    """Return the rates of every radius by every trial, radius by radius."""
    runs = list(runs)
    return [hit_rate(runs, radius_m, trial) for radius_m in radii_m for trial in trials]


def misses_at(runs: Iterable[Run], trial: int) -> MissStatistics:
    """Return the misses of the throws that were made at a trial.

    Runs that stopped earlier are not included: where runs stop at a hit, later trials come from the difficult
    runs only. `nearest_by` has no such selection.
    """
    made = [run[trial - 1] for run in runs if len(run) >= trial]
    return _spread(trial, made)


def nearest_by(runs: Iterable[Run], trial: int) -> MissStatistics:
    """Return the least misses of all runs up to a trial; a run that has hit keeps its hit."""
    return _spread(trial, [nearest_m(run, trial) for run in runs])


def _spread(trial: int, misses: Sequence[float | None]) -> MissStatistics:
    known = np.array([miss for miss in misses if miss is not None])
    if not len(known):
        return MissStatistics(trial, 0, len(misses), None, None, None)
    median, p90 = np.quantile(known, (0.5, 0.9))
    return MissStatistics(
        trial, len(known), len(misses) - len(known), float(median), float(p90), float(known.max())
    )
