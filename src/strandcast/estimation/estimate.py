"""Estimate the string from its trials so far, in the plane or in space."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import ForceName, StringBatch
from strandcast.dynamics.masses import MassLayout
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import simulate_batch
from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.estimation import cross_validation
from strandcast.estimation.cross_validation import without_model
from strandcast.estimation.descent import GaussNewtonModel
from strandcast.estimation.ensemble import near_samples
from strandcast.estimation.evaluation import Array, distances, tip_error
from strandcast.estimation.excitation import undetermined
from strandcast.estimation.fit import StringFit, fit_of
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective, simulate_throw
from strandcast.estimation.forces import kept_forces, with_forces_that_pay
from strandcast.estimation.masses import with_masses
from strandcast.estimation.measured import Throw, parts_of_throws
from strandcast.estimation.optimisers.optimiser import SearchStart
from strandcast.estimation.search import (
    CROSS_VALIDATION_SHARE,
    NEAR_SAMPLES,
    search,
    search_budget,
    search_in_wide_enough_ranges,
)
from strandcast.estimation.space import Space
from strandcast.estimation.throws import PreparedThrow, TrialParts
from strandcast.estimation.uncertainty import RISE, uncertainty_of
from strandcast.estimation.unknowns import forces_of, space_of
from strandcast.records.estimate import LAST_PART, TIP_UNDER_PREVIOUS, UNDER_PREVIOUS, ForceTried

Random = Callable[[], np.random.Generator]


@dataclass(frozen=True, eq=False)
class FoundString:
    """The end of a search: the roll of the driven ends, what was minimised, all candidates, tried forces."""

    roll: str
    objective: FitObjective
    log: EvaluationLog
    forces: tuple[ForceTried, ...] = ()

    @property
    def string(self) -> StringBatch:
        """Return the best string (a batch of one)."""
        return self.objective.space.strings(self.log.best()[0])

    def values(self) -> dict[str, float]:
        """Return the unknowns of the best string by name."""
        space = self.objective.space
        return dict(zip(space.names, space.values(self.log.best()[0]).tolist(), strict=True))


def estimate_throws(
    throws: list[Throw],
    model: StringModel,
    layout: MassLayout,
    settings: EstimateSettings,
    rng: np.random.Generator,
    *,
    plain_mass: bool | None = None,
    **known: Any,
) -> StringFit:
    """Fit a string in the plane to throws, the newest last; see `estimate` and `space_of`.

    Raises
    ------
    StrandcastError
        SC-E002 a throw has no used frame on the hand's path; those of `estimate`.
    """
    parts = parts_of_throws(throws, model.places_m(), settings)
    space, tried = space_of(settings, layout, plain_mass=plain_mass), forces_of(settings.forces)[1]
    return estimate({"": parts}, model, space, settings, rng, tried=tried, **known)


def estimate(
    trials: Mapping[str, TrialParts],
    model: StringModel,
    space: Space,
    settings: EstimateSettings,
    rng: np.random.Generator,
    *,
    tried: Sequence[ForceName] = (),
    planned: StringBatch | None = None,
    previous: StringBatch | None = None,
    previous_roll: str = "",
    older: int = 0,
    references: bool = False,
    searches: int = 1,
) -> StringFit:
    """Fit the string to its trials.

    Parameters
    ----------
    trials
        At least one, with each roll that the driven ends may have, see
        `strandcast.estimation.cable_series.ROLLS`; the one that fits best is kept.
    model, space
        The string model, and the box of its unknowns.
    tried
        Optional forces that are kept where they pay, see `strandcast.estimation.forces`.
    planned
        The string with which the newest throw was planned (a batch of one), for `E_planned_m`.
    previous, previous_roll
        The previous estimate (the best string first, then its ensemble), from which the search starts, and
        which predicts the newest trial; and its roll.
    older
        How many trials there were before these; the previous estimate is all that is known of them.
    references
        Whether `held_out` has E of the newest trial without a model too, see `without_model`, and the
        prediction is kept. A throw with a target has its plan to be compared with.
    searches
        Independent ones for the string. Where they disagree, its numbers are not known.

    Raises
    ------
    StrandcastError
        SC-E003 no candidate could be simulated.
    """
    start = SearchStart(previous, older + next(iter(trials.values())).trials)
    # In space rolls, and a trial with its last part and without, are compared by the same draws.
    random: Random = lambda: rng  # noqa: E731
    if not space.in_plane:
        random = partial(np.random.default_rng, int(rng.integers(2**31)))
    found = find_string(trials, model, space, settings, random, start, tried, searches)
    objective, log, parts = found.objective, found.log, trials[found.roll]
    _refuse_invalid(log)
    whole = replace(objective, throws=(parts.newest.fitted(),), shares=np.ones(1))
    held_out: dict[str, float] = {}
    predictions: dict[str, Array] = {}
    doubts: list[str] = []
    if previous is not None:
        under = trials.get(previous_roll, parts).newest
        held_out[UNDER_PREVIOUS] = float(whole.value(under.fitted(), previous.take(0), 0.0)[0])
        if references:
            predictions = _paths("predicted", model, under, previous.take(0))
            held_out[TIP_UNDER_PREVIOUS] = tip_error(distances(under.seen_m, predictions["predicted"]))
    if parts.before is not None:
        before = parts.before
        part = replace(objective, throws=before.throws, shares=before.shares(settings.older_trials_weight))
        rest = search(part, settings, random(), start, settings.evaluations)
        frames = len(before.newest.time_s)
        held_out[LAST_PART] = cross_validation.last_part(whole, parts.newest, frames, rest.best()[0])
        doubts += _unconverged(log, rest, frames / len(parts.newest.time_s))
    elif settings.search == "paper":
        held_out[cross_validation.CHOSEN] = cross_validation.reselected(objective, log)
    else:
        share = int(CROSS_VALIDATION_SHARE * settings.evaluations)
        held_out[cross_validation.REFITTED] = cross_validation.refitted(objective, log, share)
    if settings.search != "paper":
        _sample_near(objective, log, rng)
    held_out |= without_model(whole) if references else {}
    uncertainty = uncertainty_of(objective, log, profiles=settings.profiles, long=searches > 1)
    if searches > 1 and settings.profiles:
        uncertainty = with_masses(uncertainty, objective, log)
    weights = np.asarray(np.bincount(parts.trial, objective.shares, parts.trials), dtype=float)
    fit = fit_of(objective, parts.newest, log, held_out, uncertainty, settings, planned, weights)
    if parts.newest.places is not None:
        predictions |= _paths("fitted", model, parts.newest, fit.best)
    doubts = [*fit.warnings, *doubts, *_worse_than_before(fit)]
    return replace(
        fit,
        roll=found.roll,
        forces=found.forces,
        undetermined=undetermined(objective, parts.newest, log, uncertainty) if searches > 1 else {},
        paths_m=predictions,
        warnings=tuple(doubts),
    )


def find_string(
    trials: Mapping[str, TrialParts],
    model: StringModel,
    space: Space,
    settings: EstimateSettings,
    random: Random,
    start: SearchStart,
    tried: Sequence[ForceName] = (),
    searches: int = 1,
) -> FoundString:
    """Search the string that explains the trials best; see `estimate`. Each roll's search has a `random`."""
    kept, found = kept_forces(tried, space, start.previous), []
    for force in kept:
        space = space.with_force(force)
    for roll, parts in trials.items():
        objective = FitObjective(
            model,
            space,
            parts.throws,
            parts.shares(settings.older_trials_weight),
            settings.evaluation,
            overstretched_allowed=settings.ranges == "paper" or not space.in_plane,
        )
        rng = random()
        found.append((roll, rng, *search_in_wide_enough_ranges(objective, settings, rng, start)))
    roll, rng, objective, log = min(found, key=lambda each: each[-1].best()[1])
    for own_rng in rng.spawn(searches - 1):
        budget = search_budget(objective, settings)
        log.join(search(objective, settings, own_rng, replace(start, previous=None), budget))
    left = [force for force in tried if force not in kept]
    problem = objective, log, trials[roll], settings, rng, start
    objective, log, forces = with_forces_that_pay(left, *problem)
    forces += [ForceTried(name=force, kept=True) for force in kept]
    return FoundString(roll, objective, log, tuple(forces))


def _paths(name: str, model: StringModel, throw: PreparedThrow, string: StringBatch) -> dict[str, Array]:
    """Return what was measured of a throw as a string (a batch of one) gives it, and its mass points."""
    paths = {name: simulate_throw(model, throw, string)[0][0]}
    if throw.places is None:
        return paths
    string_name = {"fitted": "string", "predicted": "predicted_string"}[name]
    return paths | {string_name: simulate_batch(model, string, throw.hand, throw.time_s, throw.start)[0][0]}


def _sample_near(objective: FitObjective, log: EvaluationLog, rng: np.random.Generator) -> None:
    """Try strings around the best one, far away in directions to which E is insensitive, for the ensemble."""
    best, value = log.best()
    _, curvature = GaussNewtonModel(objective)(best[None])
    log.count += len(best) + 1
    log(near_samples(best, value, curvature[0], NEAR_SAMPLES, rng))


def _refuse_invalid(log: EvaluationLog) -> None:
    values = log.all()[1]
    if not np.isfinite(values).any():
        raise StrandcastError(
            "SC-E003",
            f"none of {len(values)} candidate strings could be simulated on these trials",
            field="estimate.ranges",
            fix="check the driven ends for jumps, or choose other ranges or a smaller estimate.dt_s",
            exit_code=FAILED_TRIALS,
        )


def _unconverged(fit: EvaluationLog, rest: EvaluationLog, share: float) -> list[str]:
    """Return a warning if a search spent its simulations before it had converged."""
    searches = {"of the string": fit, f"without the last {1.0 - share:.0%} of the trial": rest}
    ended = [f"the search {what}" for what, log in searches.items() if not log.converged]
    return [f"{' and '.join(ended)} did not converge: raise estimate.evaluations"] if ended else []


def _worse_than_before(found: StringFit) -> list[str]:
    """Return a warning if the fit, which has read the newest trial, explains it worse than the one before."""
    before_m = found.held_out.get(UNDER_PREVIOUS, np.inf)
    if not found.E_m > (1.0 + RISE) * before_m:
        return []
    return [
        f"E of the newest trial is {1e3 * found.E_m:.2f} mm, and {1e3 * before_m:.2f} mm under the estimate "
        "before it, which had not read the trial: use that one, or raise estimate.evaluations"
    ]
