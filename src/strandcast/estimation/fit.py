"""The result of a fit: the string that explains the throws, its ensemble, errors and uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import PARAMETERS, UNKNOWNS, StringBatch
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import OK
from strandcast.estimation.descent import GaussNewtonModel, descend, descent_batch
from strandcast.estimation.ensemble import distant_members
from strandcast.estimation.evaluation import Array, distances, evaluation_of_points, rmse, tip_error
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective, simulate_throw
from strandcast.estimation.space import AT_BOUND, Space
from strandcast.estimation.throws import PreparedThrow
from strandcast.estimation.uncertainty import RISE, Uncertainty
from strandcast.estimation.unknowns import BENDING, bounds_of
from strandcast.records.estimate import ForceTried

FEWEST_ENDS = 2  # of independent searches that explain the throws as well as the best: then they agree
PAYS = 0.98  # wider ranges, and one more unknown, are kept if the cost falls below this share
BEYOND_ROUNDS = 12  # of the descents that tell whether a wider range pays; chosen


@dataclass(frozen=True, eq=False)
class StringFit:
    """The string that explains the throws, and how well it does so.

    Attributes
    ----------
    space, chi
        The unknowns and the best exponents (d,).
    best, members, member_values_m
        The best string (a batch of one), the ensemble (K, the best first), and their E on all throws.
    at_bound, low, high
        (d,) which unknowns ended at a bound; (d,) their range over the ensemble, as values.
    frames, time_s, frames_used, window_s
        (G,) frames of the newest throw that were simulated, their times [s], how many entered E, and the
        times of the first and the last of these.
    E_planned_m, E_m, E_weighted_m
        E of the newest throw under the string that planned it and after the fit (w = 0), and after it with
        the search's w. None where there is no such string or its simulation failed.
    E_points_m
        (n,) E_i of points 1…n, NaN for points never measured.
    step_change_m
        How far the fitted string moves if it is simulated with half the step, mean over measured points [m].
    rmse_m, tip_error_m
        Unweighted root mean square distance and mean distance of the tip, used frames.
    held_out
        E (w = 0) on held-out data [m]: this throw under the previous estimate, where there is one, and its
        own parts.
    uncertainty
        How well each unknown is known.
    convergence
        Evaluations and best E at each improvement: two arrays.
    evaluations, rejected
        Strings simulated, and how many of the candidates were invalid.
    converged
        Whether the search ended because nothing improved any more, before its evaluations were spent.
    searches_agree
        Whether at least two of its independent searches, or its only one, came near the best cost.
    planned_m, fitted_m
        (G, n+1, 2 or 3) simulated points; `planned_m` None without a planned string.
    trial_weights
        Weight of each throw in the fit, in the order given.
    warnings
        Reasons to doubt the estimate.
    forces
        Optional forces that were tried.
    undetermined
        See `strandcast.estimation.excitation.undetermined`.
    roll
        Of the driven ends, see `strandcast.estimation.cable_series.ROLLS`; none in the plane.
    paths_m
        Further simulated points (G, n+1 or m+1, 2 or 3) by their source in `simulated.parquet`.
    """

    space: Space
    chi: Array
    best: StringBatch
    members: StringBatch
    member_values_m: Array
    at_bound: np.ndarray
    low: Array
    high: Array
    frames: np.ndarray
    time_s: Array
    frames_used: int
    window_s: tuple[float, float]
    E_planned_m: float | None
    E_m: float
    E_weighted_m: float
    E_points_m: Array
    step_change_m: float
    rmse_m: float
    tip_error_m: float
    held_out: Mapping[str, float]
    uncertainty: Uncertainty
    convergence: tuple[Array, Array]
    evaluations: int
    rejected: int
    converged: bool
    searches_agree: bool
    planned_m: Array | None
    fitted_m: Array
    trial_weights: Array
    warnings: tuple[str, ...]
    roll: str = ""
    forces: tuple[ForceTried, ...] = ()
    undetermined: Mapping[str, str] = field(default_factory=dict)
    paths_m: Mapping[str, Array] = field(default_factory=dict)


def fit_of(
    objective: FitObjective,
    newest: PreparedThrow,
    log: EvaluationLog,
    held_out: Mapping[str, float],
    uncertainty: Uncertainty,
    settings: EstimateSettings,
    planned: StringBatch | None,
    trial_weights: Array,
) -> StringFit:
    """Return the fit that a search has found.

    Parameters
    ----------
    objective, log
        The function that was minimised, and all candidates that were tried.
    newest
        The newest throw with all its frames.
    held_out, uncertainty
        Results of the cross-validation, and the uncertainty of the best string.
    planned
        The string with which the newest throw was planned.
    """
    space, model = objective.space, objective.model
    chi, values = log.all()
    rows = distant_members(chi, values)
    best = space.strings(chi[rows[0]])
    fitted, status = simulate_throw(model, newest, best)
    step_change_m = _step_change(model, newest, best, fitted[0])
    points = objective.point_values(newest, fitted[0])
    distance = distances(newest.seen_m, fitted[0], settings.evaluation)
    members = space.values(chi[rows])
    used = newest.weight.any(axis=1)
    at_bound = np.asarray((chi[rows[0]] < AT_BOUND) | (chi[rows[0]] > 1.0 - AT_BOUND))
    physical = [name for name, row in UNKNOWNS.items() if row.bounds_are_physical]
    at_bound &= ~np.isin(space.names, physical)
    valid = int(status[0]) == OK
    planned_m, planned_value = None, None
    if planned is not None:
        planned_m = simulate_throw(model, newest, planned.take(0))[0][0]
        value = float(evaluation_of_points(objective.point_values(newest, planned_m)))
        planned_value = value if np.isfinite(value) else None
    return StringFit(
        space=space,
        chi=chi[rows[0]],
        best=best,
        members=space.strings(chi[rows]),
        member_values_m=values[rows],
        at_bound=at_bound,
        low=members.min(axis=0),
        high=members.max(axis=0),
        frames=newest.frames,
        time_s=newest.time_s,
        frames_used=int(used.sum()),
        window_s=(float(newest.time_s[used][0]), float(newest.time_s[used][-1])),
        E_planned_m=planned_value,
        E_m=float(evaluation_of_points(points)),
        E_weighted_m=float(evaluation_of_points(points, objective.w)),
        E_points_m=points,
        step_change_m=step_change_m,
        rmse_m=rmse(distance),
        tip_error_m=tip_error(distance),
        held_out=held_out,
        uncertainty=uncertainty,
        convergence=log.convergence(),
        evaluations=log.count,
        rejected=log.rejected(),
        converged=log.converged,
        searches_agree=not disagreement(log),
        planned_m=planned_m,
        fitted_m=fitted[0],
        trial_weights=trial_weights,
        warnings=(
            *_range_warnings(objective, chi[rows[0]], at_bound),
            *_warnings(space, chi[rows[0]], at_bound, valid, points, log, step_change_m, settings.search),
        ),
    )


def _step_change(model: StringModel, throw: PreparedThrow, best: StringBatch, fitted_m: Array) -> float:
    """Mean distance between the fitted string and the same by half the step, where it was compared [m]."""
    finer, _ = simulate_throw(replace(model, dt_s=0.5 * model.dt_s), throw, best)
    moved = np.linalg.norm(finer[0] - fitted_m, axis=-1)[:, 1:][throw.weight > 0]
    return float(moved.mean())


def disagreement(log: EvaluationLog) -> list[str]:
    """Return a warning if independent searches ended in strings that do not explain the throws as well."""
    near = sum(end <= (1.0 + RISE) * log.best()[1] for end in log.ends)
    if len(log.ends) < FEWEST_ENDS or near >= FEWEST_ENDS:
        return []
    return [
        f"the {len(log.ends)} independent searches disagree: {near or 'none'} of them came within "
        f"{100 * RISE:.0f} % of the best cost, so that a better string may exist; do not read its "
        "parameters: raise estimate.evaluations, or throw another motion"
    ]


def _is_narrowed(space: Space, k: int, exponent: float) -> bool:
    """Return whether the nearer bound of an unknown is within the widest range; in space none is chosen."""
    if not space.in_plane or k >= len(PARAMETERS):
        return False
    (least, most), (wide_least, wide_most) = space.bounds[k], bounds_of("wide")[k]
    return bool(most < wide_most if exponent > 0.5 else least > wide_least)


def _range_warnings(objective: FitObjective, chi: Array, at_bound: np.ndarray) -> list[str]:
    """Return a warning of chosen ranges beyond which the string explains the throws better.

    A search may end before the nearest minimum, so that a descent with the wider ranges is compared with one
    within the chosen ones.
    """
    space = objective.space
    ended = [int(k) for k in np.flatnonzero(at_bound) if _is_narrowed(space, int(k), chi[k])]
    if not ended:
        return []
    bounds, wide = space.bounds.copy(), bounds_of("wide")
    bounds[ended, 0] = np.minimum(bounds[ended, 0], wide[ended, 0])
    bounds[ended, 1] = np.maximum(bounds[ended, 1], wide[ended, 1])
    within_m, beyond_m = (
        _descended_m(replace(objective, space=box), box.exponents(space.values(chi)))
        for box in (space, replace(space, bounds=bounds))
    )
    if beyond_m > PAYS * within_m:
        return []
    return [
        f"{space.names[k]} ended at a bound of its range, beyond which the cost falls from "
        f"{1e3 * within_m:.1f} to {1e3 * beyond_m:.1f} mm: widen it in estimate.ranges"
        for k in ended
    ]


def _descended_m(objective: FitObjective, chi: Array) -> float:
    """Return the cost at the end of a short descent from exponents (d,) [m]."""
    log = EvaluationLog(objective.cost)
    descents = descent_batch(chi[None], log(chi[None]))
    descend(log, GaussNewtonModel(objective), descents, BEYOND_ROUNDS * 32 * len(chi), BEYOND_ROUNDS)
    return log.best()[1]


def _warnings(
    space: Space,
    chi: Array,
    at_bound: np.ndarray,
    valid: bool,
    points: Array,
    log: EvaluationLog,
    step_change_m: float,
    search: str,
) -> list[str]:
    warnings = []
    # Of the string itself: a clamp (k_ph) may be as good as rigid on the limpest cord, and a bend that
    # straightens as stiff as it likes where one that grows is not.
    if space.in_plane:
        own = [PARAMETERS.index(name) for name in BENDING]
        least, usual = space.values(chi)[own].min(), bounds_of("wide")[own, 1].max()
        if least > usual and search not in ("thorough", "screened"):
            warnings.append(
                f"a stiff string: {' and '.join(BENDING)} are {least:.0f} and more, beyond the usual "
                f"{usual:g}; read its masses and parameters only from a fit with estimate.search: thorough"
            )
    greatest = [space.names[k] for k in np.flatnonzero(at_bound & (chi > 0.5))]
    if space.layout.count and (stiff := [name for name in greatest if name in BENDING]):
        warnings.append(f"the weights' masses are not known: {', '.join(stiff)} ended at the upper bound")
    if not valid:
        warnings.append("the best string stretches a segment beyond three rest lengths")
    if np.isnan(points).any():
        warnings.append(f"{int(np.isnan(points).sum())} of {len(points)} points were never measured")
    if log.rejected() > 0.5 * log.count:
        warnings.append(f"{log.rejected()} of {log.count} candidates were invalid")
    warnings += disagreement(log)
    if not step_change_m < evaluation_of_points(points):
        warnings.append(
            f"half the step moves the fitted string by {1e3 * step_change_m:.1f} mm: choose a smaller "
            "estimate.dt_s"
        )
    return warnings
