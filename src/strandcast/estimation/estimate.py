"""Estimate the string from the throws so far."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.estimation import searches
from strandcast.estimation.evaluation import Array, distances, evaluation_of_points, rmse, tip_error
from strandcast.estimation.objective import Ledger, Objective, play
from strandcast.estimation.refine import descend, refine
from strandcast.estimation.settings import FitSettings, prior_exponents
from strandcast.estimation.space import Space, Strings
from strandcast.estimation.spread import distant_members, near_samples
from strandcast.estimation.throw import Task, Throw, prepare
from strandcast.progress import Progress
from strandcast.string.integrators import OK
from strandcast.string.masses import MassLayout
from strandcast.string.model import StringModel

AT_BOUND = 0.01  # of a range, in exponents
NEAR_SAMPLES = 64
SIGMA = 0.08  # of CMA-ES, in exponents: it looks around the best valley that the descents found


@dataclass(frozen=True, eq=False)
class HeldOut:
    """E (w = 0) on data that the fit behind it had not seen [m]."""

    what: str
    E_m: float


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
    rmse_m, tip_error_m
        Unweighted root mean square distance and mean distance of the tip, used frames.
    held_out
        E on data not seen.
    convergence
        Evaluations and best E at each improvement: two arrays.
    evaluations, rejected
        Candidates simulated, and how many of them were invalid.
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
    rmse_m: float
    tip_error_m: float
    held_out: tuple[HeldOut, ...]
    convergence: tuple[Array, Array]
    evaluations: int
    rejected: int
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
    tasks = [prepare(throw, model.places_m(), settings.start_shape) for throw in kept]
    space = settings.space(layout)
    objective = Objective(
        model,
        space,
        tuple(task.fitted() for task in tasks),
        weights / weights.sum(),
        settings.w,
        settings.evaluation,
        settings.overstretched_allowed,
    )
    search = _search_paper if settings.search == "paper" else _search_cma
    ledger, spent, held_out = search(objective, settings, rng, previous, len(throws))
    if previous is not None:
        value = float(objective.value(objective.tasks[-1], previous.pick(0), 0.0)[0])
        held_out.insert(0, HeldOut("this throw under the estimate before it", value))
    all_weights = np.zeros(len(throws))
    all_weights[-len(kept) :] = objective.shares
    return _result(objective, tasks[-1], ledger, spent, held_out, settings, planned, all_weights)


def _search_paper(
    objective: Objective,
    settings: FitSettings,
    rng: np.random.Generator,
    previous: Strings | None,
    trials: int,
) -> tuple[Ledger, int, list[HeldOut]]:
    """Search as the paper does, around the previous estimate or, without one, a random string."""
    tell = Progress("estimate", settings.evaluations)
    ledger = Ledger(objective.evaluate, lambda count, best: tell(count, _words(best)))
    space = objective.space
    centre = rng.random(space.dimension) if previous is None else space.chi_of(previous.pick(0))[0]
    searches.paper(
        ledger,
        centre,
        settings.evaluations,
        rng,
        trials=trials,
        centre=settings.centre,
        chi_0=settings.chi_0,
        beta=settings.beta,
    )
    return ledger, 0, []


def _search_cma(
    objective: Objective,
    settings: FitSettings,
    rng: np.random.Generator,
    previous: Strings | None,
    trials: int,
) -> tuple[Ledger, int, list[HeldOut]]:
    """Draws, descents from the best of them, CMA-ES around the best of these, and a last descent.

    A first fit meets the early frames alone before.
    """
    budget = settings.evaluations
    tell = Progress("estimate", budget)
    held_out: list[HeldOut] = []
    spent = 0
    if previous is None:
        starts, spent, forecast = _early_fit(objective, settings, rng, tell)
        held_out.append(forecast)
    else:
        starts = np.vstack(
            [
                objective.space.chi_of(previous),
                prior_exponents(objective.space, objective.model, 16, rng),
            ]
        )
    ledger = Ledger(objective.evaluate, lambda count, best: tell(spent + count, _words(best)))
    ledger(starts)
    descend(ledger, objective.residuals, int(0.25 * budget))
    polish = int(0.15 * budget)
    left = budget - spent - ledger.count - polish - NEAR_SAMPLES
    searches.evolve(ledger, ledger.best()[0], left, rng, sigma=SIGMA)
    _, curvature = refine(ledger, objective.residuals, ledger.best()[0], polish)
    if np.isfinite(ledger.best()[1]):
        ledger(near_samples(*ledger.best(), curvature, NEAR_SAMPLES, rng))
    return ledger, spent, held_out


def _early_fit(
    objective: Objective, settings: FitSettings, rng: np.random.Generator, tell: Progress
) -> tuple[Array, int, HeldOut]:
    """Fit the frames before the last quarter, and hold the rest against it.

    It costs nothing: the full fit starts from here. Returns the starts (k, d), evaluations, and the error.
    """
    share = 1.0 - settings.held_out
    task = objective.tasks[-1]
    early = replace(objective, tasks=(*objective.tasks[:-1], task.until(share)))
    ledger = Ledger(early.evaluate, lambda count, best: tell(count, _words(best)))
    draws = settings.evaluations // 30
    space = objective.space
    ledger(prior_exponents(space, objective.model, 2 * draws, rng))
    ledger(searches.latin_hypercube(draws, space.dimension, rng))
    descend(ledger, early.residuals, int(0.2 * settings.evaluations))
    chi, values = ledger.all()
    value = objective.value(task.after(share), space.strings(ledger.best()[0]), 0.0)
    starts = chi[np.argsort(values, kind="stable")[:8]]
    words = f"the last {settings.held_out:.0%} of the frames, from a fit to those before"
    return starts, ledger.count, HeldOut(words, float(value[0]))


def _result(
    objective: Objective,
    newest: Task,
    ledger: Ledger,
    spent: int,
    held_out: list[HeldOut],
    settings: FitSettings,
    planned: Strings | None,
    trial_weights: Array,
) -> Fit:
    """Everything that is told about the fit."""
    space, model = objective.space, objective.model
    chi, values = ledger.all()
    if not np.isfinite(values).any():
        raise StrandcastError(
            "SC-E003",
            f"none of {len(values)} candidate strings could be simulated on this throw",
            field="estimate.ranges",
            fix="look for jumps in the hand's path, or choose other ranges or a smaller estimate.dt_s",
            exit_code=FAILED_TRIALS,
        )
    rows = distant_members(chi, values, settings.ensemble)
    best = space.strings(chi[rows[0]])
    fitted, status = play(model, newest, best)
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
    evaluations, best_values = ledger.convergence()
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
        rmse(distance),
        tip_error(distance),
        tuple(held_out),
        (evaluations + spent, best_values),
        spent + ledger.count,
        ledger.rejected(),
        planned_m,
        fitted[0],
        trial_weights,
        tuple(_warnings(space, at_bound, int(status[0]) == OK, points, ledger)),
    )


def _warnings(space: Space, at_bound: np.ndarray, valid: bool, points: Array, ledger: Ledger) -> list[str]:
    told = [f"{space.names[k]} ended at a bound of its range" for k in np.flatnonzero(at_bound)]
    if not valid:
        told.append("the best string stretches a segment beyond three rest lengths")
    if np.isnan(points).any():
        told.append(f"{int(np.isnan(points).sum())} of {len(points)} points were never seen")
    if ledger.rejected() > 0.5 * ledger.count:
        told.append(f"{ledger.rejected()} of {ledger.count} candidates were invalid")
    return told


def _words(best: float) -> str:
    return f"best E {1e3 * best:.2f} mm"
