"""A string in space, held at one end or both: some ten unknowns, fitted to series to predict others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import Array
from strandcast.estimation.cable_series import CableSeries
from strandcast.estimation.cable_space import CableSpace
from strandcast.estimation.descent import GaussNewtonModel, apart, descend, descent_batch
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective, simulate_throw
from strandcast.estimation.throws import PreparedThrow

# All chosen.
SCREENED, DESCENTS, EVALUATIONS, SEED = 64, 3, 500, 1
WINDOWS, WINDOW_S = 10, 4.0  # of motion that are fitted, at most
OVERLAP = 2.0  # times that each instant is in a window, at most, on average
LONGEST_WINDOWS = 8  # of series whose shape is not seen: from their beginning, the same time in all
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
SCREENING_FRAMES = 60  # of each series


@dataclass(frozen=True, eq=False)
class CableFit:
    """A fitted cable.

    Attributes
    ----------
    objective, log
        The function that was minimised, and all candidates that were tried after the screening.
    """

    objective: FitObjective
    log: EvaluationLog

    @property
    def model(self) -> StringModel:
        """Return the string model."""
        return self.objective.model

    @property
    def space(self) -> CableSpace:
        """Return the box of the unknowns."""
        assert isinstance(self.objective.space, CableSpace)
        return self.objective.space

    @property
    def chi(self) -> Array:
        """Return the best exponents (d,)."""
        return self.log.best()[0]

    @property
    def value_m(self) -> float:
        """Return the value of the fit [m]."""
        return self.log.best()[1]

    def values(self) -> dict[str, float]:
        """Return the unknowns by name."""
        found = self.space.values(self.chi)
        return {name: float(value) for name, value in zip(self.space.names, found, strict=True)}

    def predict(self, series: CableSeries) -> Array:
        """Return all markers (F, m, 3) [m] of a series, open loop from its start."""
        return predicted(self.model, self.space, self.chi, series)


def predicted(model: StringModel, space: CableSpace, chi: Array, series: CableSeries) -> Array:
    """Return all markers (F, m, 3) [m] of a series under one string, open loop from its start."""
    whole = series.prepared(0, len(series.time_s), model.points)
    markers, _ = simulate_throw(model, whole, space.strings(chi))
    return np.asarray(markers[0, :, 1:])


def fit_cable(
    series: list[CableSeries],
    model: StringModel,
    space: CableSpace,
    *,
    evaluations: int = EVALUATIONS,
    seed: int = SEED,
    previous: Array | None = None,
    report: Callable[[int, float], None] = lambda count, best: None,
) -> CableFit:
    """Fit a cable to series: screening, then descents from the best that are apart from each other.

    With friction that sticks, a cable without is fitted before, and one more descent starts from it: two
    unknowns more make the search miss what it finds without them.

    Parameters
    ----------
    series
        The motions to fit.
    model, space
        See `strandcast.estimation.cable_space.space_of_cable`.
    evaluations
        Strings to simulate in the descents.
    seed
        Of the strings that are screened.
    previous
        (d,) exponents of an earlier fit, from which one more descent starts.
    report
        See `EvaluationLog`.
    """
    throws = tuple(windows(series, model.points))
    shares = np.full(len(throws), 1.0 / len(throws))
    objective = FitObjective(model, space, throws, shares, 0.0, "world", True)
    # Single precision is micrometres away, at two thirds of the time.
    searched = replace(objective, model=replace(model, precision="f32"))
    log = EvaluationLog(searched.cost, report)
    # Turns and curls start near zero, where clamps and cables are made to be.
    draw = qmc.Sobol(space.dimension, rng=np.random.default_rng(seed)).random(SCREENED)
    linear = space.is_linear()
    draw[:, linear] = space.exponents(np.where(linear, 0.0, 1.0))[linear]
    values = EvaluationLog(searched.thinned(SCREENING_FRAMES).cost)(draw)
    starts = draw[apart(draw, values, DESCENTS)]
    if previous is not None:
        starts = np.vstack([starts, previous])
    plain = space.without_friction()
    if plain.dimension < space.dimension:
        before = fit_cable(series, model, plain, evaluations=evaluations, seed=seed)
        starts = np.vstack([starts, space.with_least_friction(plain, before.chi)])
    descents = descent_batch(starts, log(starts))
    done = descend(log, GaussNewtonModel(searched), descents, evaluations)
    log.converged = bool(done.done.all())
    log.count += SCREENED
    return CableFit(objective, log)


def fit_by_roll(
    series: list[dict[str, CableSeries]], fit: Callable[[list[CableSeries]], CableFit]
) -> tuple[str, CableFit]:
    """Return the roll of the driven ends with which `fit` explains all series best, and that fit."""
    rolls = [roll for roll in series[0] if all(roll in each for each in series)]
    fits = {roll: fit([each[roll] for each in series]) for roll in rolls}
    best = min(fits, key=lambda roll: fits[roll].value_m)
    return best, fits[best]


def windows(series: list[CableSeries], points: int) -> list[PreparedThrow]:
    """Return parts of the series to fit, for strings of n = `points`, `WINDOWS` times `WINDOW_S` in all.

    Where the markers show the string's shape, parts of `WINDOW_S` evenly over series and time: over many
    seconds, errors of wild motions grow until they say nothing about the cable. Elsewhere only the beginning
    of a series is known well enough to start from.
    """
    if not all(each.shape_is_seen() for each in series):
        chosen = [series[k * len(series) // LONGEST_WINDOWS] for k in range(LONGEST_WINDOWS)]
        chosen = chosen if len(series) > LONGEST_WINDOWS else series
        span_s = WINDOWS * WINDOW_S / len(chosen)
        return [each.prepared(0, _frames(each, span_s), points) for each in chosen]
    recorded_s = sum(float(each.time_s[-1] - each.time_s[0]) for each in series)
    count = min(WINDOWS, max(round(OVERLAP * recorded_s / WINDOW_S), len(series)))
    parts: dict[tuple[int, int], PreparedThrow] = {}
    for k in range(count):
        row = k * len(series) // count if len(series) >= count else k % len(series)
        each = series[row]
        frames = _frames(each, WINDOW_S)
        first = int(_GOLDEN * k % 1.0 * max(len(each.time_s) - frames, 0))
        seen = each.reliable()[first : first + frames].sum(axis=1)
        first += int(np.argmax(seen)) if len(each.time_s) > frames else 0
        parts[row, first] = each.prepared(first, min(first + frames, len(each.time_s)), points)
    return list(parts.values())


def _frames(series: CableSeries, span_s: float) -> int:
    return min(round(span_s / float(np.median(np.diff(series.time_s)))) + 1, len(series.time_s))
