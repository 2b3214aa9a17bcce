"""One large error of the rig: the constant that explains what the priors would spread over all of them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from strandcast.alignment.fine_fit import Candidate, fitted
from strandcast.alignment.problem import ClockProblem, EventPair, Priors
from strandcast.rig.model import Rig

# Chosen; not sensitive: with one joint's zero 2° off, the right constant leaves a thousandth of the cost.
SURPRISING = 3.5  # standard deviations of a prior
FIRST_ZERO = 7  # of the fit's unknowns: after offset, drift, base (2) and stretch (3)
FREED = 100.0  # times as wide a prior: 0.1 rad, 0.1 m
EXPLAINS_SHARE = 0.2  # of the constants' squared deviations that may remain
WORSE_RESIDUAL = 1.2


def with_single_error(
    best: Candidate, rig: Rig, priors: Priors, events: tuple[EventPair, ...] = ()
) -> Candidate:
    """Return the fit with one constant of the rig free, if that explains implausible ones; else the same.

    A joint's zero that is 2° off looks, within narrow priors, like smaller errors of many constants. With the
    prior of the right one widened, the others return to what a careful lab leaves.
    """
    scales = priors.scales(rig)
    cost = _deviations(best, scales)
    if np.abs(cost).max() < SURPRISING:
        return best
    problem = ClockProblem.of(rig, best.path, best.covered, best.fit.offset_s(), priors, events)
    found, least = best, EXPLAINS_SHARE * float(cost @ cost)
    for constants in _constants(rig):
        wide = scales.copy()
        wide[constants] *= FREED
        candidate = fitted(replace(problem, scales=wide), best.shape_m)
        left = _deviations(candidate, wide)
        if candidate.residual_m < WORSE_RESIDUAL * best.residual_m and left @ left < least:
            found, least = candidate, float(left @ left)
    return found


def _deviations(candidate: Candidate, scales: np.ndarray) -> np.ndarray:
    """Return the rig's constants (p - 2,) in standard deviations."""
    known = scales[2:] > 0
    return np.asarray(candidate.fit.rig_error.vector()[known] / scales[2:][known])


def _constants(rig: Rig) -> Iterator[slice]:
    """Yield the place of what can be wrong alone: base, a joint's zero, a link's length, a marker's place."""
    joints = len(rig.chain.lengths_m)
    shifts = FIRST_ZERO + 2 * joints
    yield slice(2, 4)
    yield from (slice(k, k + 1) for k in range(FIRST_ZERO, shifts))
    yield from (slice(k, k + 2) for k in range(shifts, shifts + 2 * len(rig.place_m), 2))
