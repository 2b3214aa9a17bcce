"""A string in space, held at one end or both: some ten unknowns, fitted to series to predict others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import Array
from strandcast.estimation.cable_series import CableSeries
from strandcast.estimation.cable_space import POINTS, CableSpace
from strandcast.estimation.descent import GaussNewtonModel, apart, descend, descent_batch
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective, simulate_throw
from strandcast.estimation.throws import PreparedThrow

# All chosen.
SCREENED, DESCENTS, SEED = 64, 3, 1
TOGETHER = 8  # steps of all descents, before the best one goes on alone
EVALUATIONS = 6000  # a bound: captures converge earlier
THROWN_EVALUATIONS = 500  # between two throws of an arm there is less time
WINDOWS, WINDOW_S = 10, 4.0  # of motion that are fitted, at most
OVERLAP = 2.0  # times that each instant is in a window, at most, on average
# Series whose shape is not seen: how many are fitted, for how long each, and a single one.
LONG_WINDOWS, LONG_WINDOW_S, LONGEST_WINDOW_S = 8, 20.0, 40.0
REST_EVERY_S = 0.5  # where a window may begin
NEARLY_MOST = 0.95  # of the motion that a window can have: of such, the first, which has more of the rest
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
    """Fit a cable to series: screening, descents from the best that are apart, and the best one's to its end.

    With friction that sticks, a cable without is fitted before, and one more descent starts from it: two
    unknowns more make the search miss what it finds without them.

    Parameters
    ----------
    series
        The motions to fit.
    model, space
        See `strandcast.estimation.cable_space.space_of_cable`.
    evaluations
        Strings to simulate in the descents at most.
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
    slopes = GaussNewtonModel(searched)
    descents = descend(log, slopes, descent_batch(starts, log(starts)), evaluations, TOGETHER)
    best = descents.pick(np.array([np.argmin(descents.value)]))
    log.converged = bool(descend(log, slopes, best, evaluations - log.count).done.all())
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
    """Return the parts of the series that are fitted, for strings of n = `points`; see `parts_to_fit`."""
    return [series[row].prepared(first, last, points) for row, first, last in parts_to_fit(series)]


def parts_to_fit(series: list[CableSeries]) -> list[tuple[int, int, int]]:
    """Return series, first frame and frame after the last of each part that is fitted.

    Where the markers show the string's shape, up to `WINDOWS` parts of `WINDOW_S`, spread over the series,
    over time and over motion: over many seconds, errors of wild motions grow until they say nothing about
    the cable. Elsewhere one long part of each of up to `LONG_WINDOWS` series, from where a start is known.
    """
    if not all(each.shape_is_seen() for each in series):
        count = min(len(series), LONG_WINDOWS)
        span_s = max(LONGEST_WINDOW_S / count, LONG_WINDOW_S)
        rows = [k * len(series) // count for k in range(count)]
        return [(row, *_long_part(series[row], span_s)) for row in rows]
    recorded_s = sum(float(each.time_s[-1] - each.time_s[0]) for each in series)
    count = min(WINDOWS, max(round(OVERLAP * recorded_s / WINDOW_S), len(series)))
    parts = []
    for k in range(count):
        row = k * len(series) // count if len(series) >= count else k % len(series)
        each = series[row]
        frames = _frames(each, WINDOW_S)
        first = _at_share(each.motion_m(frames), _GOLDEN * k % 1.0)
        seen = each.reliable()[first : first + frames].sum(axis=1)
        first += int(np.argmax(seen)) if len(each.time_s) > frames else 0
        parts.append((row, first, min(first + frames, len(each.time_s))))
    return list(dict.fromkeys(parts))


def frames_fitted(series: list[CableSeries]) -> list[np.ndarray]:
    """Return which frames (F,) of each series are in a part that is fitted."""
    fitted = [np.zeros(len(each.time_s), dtype=bool) for each in series]
    for row, first, last in parts_to_fit(series):
        fitted[row][first:last] = True
    return fitted


def _at_share(motion_m: Array, share: float) -> int:
    """Return the window at a share, 0 to 1, of all: half by their number, half by their motion (W,)."""
    weight = 1.0 / len(motion_m) + motion_m / max(motion_m.sum(), 1e-12)
    return int(np.searchsorted(np.cumsum(weight), share * weight.sum()))


def _long_part(series: CableSeries, span_s: float) -> tuple[int, int]:
    """Return the part of a series with the most motion of those that begin at rest, or with the series."""
    frames = _frames(series, span_s)
    motion_m = series.motion_m(frames)
    every = _frames(series, REST_EVERY_S) - 1
    begins = [k for k in range(0, len(motion_m), every) if k == 0 or series.start(k, POINTS).settle]
    moved_m = motion_m[begins]
    first = begins[int(np.argmax(moved_m >= NEARLY_MOST * moved_m.max()))]
    return first, first + frames


def _frames(series: CableSeries, span_s: float) -> int:
    return min(round(span_s / float(np.median(np.diff(series.time_s)))) + 1, len(series.time_s))
