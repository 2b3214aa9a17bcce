"""The best fit of all offsets at which log and video overlap."""

from dataclasses import replace

import numpy as np

from strandcast.alignment.coarse_search import (
    APART_S,
    LEAST_DETECTIONS,
    AlignmentData,
    candidate_offsets,
    shape_change_m,
)
from strandcast.alignment.diagnosis import diagnose
from strandcast.alignment.fine_fit import SHIFT_S, Candidate, fitted
from strandcast.alignment.problem import ClockProblem, EventPair, Priors
from strandcast.errors import StrandcastError
from strandcast.rig.model import Rig

# Chosen.
LARGEST_RESIDUAL_M = 0.005
LARGEST_COARSE_M = 0.05
RIVAL_RATIO = 1.5
SURPRISE = 4.0  # standard deviations of a fitted drift about its prior's mean
LEAST_SPREAD = 0.05  # of the prior's standard deviation, where the motion hardly determines the drift; chosen
ANY_DRIFT = 0.05
FREED_FROM_M = 0.0003  # a rate wrong by 1 % can leave half a millimetre; lab throws leave less than 0.1 mm
FREED_SHARE = 0.7  # of the residual: a free drift must leave less
LEAST_SHARE = 0.5  # of the path in the video that a rival must explain


def best_fit(data: AlignmentData, priors: Priors) -> Candidate:
    """Return the best fit of all offsets.

    It is refused if no offset covers the detections, none fits (with the mistake that explains it), or two
    fit alike.
    """
    offsets, coarse_m = candidate_offsets(data)
    if coarse_m[0] > LARGEST_COARSE_M:
        raise diagnose(data, float(coarse_m[0]))
    near = offsets[coarse_m <= max(3.0 * coarse_m[0], 0.01)]
    fits = [found for offset_s in near if (found := _fitted(data, float(offset_s), priors)) is not None]
    if not fits:
        raise StrandcastError(
            "SC-A007",
            f"fewer than {LEAST_DETECTIONS} detections of the hand's markers lie within the joint log's time",
            file=data.log_file,
        )
    # Where log and video hardly overlap, the hand rests in both, and anything fits.
    shares = [float(found.covered.speed_m_s().sum()) for found in fits]
    fits = [found for found, share in zip(fits, shares, strict=True) if share >= LEAST_SHARE * max(shares)]
    fits.sort(key=lambda found: found.residual_m)
    if fits[0].residual_m > LARGEST_RESIDUAL_M:
        raise diagnose(data, fits[0].residual_m)
    _refuse_rivals(fits)
    return fits[0]


def fit_with_events(best: Candidate, rig: Rig, priors: Priors, events: tuple[EventPair, ...]) -> Candidate:
    """Return the fit with events on both clocks added."""
    start_s = best.fit.offset_s() if best.determined else events[0].robot_s - events[0].camera_s
    return fitted(ClockProblem.of(rig, best.path, best.covered, start_s, priors, events), best.shape_m)


def _fitted(data: AlignmentData, offset_s: float, priors: Priors) -> Candidate | None:
    """Fit from one offset; with any drift, if the expected one does not fit."""
    problem = data.problem(offset_s, priors)
    if problem is None:
        return None
    shape_m = shape_change_m(data.rig, data.rows, problem.detections, offset_s, SHIFT_S)
    found = fitted(problem, shape_m)
    # The prior has pulled the fitted drift: about the prior's mean it varies by less than the prior.
    spread = np.sqrt(max(priors.drift**2 - found.fit.drift_se**2, (LEAST_SPREAD * priors.drift) ** 2))
    surprise = abs(found.fit.drift - priors.known_drift) > SURPRISE * spread
    if priors.drift < ANY_DRIFT and (surprise or found.residual_m > FREED_FROM_M):
        freed = fitted(problem.with_priors(replace(priors, drift=ANY_DRIFT)), shape_m)
        if freed.residual_m < FREED_SHARE * found.residual_m or surprise:
            return freed
    return found


def _refuse_rivals(fits: list[Candidate]) -> None:
    best = fits[0]
    for rival in fits[1:] if best.determined else ():
        apart_s = abs(rival.fit.offset_s() - best.fit.offset_s())
        if apart_s > APART_S and rival.residual_m < RIVAL_RATIO * best.residual_m:
            raise StrandcastError(
                "SC-A008",
                f"two offsets, {best.fit.offset_s():.3f} and {rival.fit.offset_s():.3f} s, fit alike "
                f"({best.residual_m * 1e3:.1f} and {rival.residual_m * 1e3:.1f} mm): the motion repeats"
                " itself",
                field="align.largest_offset_s",
                fix="play a motion that does not repeat itself, or lower this limit",
            )
