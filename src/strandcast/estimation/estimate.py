"""Estimate the string from the throws so far."""

from dataclasses import replace

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import UNKNOWNS, StringBatch, Unknown
from strandcast.dynamics.masses import MassLayout
from strandcast.dynamics.model import StringModel
from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.estimation import cross_validation
from strandcast.estimation.cross_validation import HeldOutEvaluation
from strandcast.estimation.descent import GaussNewtonModel
from strandcast.estimation.ensemble import distant_members, near_samples
from strandcast.estimation.evaluation import evaluation_of_points
from strandcast.estimation.fit import PAYS, StringFit, fit_of
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.measured import Throw
from strandcast.estimation.optimisers.optimiser import SearchProblem, SearchStart
from strandcast.estimation.optimisers.registry import OPTIMISERS
from strandcast.estimation.throws import prepare
from strandcast.estimation.uncertainty import uncertainty_of
from strandcast.estimation.unknowns import space_of, when_fitted, widened, with_unknown
from strandcast.progress import Progress
from strandcast.records.estimate import CARRIED, HANGING, UNDER_PREVIOUS

# Chosen.
NEAR_SAMPLES = 64
CROSS_VALIDATION_SHARE = 0.08  # of the evaluations


def estimate(
    throws: list[Throw],
    model: StringModel,
    layout: MassLayout,
    settings: EstimateSettings,
    rng: np.random.Generator,
    *,
    planned: StringBatch | None = None,
    previous: StringBatch | None = None,
    plain_mass: bool | None = None,
    older: int = 0,
    references: bool = False,
) -> StringFit:
    """Fit the string to throws, the newest last.

    Parameters
    ----------
    throws
        At least one, in order.
    model, layout
        The string model and where its free masses sit.
    planned
        The string with which the newest throw was planned (a batch of one), for `E_planned_m`.
    previous
        The previous estimate (the best string first, then its ensemble), from which the search starts.
    plain_mass
        Whether to fit the common mass of the plain points; None: only in the paper's search.
    older
        How many throws there were before these; the previous estimate is all that is known of them.
    references
        Whether `held_out` has E of the newest throw without a model too, see `without_model`. A throw with a
        target has its plan to be compared with.

    Raises
    ------
    StrandcastError
        SC-E002 a throw has no used frame on the hand's path, SC-E003 no candidate could be simulated.
    """
    kept = throws[-1:] if settings.trials == "latest" else throws
    weights = settings.older_trials_weight ** np.arange(len(kept))[::-1]
    shifted = settings.camera_offset_sd_m is not None
    prepared = [
        prepare(throw, model.places_m(), settings.start_shape, from_measured_hand=shifted) for throw in kept
    ]
    space = space_of(settings, layout, plain_mass=plain_mass)
    objective = FitObjective(
        model,
        space,
        tuple(throw.fitted() for throw in prepared),
        weights / weights.sum(),
        settings.w,
        settings.evaluation,
        overstretched_allowed=settings.ranges == "paper",
    )
    start = SearchStart(previous, older + len(throws))
    tried = [row for row in UNKNOWNS.values() if when_fitted(row, settings) == "auto"]
    if settings.search == "paper":
        tried = []
    kept_before = [row for row in tried if previous is not None and previous[row.name].any()]
    for row in kept_before:
        objective = replace(objective, space=with_unknown(objective.space, row))
    objective, log = _search_in_wide_enough_ranges(objective, settings, rng, start)
    for row in tried:
        if row not in kept_before:
            objective, log = _with_unknown_if_it_pays(row, objective, log, settings, rng, start)
    _refuse_invalid(log)
    held_out = [] if previous is None else [_under_previous(objective, previous)]
    if settings.search == "paper":
        held_out.append(cross_validation.reselected(objective, log))
    else:
        held_out.append(
            cross_validation.refitted(objective, log, int(CROSS_VALIDATION_SHARE * settings.evaluations))
        )
        _sample_near(objective, log, rng)
    held_out += without_model(objective) if references else []
    uncertainty = uncertainty_of(objective, log, profiles=settings.profiles)
    all_weights = np.zeros(len(throws))
    all_weights[-len(kept) :] = objective.shares
    return fit_of(objective, prepared[-1], log, held_out, uncertainty, settings, planned, all_weights)


def _search_in_wide_enough_ranges(
    objective: FitObjective, settings: EstimateSettings, rng: np.random.Generator, start: SearchStart
) -> tuple[FitObjective, EvaluationLog]:
    """Search; where a stiffness ended at its upper bound, search wider ranges while that pays.

    A fit at a bound says little of where the best string beyond it lies: the wider search starts again.
    """
    log = search(objective, settings, rng, start, _search_budget(settings))
    while settings.ranges == "wide" and np.isfinite(log.best()[1]):
        best, value = log.best()
        space = widened(objective.space, best)
        if space is None:
            break
        wider = replace(objective, space=space)
        own_rng = rng.spawn(1)[0]  # what follows does not depend on a search that did not pay
        beyond = search(wider, settings, own_rng, replace(start, previous=None), _search_budget(settings))
        if beyond.best()[1] > PAYS * value:
            break
        objective, log = wider, beyond
    return objective, log


def _with_unknown_if_it_pays(
    row: Unknown,
    objective: FitObjective,
    log: EvaluationLog,
    settings: EstimateSettings,
    rng: np.random.Generator,
    start: SearchStart,
) -> tuple[FitObjective, EvaluationLog]:
    """Search with one more unknown, from the strings that were found without it.

    A search from nothing with one more unknown finds what it found without it less surely.
    """
    chi, values = log.all()
    if not np.isfinite(values).any():
        return objective, log
    found = objective.space.strings(chi[distant_members(chi, values, settings.ensemble)])
    freer = replace(objective, space=with_unknown(objective.space, row))
    first = row.starts or (float(freer.space.values(np.full(freer.space.dimension, 0.5))[-1]),)
    starts = found.take(np.tile(np.arange(len(found)), len(first)))
    starts = starts.with_values(**{row.name: np.repeat(first, len(found))})
    own_rng = rng.spawn(1)[0]  # what follows does not depend on a search that did not pay
    beyond = search(freer, settings, own_rng, replace(start, previous=starts), _search_budget(settings))
    gain = beyond.best()[1] / log.best()[1]
    if gain >= PAYS:
        return objective, log
    # Whether independent searches agree shows in those without it: only one of the others began with theirs.
    beyond.ends = [gain * end for end in log.ends]
    return freer, beyond


def search(
    objective: FitObjective,
    settings: EstimateSettings,
    rng: np.random.Generator,
    start: SearchStart,
    evaluations: int,
) -> EvaluationLog:
    """Run the search of the settings with at most so many simulations; the log holds all strings tried."""
    progress = Progress("estimate", evaluations)

    def report(count: int, best: float) -> None:
        more = f", {count - evaluations} more for the uncertainty" if count > evaluations else ""
        progress(min(count, evaluations), f"best cost {1e3 * best:.2f} mm{more}")

    log = EvaluationLog(objective.cost, report)
    problem = SearchProblem(objective, settings, start, rng, evaluations)
    log.converged = OPTIMISERS.get(settings.search)(problem, log)
    return log


def _search_budget(settings: EstimateSettings) -> int:
    """Return the evaluations left for the search itself."""
    if settings.search == "paper":
        return settings.evaluations
    return max(int((1.0 - CROSS_VALIDATION_SHARE) * settings.evaluations) - NEAR_SAMPLES, NEAR_SAMPLES)


def _under_previous(objective: FitObjective, previous: StringBatch) -> HeldOutEvaluation:
    """E of the newest throw under the previous estimate."""
    value = float(objective.value(objective.throws[-1], previous.take(0), 0.0)[0])
    return HeldOutEvaluation(UNDER_PREVIOUS, value)


def without_model(objective: FitObjective) -> list[HeldOutEvaluation]:
    """E of the newest throw for two guesses that need no model, to compare predictions with.

    The string hangs straight below the hand, or it keeps its first shape and moves with the hand.
    """
    throw = objective.throws[-1]
    path_s, path_m = throw.hand.time_s, throw.hand.pose[:, :2]
    hand_m = np.stack([np.interp(throw.time_s, path_s, path_m[:, k]) for k in (0, 1)], axis=1)[:, None]
    hanging_m = np.outer(objective.model.places_m(), (0.0, -1.0))
    guesses = {HANGING: hanging_m}
    if throw.start.points_m is not None:
        guesses[CARRIED] = np.concatenate([np.zeros((1, 2)), throw.start.points_m - path_m[0]])
    return [
        HeldOutEvaluation(what, float(evaluation_of_points(objective.point_values(throw, hand_m + shape_m))))
        for what, shape_m in guesses.items()
    ]


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
            f"none of {len(values)} candidate strings could be simulated on this throw",
            field="estimate.ranges",
            fix="check the hand's path for jumps, or choose other ranges or a smaller estimate.dt_s",
            exit_code=FAILED_TRIALS,
        )
