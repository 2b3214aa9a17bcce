"""Cross-validation: each part of the newest throw is left out of the fit once, and predicted by it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from strandcast.core.interpolation import resampled
from strandcast.dynamics.spatial.clamps import POSE
from strandcast.estimation.descent import LADDER, GaussNewtonModel, descend, descent_batch
from strandcast.estimation.evaluation import Array, evaluation_of_points
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective, simulate_throw
from strandcast.estimation.throws import PreparedThrow, TrialParts
from strandcast.records.estimate import CARRIED, HANGING

# Chosen.
PARTS = 4
CHOSEN_FROM = 32  # best candidates of a search
FEWEST_GROUPS = 3  # trials or windows, to leave some out at a time
FOLD_ROUNDS = 12  # of a descent

REFITTED = f"each of {PARTS} parts of the throw, from a fit to the others"
CHOSEN = f"each of {PARTS} parts of the throw, from the best of the strings tried for the others"


def without_model(whole: FitObjective) -> dict[str, float]:
    """E of a trial for guesses that need no model, to compare predictions with [m].

    The string hangs straight below the hand, or it keeps its first shape and moves with the hand; between two
    driven ends with both, by the place along the string.
    """
    (throw,), along = whole.throws, np.linspace(0.0, 1.0, whole.model.points + 1)[:, None]
    axes, path_m = throw.points_m.shape[2], throw.hand.pose
    frames_m = resampled(throw.time_s, throw.hand.time_s, path_m)
    far = slice(-POSE, path_m.shape[1] - POSE + axes) if axes == 3 else slice(axes)
    guesses = {}
    if path_m.shape[1] <= POSE:
        down = np.eye(axes)[-1] * -whole.model.length_m
        guesses[HANGING] = frames_m[:, None, :axes] + along * down
    if throw.start.points_m is not None:
        first = np.concatenate([path_m[:1, :axes], throw.start.points_m])
        near_moved, far_moved = ((frames_m - path_m[0])[:, None, end] for end in (slice(axes), far))
        guesses[CARRIED] = first + (1.0 - along) * near_moved + along * far_moved
    return {
        what: float(evaluation_of_points(whole.point_values(throw, throw.as_measured(each))))
        for what, each in guesses.items()
    }


class Fold(NamedTuple):
    """A fit that leaves data out, and what it leaves out."""

    rest: FitObjective
    left_out: tuple[PreparedThrow, ...]


def refitted(objective: FitObjective, log: EvaluationLog, evaluations: int) -> float:
    """Return E of each part of the throw, left out of the fit, under the string that is fitted without it.

    These fits start at the result of the whole one and share `evaluations`. After few steps they still depend
    on the part that was left out, so that the error is too small. NaN if no step is affordable, or none of
    the fits moves: then no part is held out.
    """
    best, ends = log.best()[0], []
    if evaluations // PARTS - 1 < len(best) + 1 + len(LADDER):
        return float("nan")
    parts = _parts(objective.throws[-1])
    for part in parts:
        fold = replace(objective, throws=(*objective.throws[:-1], _without(objective.throws[-1], part)))
        own = EvaluationLog(fold.cost)
        now = descent_batch(best[None], own(best[None]))
        ends.append(descend(own, GaussNewtonModel(fold), now, evaluations // PARTS - 1).chi[0])
        log.count += own.count
    moved = any((end != best).any() for end in ends)
    return _mean(objective, parts, ends) if moved else float("nan")


def reselected(objective: FitObjective, log: EvaluationLog) -> float:
    """Return E of each part, left out of the choice among the best strings: for searches that only select."""
    chi, values = log.all()
    tried = chi[np.argsort(values, kind="stable")[:CHOSEN_FROM]]
    parts = _parts(objective.throws[-1])
    simulated, _ = simulate_throw(objective.model, objective.throws[-1], objective.space.strings(tried))
    log.count += len(tried)
    ends = []
    for part in parts:
        rest = _without(objective.throws[-1], part)
        error = evaluation_of_points(objective.point_values(rest, simulated), objective.w)
        ends.append(tried[int(np.argmin(np.where(np.isfinite(error), error, np.inf)))])
    return _mean(objective, parts, ends)


def folds_of(objective: FitObjective, parts: TrialParts) -> list[Fold]:
    """Return fits that leave trials out, each once.

    With too few trials, parts of the fit are left out, e.g. windows of a long recording; with too few of
    these, quarters of each.
    """
    throws, shares, first = objective.throws, objective.shares, parts.trials - len(parts.whole)
    for groups, whole in ((parts.trial - first, parts.whole), (np.arange(len(throws)), throws)):
        if len(whole) >= FEWEST_GROUPS:
            folds = []
            for out in np.array_split(np.arange(len(whole)), PARTS):
                kept = ~np.isin(groups, out)
                rows = list(zip(throws, kept, parts.trial, strict=True))
                if shares[kept].sum() > 0.0 and len(out):
                    unread = {
                        number: np.concatenate([t.frames for t, k, n in rows if not k and n == number])
                        for number in np.unique(parts.trial[~kept])
                    }
                    rest = tuple(_unread(t, unread.get(number)) for t, k, number in rows if k)
                    fit = replace(objective, throws=rest, shares=shares[kept] / shares[kept].sum())
                    folds.append(Fold(fit, tuple(whole[row] for row in out)))
            return folds
    folds = []
    for k in range(PARTS):
        left = tuple(throw.part(k, PARTS) for throw in throws)
        rest = tuple(_without(throw, part) for throw, part in zip(throws, left, strict=True))
        folds.append(Fold(replace(objective, throws=rest), left))
    return folds


def _unread(throw: PreparedThrow, frames: np.ndarray | None) -> PreparedThrow:
    """Return a throw without the weights of frames of its trial, which other parts of it may have too."""
    if frames is None:
        return throw
    return replace(throw, weight=np.where(np.isin(throw.frames, frames)[:, None], 0.0, throw.weight))


def fold_errors(folds: Sequence[Fold], chi: Array) -> Array:
    """Return E of all that the folds leave out (K,) [m], by descents from the whole fit `chi` (d,)."""
    errors = []
    for fold, left in folds:
        log = EvaluationLog(fold.cost)
        now = descent_batch(chi[None], log(chi[None]))
        effort = FOLD_ROUNDS * (len(chi) + 1 + len(LADDER))
        string = fold.space.strings(descend(log, GaussNewtonModel(fold), now, effort, FOLD_ROUNDS).chi)
        errors += [float(fold.value(throw, string, 0.0)[0]) for throw in left]
    return np.array(errors)


def last_part(whole: FitObjective, newest: PreparedThrow, first: int, chi: Array) -> float:
    """Return E of the frames from `first` on, simulated from the beginning, under `chi` (d,) without them."""
    weight = newest.weight.copy()
    weight[:first] = 0.0
    if not weight.any():
        return float("nan")
    return float(whole.value(replace(newest, weight=weight), whole.space.strings(chi), 0.0)[0])


def _parts(throw: PreparedThrow) -> list[PreparedThrow]:
    """Return the parts of a throw that contain a measured point and leave one in the rest."""
    parts = [throw.part(k, PARTS) for k in range(PARTS)]
    return [part for part in parts if part.weight.any() and (throw.weight > part.weight).any()]


def _without(throw: PreparedThrow, part: PreparedThrow) -> PreparedThrow:
    return replace(throw, weight=throw.weight - part.weight)


def _mean(objective: FitObjective, parts: list[PreparedThrow], ends: list[Array]) -> float:
    """Return the mean of E on each part under the string found without it, by weight; NaN without parts."""
    if not parts:
        return float("nan")
    errors = [
        float(objective.value(part, objective.space.strings(chi), 0.0)[0])
        for part, chi in zip(parts, ends, strict=True)
    ]
    return float(np.average(errors, weights=[part.weight.sum() for part in parts]))
