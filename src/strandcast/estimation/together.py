"""One fit of several experiments that share a string: what it has in common, and what each has of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import StringBatch
from strandcast.dynamics.masses import mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit import disagreement
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.masses import with_masses
from strandcast.estimation.optimisers.optimiser import SearchStart
from strandcast.estimation.search import search, search_budget
from strandcast.estimation.space import Space
from strandcast.estimation.throws import PreparedThrow, TrialParts
from strandcast.estimation.uncertainty import Uncertainty, uncertainty_of

OWN = "@"  # between an unknown's name and its experiment's


class Member(NamedTuple):
    """An experiment: what is fitted of its trials, and the box of its unknowns."""

    parts: TrialParts
    space: Space


@dataclass(frozen=True, eq=False)
class JointObjective(FitObjective):
    """The function that a joint fit minimises: each throw has the string of its experiment.

    Attributes
    ----------
    boxes, rows
        The unknowns of each experiment, and where they are among those of the joint fit (d_k,).
    owner
        (P,) experiment of each throw.
    """

    boxes: tuple[Space, ...]
    rows: tuple[np.ndarray, ...]
    owner: np.ndarray

    def strings_by_throw(self, chi: Array) -> Iterator[tuple[PreparedThrow, float, StringBatch]]:
        """Yield each throw with its share in E and its candidate strings."""
        chi = np.atleast_2d(chi)
        strings = [box.strings(chi[:, rows]) for box, rows in zip(self.boxes, self.rows, strict=True)]
        for throw, share, owner in zip(self.throws, self.shares, self.owner, strict=True):
            yield throw, share, strings[owner]


class JointFit(NamedTuple):
    """A joint fit: the unknowns, the best exponents (d,), and how well they are known."""

    objective: JointObjective
    log: EvaluationLog
    uncertainty: Uncertainty
    warnings: list[str]

    def error_m(self, owner: int) -> float:
        """Return E of one experiment's throws [m]."""
        rows = np.flatnonzero(self.objective.owner == owner)
        throws = tuple(self.objective.throws[row] for row in rows)
        shares = self.objective.shares[rows] / self.objective.shares[rows].sum()
        own = replace(self.objective, throws=throws, shares=shares, owner=self.objective.owner[rows])
        return float(own.evaluate(self.log.best()[0])[0])


def fit_together(
    members: Mapping[str, Member],
    model: StringModel,
    settings: EstimateSettings,
    rng: np.random.Generator,
    searches: int,
) -> JointFit:
    """Fit a string to the trials of several experiments, by name; each counts as much as the others.

    Weights, and what may be negative (turns, curls, changes of length), are each experiment's own: the string
    is clamped again. All else is the string's.
    """
    objective = _joint(members, model, settings)
    budget, start = search_budget(objective, settings), SearchStart(None, len(objective.throws))
    log, *others = (search(objective, settings, own, start, budget) for own in rng.spawn(searches))
    for other in others:
        log.join(other)
    uncertainty = with_masses(uncertainty_of(objective, log, profiles=True, long=True), objective, log)
    return JointFit(objective, log, uncertainty, disagreement(log))


def _joint(members: Mapping[str, Member], model: StringModel, settings: EstimateSettings) -> JointObjective:
    names: dict[str, tuple[Array, float]] = {}
    throws: list[PreparedThrow] = []
    rows, shares, owner = [], [], []
    for k, (experiment, (parts, space)) in enumerate(members.items()):
        linear = space.is_linear().tolist()
        own = [is_own or name.startswith("weight_") for name, is_own in zip(space.names, linear, strict=True)]
        joint = [f"{name}{OWN}{experiment}" if own[i] else name for i, name in enumerate(space.names)]
        for i, name in enumerate(joint):
            names.setdefault(name, (space.bounds[i], space.prior_sd[i]))
        rows.append(np.array([list(names).index(name) for name in joint]))
        throws += parts.throws
        shares.append(parts.shares(settings.older_trials_weight) / len(members))
        owner += [k] * len(parts.throws)
    bounds, prior_sd = (np.array(column) for column in zip(*names.values(), strict=True))
    first = next(iter(members.values())).space
    layout = mass_layout(model.length_m, model.points, [], [])
    return JointObjective(
        model,
        replace(first, names=tuple(names), bounds=bounds, layout=layout, prior_sd=prior_sd),
        tuple(throws),
        np.concatenate(shares),
        settings.evaluation,
        overstretched_allowed=not first.in_plane,
        boxes=tuple(
            replace(member.space, bounds=bounds[own], prior_sd=prior_sd[own])
            for member, own in zip(members.values(), rows, strict=True)
        ),
        rows=tuple(rows),
        owner=np.array(owner),
    )
