"""Which masses of weights explain recordings as well: many are tried, and all else is fitted again."""

from dataclasses import replace

import numpy as np

from strandcast.estimation.descent import GaussNewtonModel, descend, descent_batch
from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit import PAYS
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.uncertainty import Uncertainty, near_range

# All chosen.
STEPS = np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.7])  # of the range, to either side
SCANS = 3  # at most: where a better string was found, its mass is the middle of the next
ROUNDS = 6  # of a descent
# By which share of E a mass may be worse, and true: of eight fits to four real cables with a known weight,
# the worst takes 0.27. Real clamps and weights have other shapes (docs/explanation/string.md).
RISE = 0.3
ENDS = ("low", "high", "open_low", "open_high")


def with_masses(known: Uncertainty, objective: FitObjective, log: EvaluationLog) -> Uncertainty:
    """Return an uncertainty in which the intervals of weights are of all masses that explain the trials.

    A heavier end and a stiffer string move nearly alike, in many valleys of E: profiles that follow one find
    too little. A better string that is found is in the log afterwards.
    """
    rows = [k for k, name in enumerate(objective.space.names) if name.startswith("weight_")]
    if not rows:
        return known
    low, high, open_low, open_high = (getattr(known, name).copy() for name in ENDS)
    scans = {}
    for row in rows:
        before = np.inf
        for _ in range(SCANS):
            if log.best()[1] < PAYS * before:
                before = log.best()[1]
                scans[row] = _scan(objective, log, row)
    best, value = log.best()
    least, greatest = near_range(log, RISE)
    for row, (tried, cost) in scans.items():
        order = np.argsort(at := np.append(tried, best[row]))
        gain = np.append(cost, value)[order] / value - 1.0
        low[row] = min(_end(at[order][::-1], gain[::-1], RISE), least[row])
        high[row] = max(_end(at[order], gain, RISE), greatest[row])
        open_low[row], open_high[row] = low[row] <= 0.0, high[row] >= 1.0
    return replace(known, **dict(zip(ENDS, (low, high, open_low, open_high), strict=True)))


def _scan(objective: FitObjective, log: EvaluationLog, row: int) -> tuple[Array, Array]:
    """Return exponents (T,) of a mass, and the least costs with each (T,)."""
    best, space = log.best()[0], objective.space
    tried = np.unique(np.clip(best[row] + np.concatenate([-STEPS, STEPS]), 0.0, 1.0))
    moved = np.repeat(best[None], len(tried), axis=0)
    moved[:, row] = tried
    held = np.zeros_like(moved, dtype=bool)
    held[:, row] = True
    slopes = GaussNewtonModel(objective)
    found, value = moved, np.full(len(tried), np.inf)
    # As heavier strings move alike, and as only the weight is another; then as at the next masses.
    for starts in ((space.as_heavy(tried, best, row), moved), ()):
        for start in starts or (np.roll(found, 1, axis=0), np.roll(found, -1, axis=0)):
            chi = start.copy()
            chi[:, row] = tried
            now = descent_batch(chi, log(chi), held)
            now = descend(log, slopes, now, chi.size * ROUNDS * 32, ROUNDS)
            better = now.value < value
            found, value = np.where(better[:, None], now.chi, found), np.where(better, now.value, value)
    return tried, value


def _end(tried: Array, rise: Array, allowed: float) -> float:
    """Return where the rise passes what is allowed, going through exponents in order (T,)."""
    k = int(np.flatnonzero(rise <= allowed)[-1])
    if k == len(tried) - 1 or not np.isfinite(rise[k + 1]):
        return float(tried[k])
    a, b, c = (float(np.sqrt(max(value, 0.0))) for value in (rise[k], rise[k + 1], allowed))
    return float(tried[k] + (tried[k + 1] - tried[k]) * (c - a) / (b - a))
