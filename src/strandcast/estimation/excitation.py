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
from strandcast.estimation.space import Space
from strandcast.estimation.throws import PreparedThrow
from strandcast.estimation.uncertainty import Uncertainty, decades_of, reach_of

# All chosen. A motion twice as wide or 1.6 times as fast determines as many unknowns, but whips light ends:
# a fit that takes it left an E of 7.6 to 84 mm on four captures, instead of 4.6 to 15 mm.
FACTOR, SHARE = 3.0, 0.15  # within which an unknown is determined; of the range, if it may be negative
WIDER, FASTER = 1.5, 1.3
ASIDE, ASIDE_S, SWINGS = 0.4, 0.3, 5  # of the length, and of the period of a swing; so many of these
STEP_S = 0.01


def undetermined(
    objective: FitObjective, newest: PreparedThrow, log: EvaluationLog, known: Uncertainty
) -> dict[str, str]:
    """Return unknowns that are not determined by their profiles, each with the motion that does it best.

    By the sensitivities of the fitted string to motions like that of the whole `newest` trial, which are
    expected to be fitted as well as the others.
    """
    chi, value = log.best()
    least = margins(objective.space)
    left = np.flatnonzero((chi - known.low > least) | (known.high - chi > least))
    found = {objective.space.names[k]: "" for k in left}
    if not len(left):
        return found
    _, present = GaussNewtonModel(objective, value)(chi[None])
    for name, hand in other_motions(newest.hand, newest.points_m.shape[2], objective.model.length_m):
        throw = _along(newest, hand)
        points_m, _ = simulate_throw(objective.model, throw, objective.space.strings(chi))
        other = replace(objective, throws=(replace(throw, points_m=points_m[0]),), shares=np.ones(1))
        _, added = GaussNewtonModel(other, value)(chi[None])
        reach = reach_of(0.5 * (present[0] + added[0]), value)
        for k in left[reach[left] < least[left]]:
            found[objective.space.names[k]], least[k] = name, reach[k]
    return found


def margins(space: Space) -> Array:
    """Return how far exponents (d,) may move from the best if their unknowns are determined."""
    return np.asarray(np.nan_to_num(np.log10(FACTOR) / decades_of(space), nan=SHARE))


def other_motions(hand: HandPath, axes: int, length_m: float) -> Iterator[tuple[str, HandPath]]:
    """Yield motions to record beside one, by name; poses (T, …) begin with a place of so many axes."""
    time_s, pose = hand.time_s - hand.time_s[0], hand.pose
    if pose.shape[1] <= POSE:
        wide = pose.copy()
        wide[:, :axes] += (WIDER - 1.0) * (pose[:, :axes] - pose[0, :axes])
        yield "a wider motion", HandPath(time_s, wide)
        period_s = 2.0 * np.pi * np.sqrt(length_m / GRAVITY_M_S2)
        swing_s = np.arange(0.0, SWINGS * period_s, STEP_S)
        share = np.clip(swing_s / (ASIDE_S * period_s), 0.0, 1.0)
        aside = np.repeat(pose[:1], len(swing_s), axis=0)
        aside[:, 0] += ASIDE * length_m * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        yield "a free swing", HandPath(swing_s, aside)
    yield "a faster motion", HandPath(time_s / FASTER, pose)


def _along(throw: PreparedThrow, hand: HandPath) -> PreparedThrow:
    """Return a throw along another path, with the same points seen in every frame."""
    seen = (throw.weight > 0.0).any(axis=0).astype(float)
    return PreparedThrow(
        np.arange(len(hand.time_s)),
        hand.time_s,
        np.zeros((len(hand.time_s), *throw.points_m.shape[1:])),
        np.tile(seen, (len(hand.time_s), 1)),
        hand,
        throw.start if hand.pose.shape[1] > POSE else HANGING_AT_REST,
        throw.places,
    )
