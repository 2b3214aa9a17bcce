"""Which other motion would determine what the recordings leave open of a string."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from strandcast.dynamics.batch import HANGING_AT_REST, HandPath
from strandcast.dynamics.parameters import GRAVITY_M_S2
from strandcast.dynamics.spatial.clamps import POSE
from strandcast.estimation.descent import GaussNewtonModel
from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective, simulate_throw
from strandcast.estimation.throws import PreparedThrow
from strandcast.estimation.uncertainty import Uncertainty, reach_of

# All chosen.
OPEN, CLOSED = 0.5, 0.25  # widths of an interval, of the range of the exponent
WIDER, FASTER = 2.0, 1.6
ASIDE, ASIDE_S, SWINGS = 0.4, 0.3, 5  # of the length, and of the period of a swing; so many of these
STEP_S = 0.01


def undetermined(objective: FitObjective, log: EvaluationLog, known: Uncertainty) -> dict[str, str]:
    """Return unknowns that a fit leaves open by its profiles, each with the motion that determines it best.

    By the sensitivities of the fitted string to motions that were not recorded, which are expected to be
    fitted as well as the others.
    """
    chi, value = log.best()
    is_open = known.open_low | known.open_high | (known.high - known.low > OPEN)
    left = np.flatnonzero(is_open & np.isfinite(known.low))
    found = {objective.space.names[k]: "" for k in left}
    if not len(left):
        return found
    least = np.full(len(chi), CLOSED)
    _, present = GaussNewtonModel(objective, value)(chi[None])
    for name, throw in _motions(objective):
        points_m, _ = simulate_throw(objective.model, throw, objective.space.strings(chi))
        other = replace(objective, throws=(replace(throw, points_m=points_m[0]),), shares=np.ones(1))
        _, added = GaussNewtonModel(other, value)(chi[None])
        width = 2.0 * reach_of(0.5 * (present[0] + added[0]), value)
        for k in left[width[left] < least[left]]:
            found[objective.space.names[k]], least[k] = name, width[k]
    return found


def _motions(objective: FitObjective) -> Iterator[tuple[str, PreparedThrow]]:
    """Yield other motions as throws with the same points seen: wider, a free swing, faster."""
    throw, length_m = objective.throws[-1], objective.model.length_m
    time_s, pose = throw.hand.time_s - throw.hand.time_s[0], throw.hand.pose
    if pose.shape[1] <= POSE:
        axes = throw.points_m.shape[2]
        wide = pose.copy()
        wide[:, :axes] += (WIDER - 1.0) * (pose[:, :axes] - pose[0, :axes])
        yield "a wider motion", _along(throw, time_s, wide)
        period_s = 2.0 * np.pi * np.sqrt(length_m / GRAVITY_M_S2)
        swing_s = np.arange(0.0, SWINGS * period_s, STEP_S)
        share = np.clip(swing_s / (ASIDE_S * period_s), 0.0, 1.0)
        aside = np.repeat(pose[:1], len(swing_s), axis=0)
        aside[:, 0] += ASIDE * length_m * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        yield "a free swing", _along(throw, swing_s, aside)
    yield "a faster motion", _along(throw, time_s / FASTER, pose)


def _along(throw: PreparedThrow, time_s: Array, pose: Array) -> PreparedThrow:
    """Return a throw along another path, with the same points seen in every frame."""
    seen = (throw.weight > 0.0).any(axis=0).astype(float)
    return PreparedThrow(
        np.arange(len(time_s)),
        time_s,
        np.zeros((len(time_s), *throw.points_m.shape[1:])),
        np.tile(seen, (len(time_s), 1)),
        HandPath(time_s, pose),
        throw.start if pose.shape[1] > POSE else HANGING_AT_REST,
        throw.places,
    )
