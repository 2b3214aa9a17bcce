"""Estimate a string in space from its trials so far, and predict what was held out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import MARKER_SHIFT
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simulate import simulate_batch
from strandcast.dynamics.spatial.clamps import POSE
from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.estimation.cable_fit import EVALUATIONS, CableFit, fit_by_roll, fit_cable
from strandcast.estimation.cable_series import CableSeries
from strandcast.estimation.cable_space import CableSpace
from strandcast.estimation.cross_validation import HeldOutEvaluation
from strandcast.estimation.descent import GaussNewtonModel
from strandcast.estimation.ensemble import near_samples
from strandcast.estimation.estimate import NEAR_SAMPLES
from strandcast.estimation.evaluation import distances, evaluation_of_points, tip_error
from strandcast.estimation.fit import StringFit, fit_of
from strandcast.estimation.fit_objective import FitObjective
from strandcast.estimation.throws import PreparedThrow
from strandcast.estimation.uncertainty import RISE, uncertainty_of
from strandcast.progress import Progress
from strandcast.records.estimate import CARRIED, HANGING, LAST_PART, TIP_UNDER_PREVIOUS, UNDER_PREVIOUS

PART = 0.75  # of the newest trial; the rest of it is held out once (chosen)

Rolls = dict[str, CableSeries]


@dataclass(frozen=True, eq=False)
class PreviousCable:
    """The estimate before: its unknowns by name, and the roll of the driven ends that it was made with."""

    values: dict[str, float]
    roll: str

    def chi(self, space: CableSpace) -> Array:
        """Return its exponents (d,)."""
        return space.exponents(np.array([self.values[name] for name in space.names]))


@dataclass(frozen=True, eq=False)
class CableEstimate:
    """The estimate of a string in space.

    Attributes
    ----------
    roll
        Roll of the driven ends, see `strandcast.estimation.cable_series.ROLLS`.
    fit
        The string that explains the trials.
    string_m, predicted_string_m
        (F, n + 1, 3) mass points of the newest trial under the fitted string, and open loop under the
        estimate before; None without one.
    predicted_m
        (F, m + 1, 3) the latter's markers.
    """

    roll: str
    fit: StringFit
    string_m: Array
    predicted_m: Array | None = None
    predicted_string_m: Array | None = None


def estimate_cable(
    series: list[Rolls],
    model: StringModel,
    space: CableSpace,
    settings: EstimateSettings,
    rng: np.random.Generator,
    previous: PreviousCable | None = None,
    *,
    evaluations: int = EVALUATIONS,
) -> CableEstimate:
    """Fit a string in space to its trials, the newest last.

    Parameters
    ----------
    series
        The trials, each with every roll that its driven ends may have.
    model, space
        See `strandcast.estimation.cable_space.space_of_cable`.
    settings
        Evaluations, ensemble, profiles.
    previous
        The estimate before, from which one descent starts, and which predicts the newest trial.
    evaluations
        Strings to simulate in a search at most, unless the settings have a number.

    Raises
    ------
    StrandcastError
        SC-E003 no candidate could be simulated.
    """
    if "evaluations" in settings.model_fields_set:
        evaluations = settings.evaluations
    seed = int(rng.integers(2**31))
    progress = Progress("estimate", evaluations)

    def fitted(trials: list[CableSeries], start: Array | None) -> CableFit:
        def report(count: int, best: float) -> None:
            progress(min(count, evaluations), f"best cost {1e3 * best:.2f} mm")

        return fit_cable(
            trials, model, space, evaluations=evaluations, seed=seed, previous=start, report=report
        )

    before = None if previous is None else previous.chi(space)
    roll, fit = fit_by_roll(series, lambda trials: fitted(trials, before))
    if not np.isfinite(fit.value_m):
        raise StrandcastError(
            "SC-E003",
            "no candidate string could be simulated on these trials",
            fix="check the driven ends for jumps, or choose a smaller estimate.dt_s",
            exit_code=FAILED_TRIALS,
        )
    trials = [each[roll] for each in series]
    newest = trials[-1].prepared(0, len(trials[-1].time_s), model.points)
    objective, log = fit.objective, fit.log
    whole = replace(objective, throws=(newest,), shares=np.ones(1))
    rest = fitted([*trials[:-1], trials[-1].part(0, _first_frames(trials[-1]))], before)
    held_out = [_last_part(whole, trials[-1], rest)]
    predicted_m = predicted_string_m = None
    if previous is not None and before is not None:
        under = series[-1].get(previous.roll, trials[-1]).prepared(0, len(newest.time_s), model.points)
        strings = space.strings(before)
        predicted_string_m = simulate_batch(model, strings, under.hand, under.time_s, under.start)[0][0]
        predicted_m = under.as_measured(predicted_string_m[None], strings[MARKER_SHIFT])[0]
        held_out = [*_under_previous(whole, under, predicted_m), *held_out]
    best, value = log.best()
    _, curvature = GaussNewtonModel(objective)(best[None])
    log.count += len(best) + 1
    log(near_samples(best, value, curvature[0], NEAR_SAMPLES, rng))
    held_out += without_model_in_space(whole)
    # Profiles take some ten times as long as the fit: only where they are asked for.
    asked = settings.profiles and "profiles" in settings.model_fields_set
    uncertainty = uncertainty_of(objective, log, profiles=asked)
    found = fit_of(objective, newest, log, held_out, uncertainty, settings, None, np.ones(len(series)))
    doubts = [*found.warnings, *_unconverged(fit, rest), *_worse_than_before(found)]
    found = replace(found, warnings=tuple(doubts))
    string_m, _ = simulate_batch(model, found.best, newest.hand, newest.time_s, newest.start)
    return CableEstimate(roll, found, string_m[0], predicted_m, predicted_string_m)


def _unconverged(fit: CableFit, rest: CableFit) -> list[str]:
    """Return a warning if a search spent its simulations before it had converged."""
    searches = {"of the string": fit, f"without the last {1.0 - PART:.0%} of the trial": rest}
    ended = [f"the search {what}" for what, each in searches.items() if not each.log.converged]
    return [f"{' and '.join(ended)} did not converge: raise estimate.evaluations"] if ended else []


def _worse_than_before(found: StringFit) -> list[str]:
    """Return a warning if the fit, which has read the newest trial, explains it worse than the one before."""
    before_m = next((held.E_m for held in found.held_out if held.what == UNDER_PREVIOUS), np.inf)
    if not found.E_m > (1.0 + RISE) * before_m:
        return []
    return [
        f"E of the newest trial is {1e3 * found.E_m:.2f} mm, and {1e3 * before_m:.2f} mm under the estimate "
        "before it, which had not read the trial: use that one, or raise estimate.evaluations"
    ]


def _first_frames(newest: CableSeries) -> int:
    return round(PART * len(newest.time_s))


def _last_part(whole: FitObjective, newest: CableSeries, rest: CableFit) -> HeldOutEvaluation:
    """E of the last part of the newest trial, simulated from its beginning, under a fit to all the rest."""
    (throw,) = whole.throws
    weight = throw.weight.copy()
    weight[: _first_frames(newest)] = 0.0
    if not weight.any():
        return HeldOutEvaluation(LAST_PART, float("nan"))
    value = whole.value(replace(throw, weight=weight), rest.space.strings(rest.chi), 0.0)
    return HeldOutEvaluation(LAST_PART, float(value[0]))


def _under_previous(whole: FitObjective, throw: PreparedThrow, predicted_m: Array) -> list[HeldOutEvaluation]:
    """E of the newest trial, and the mean distance of its last marker, under the estimate before."""
    seen_m = np.where(np.insert(throw.weight > 0, 0, True, axis=1)[..., None], throw.points_m, np.nan)
    return [
        HeldOutEvaluation(
            UNDER_PREVIOUS, float(evaluation_of_points(whole.point_values(throw, predicted_m)))
        ),
        HeldOutEvaluation(TIP_UNDER_PREVIOUS, tip_error(distances(seen_m, predicted_m))),
    ]


def without_model_in_space(whole: FitObjective) -> list[HeldOutEvaluation]:
    """E of a trial for guesses that need no model: hanging straight below the hand, first shape moved along.

    Between two driven ends, the shape moves with both, by the place along the string.
    """
    (throw,), along = whole.throws, np.linspace(0.0, 1.0, whole.model.points + 1)[:, None]
    pose = throw.hand.pose
    hand_m, far_m = pose[:, None, :3], pose[:, None, -POSE : pose.shape[1] - POSE + 3]
    guesses = {}
    if pose.shape[1] == POSE:
        guesses[HANGING] = hand_m + along * [0.0, 0.0, -whole.model.length_m]
    if throw.start.points_m is not None:
        first = np.concatenate([hand_m[0], throw.start.points_m])
        guesses[CARRIED] = first + (1.0 - along) * (hand_m - hand_m[0]) + along * (far_m - far_m[0])
    return [
        HeldOutEvaluation(
            what, float(evaluation_of_points(whole.point_values(throw, throw.as_measured(each))))
        )
        for what, each in guesses.items()
    ]
