"""Estimate the string from the throws so far."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.estimation import forecast
from strandcast.estimation.evaluation import Array, distances, evaluation_of_points, rmse, tip_error
from strandcast.estimation.forecast import HeldOut
from strandcast.estimation.knowledge import Knowledge, knowledge
from strandcast.estimation.objective import Ledger, Objective, play
from strandcast.estimation.refine import Slope
from strandcast.estimation.search import Start, run
from strandcast.estimation.settings import FitSettings
from strandcast.estimation.space import Space, Strings
from strandcast.estimation.spread import distant_members, near_samples
from strandcast.estimation.throw import Task, Throw, prepare
from strandcast.string.masses import MassLayout
from strandcast.string.model import StringModel
from strandcast.string.simulate import OK

AT_BOUND = 0.01  # of a range, in exponents
NEAR_SAMPLES = 64
FORECAST_SHARE = 0.08  # of the evaluations


@dataclass(frozen=True, eq=False)
class Fit:
    """The string that explains the throws, and how well it does.

    Attributes
    ----------
    space, chi
        The unknowns and the best exponents (d,).
    best, members, member_values_m
        The best string (a batch of one), the ensemble (K, the best first) and the members' E on all throws.
    at_bound, low, high
        (d,) which unknowns ended at a bound; (d,) their range over the ensemble, as values.
    frames, time_s, frames_used
        (G,) frames of the newest throw that were simulated, their times [s], and how many entered E.
    E_planned_m, E_m, E_weighted_m
        E of the newest throw under the string that planned it and after the fit (w = 0), and after it with
        the search's w. None where there is no such string or its simulation failed.
    E_points_m
        (n,) E_i of points 1…n, NaN for points never seen.
    step_change_m
        How far the fitted string moves if it is simulated again by half the step, mean over the points seen.
    rmse_m, tip_error_m
        Unweighted root mean square distance and mean distance of the tip, used frames.
    held_out
        E on data not seen: of this throw under the estimate before it, where there is one, and of its own
        parts.
    knowledge
        How well each unknown is known.
    convergence
        Evaluations and best E at each improvement: two arrays.
    evaluations, rejected
        Strings simulated, and how many of the candidates were invalid.
    converged
        Whether the search ended because nothing gained any more, before its evaluations were spent.
    planned_m, fitted_m
        (G, n+1, 2) simulated points; `planned_m` None without a planned string.
    trial_weights
        Weight of each throw in the fit, in the order given.
    warnings
        What a reader should know.
    """

    space: Space
    chi: Array
    best: Strings
    members: Strings
    member_values_m: Array
    at_bound: np.ndarray
    low: Array
    high: Array
    frames: np.ndarray
    time_s: Array
    frames_used: int
    E_planned_m: float | None
    E_m: float
    E_weighted_m: float
    E_points_m: Array
    step_change_m: float
    rmse_m: float
    tip_error_m: float
    held_out: tuple[HeldOut, ...]
    knowledge: Knowledge
    convergence: tuple[Array, Array]
    evaluations: int
    rejected: int
    converged: bool
    planned_m: Array | None
    fitted_m: Array
    trial_weights: Array
    warnings: tuple[str, ...]


def estimate(
    throws: list[Throw],
    model: StringModel,
    layout: MassLayout,
    settings: FitSettings,
    rng: np.random.Generator,
    *,
    planned: Strings | None = None,
    previous: Strings | None = None,
) -> Fit:
    """Fit the string to the throws so far, the newest last.

    Parameters
    ----------
    throws
        At least one, in order.
    model, layout
        The string model and where its free masses sit.
    settings
        How to fit.
    rng
        Source of chance.
    planned
        The string with which the newest throw was planned (a batch of one), for `E_planned_m`.
    previous
        The estimate after the throw before (the best first, its ensemble behind), from which the search
        starts.

    Raises
    ------
    StrandcastError
        SC-E002 a throw has no used frame on the hand's path, SC-E003 no candidate could be simulated.
    """
    kept = throws[-1:] if settings.trials == "latest" else throws
    weights = settings.older_trials_weight ** np.arange(len(kept))[::-1]
    shifted = settings.camera_offset_sd_m is not None
    tasks = [prepare(throw, model.places_m(), settings.start_shape, from_seen_hand=shifted) for throw in kept]
    space = settings.space(layout, model.length_m)
    objective = Objective(
        model,
        space,
        tuple(task.fitted() for task in tasks),
        weights / weights.sum(),
        settings.w,
        settings.evaluation,
        settings.overstretched_allowed,
    )
    ledger = run(objective, settings, rng, Start(previous, len(throws)), _search_budget(settings))
    _refuse_invalid(ledger)
    held_out = [] if previous is None else [_before_thrown(objective, previous)]
    if settings.search == "paper":
        held_out.append(forecast.chosen_again(objective, ledger))
    else:
        held_out.append(forecast.refitted(objective, ledger, int(FORECAST_SHARE * settings.evaluations)))
        _sample_near(objective, ledger, rng)
    known = knowledge(objective, ledger, profiles=settings.profiles)
    all_weights = np.zeros(len(throws))
    all_weights[-len(kept) :] = objective.shares
    return _result(objective, tasks[-1], ledger, held_out, known, settings, planned, all_weights)


def _search_budget(settings: FitSettings) -> int:
    """Return what is left of the evaluations for the search itself."""
    if settings.search == "paper":
        return settings.evaluations
    return max(int((1.0 - FORECAST_SHARE) * settings.evaluations) - NEAR_SAMPLES, NEAR_SAMPLES)


def _before_thrown(objective: Objective, previous: Strings) -> HeldOut:
    """Return E of the newest throw as it was foreseen by the estimate before it."""
    value = float(objective.value(objective.tasks[-1], previous.pick(0), 0.0)[0])
    return HeldOut("this throw under the estimate before it", value)


def _sample_near(objective: Objective, ledger: Ledger, rng: np.random.Generator) -> None:
    """Try strings all over the best one's valley, wide where E does not care, for the ensemble."""
    best, value = ledger.best()
    _, curvature = Slope(objective)(best[None])
    ledger.count += len(best) + 1
    ledger(near_samples(best, value, curvature[0], NEAR_SAMPLES, rng))


def _refuse_invalid(ledger: Ledger) -> None:
    values = ledger.all()[1]
    if not np.isfinite(values).any():
        raise StrandcastError(
            "SC-E003",
            f"none of {len(values)} candidate strings could be simulated on this throw",
            field="estimate.ranges",
            fix="look for jumps in the hand's path, or choose other ranges or a smaller estimate.dt_s",
            exit_code=FAILED_TRIALS,
        )


def _step_change(model: StringModel, task: Task, best: Strings, fitted_m: Array) -> float:
    """Mean distance between the fitted string and the same by half the step, where it was compared [m]."""
    finer, _ = play(replace(model, dt_s=0.5 * model.dt_s), task, best)
    moved = np.linalg.norm(finer[0] - fitted_m, axis=-1)[:, 1:][task.weight > 0]
    return float(moved.mean())


def _result(
    objective: Objective,
    newest: Task,
    ledger: Ledger,
    held_out: list[HeldOut],
    known: Knowledge,
    settings: FitSettings,
    planned: Strings | None,
    trial_weights: Array,
) -> Fit:
    """Everything that is told about the fit."""
    space, model = objective.space, objective.model
    chi, values = ledger.all()
    rows = distant_members(chi, values, settings.ensemble)
    best = space.strings(chi[rows[0]])
    fitted, status = play(model, newest, best)
    step_change_m = _step_change(model, newest, best, fitted[0])
    points = objective.point_values(newest, fitted[0])
    shown = np.where(newest.weight[..., None] > 0, newest.points_m[:, 1:], np.nan)
    distance = distances(
        np.concatenate([newest.points_m[:, :1], shown], axis=1), fitted[0], settings.evaluation
    )
    members = space.values(chi[rows])
    at_bound = np.asarray((chi[rows[0]] < AT_BOUND) | (chi[rows[0]] > 1.0 - AT_BOUND))
    planned_m, planned_value = None, None
    if planned is not None:
        planned_m = play(model, newest, planned.pick(0))[0][0]
        value = float(evaluation_of_points(objective.point_values(newest, planned_m)))
        planned_value = value if np.isfinite(value) else None
    return Fit(
        space,
        chi[rows[0]],
        best,
        space.strings(chi[rows]),
        values[rows],
        at_bound,
        members.min(axis=0),
        members.max(axis=0),
        newest.frames,
        newest.time_s,
        int(newest.weight.any(axis=1).sum()),
        planned_value,
        float(evaluation_of_points(points)),
        float(evaluation_of_points(points, settings.w)),
        points,
        step_change_m,
        rmse(distance),
        tip_error(distance),
        tuple(held_out),
        known,
        ledger.convergence(),
        ledger.count,
        ledger.rejected(),
        ledger.converged,
        planned_m,
        fitted[0],
        trial_weights,
        tuple(_warnings(space, at_bound, int(status[0]) == OK, points, ledger, step_change_m)),
    )


def _warnings(
    space: Space, at_bound: np.ndarray, valid: bool, points: Array, ledger: Ledger, step_change_m: float
) -> list[str]:
    told = [f"{space.names[k]} ended at a bound of its range" for k in np.flatnonzero(at_bound)]
    if not valid:
        told.append("the best string stretches a segment beyond three rest lengths")
    if np.isnan(points).any():
        told.append(f"{int(np.isnan(points).sum())} of {len(points)} points were never seen")
    if ledger.rejected() > 0.5 * ledger.count:
        told.append(f"{ledger.rejected()} of {ledger.count} candidates were invalid")
    if not step_change_m < evaluation_of_points(points):
        told.append(
            f"half the step moves the fitted string by {1e3 * step_change_m:.1f} mm: choose a smaller "
            "estimate.dt_s"
        )
    return told
