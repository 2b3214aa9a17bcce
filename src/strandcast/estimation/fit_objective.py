"""E of candidate strings over all throws of the fit, and the log of all evaluations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from strandcast.core.strings import CAMERA_OFFSET, MARKER_SHIFT, StringBatch
from strandcast.dynamics.batch import MeasuredPoints
from strandcast.dynamics.hand import places
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import BLEW_UP, OK, evaluate_batch, simulate_batch
from strandcast.estimation.evaluation import Array, W, differences, distances, point_values
from strandcast.estimation.space import Space
from strandcast.estimation.throws import PreparedThrow


@dataclass(frozen=True, eq=False)
class FitObjective:
    """The function that a fit minimises.

    Attributes
    ----------
    model, space
        The string model and the unknowns.
    throws, shares
        The throws of the fit and their shares in E, which sum to 1.
    reading
        The frame of reference of eq. (4).
    overstretched_allowed
        Whether a string longer than 3 l0 in a segment may be chosen; one that blew up never may.
    """

    model: StringModel
    space: Space
    throws: tuple[PreparedThrow, ...]
    shares: Array
    reading: str
    overstretched_allowed: bool

    @property
    def w(self) -> float:
        """The weight of eq. (6)."""
        return W if self.space.in_plane else 0.0

    def evaluate(self, chi: Array) -> Array:
        """E of candidates (B, d): (B,) [m], infinite where the simulation is invalid."""
        total = np.zeros(len(np.atleast_2d(chi)))
        for throw, share, strings in self.strings_by_throw(chi):
            total += share * self.value(throw, strings)
        return np.where(np.isfinite(total), total, np.inf)

    def strings_by_throw(self, chi: Array) -> Iterator[tuple[PreparedThrow, float, StringBatch]]:
        """Yield each throw with its share in E and the candidate strings."""
        strings = self.space.strings(chi)
        for throw, share in zip(self.throws, self.shares, strict=True):
            yield throw, share, strings

    def value(self, throw: PreparedThrow, strings: StringBatch, w: float | None = None) -> Array:
        """E of strings on one throw: (B,) [m], infinite where invalid."""
        weight = self.per_metre(throw, self.w if w is None else w)
        if throw.places is not None:  # markers lie between mass points
            simulated, status = simulate_throw(self.model, throw, strings)
            distance = distances(throw.points_m, simulated, self.reading)
            result = (weight * np.where(weight > 0, distance, 0.0)).sum(axis=(1, 2))
        else:
            measured = MeasuredPoints(throw.time_s, self.compared(throw), weight)
            shift_m = None if self.reading == "hand" else camera_offset_m(strings)
            result, status = evaluate_batch(
                self.model, strings, throw.hand, measured, throw.start, shift_m=shift_m
            )
        allowed = (status == OK) | (self.overstretched_allowed & (status != BLEW_UP))
        return np.where(allowed & np.isfinite(result), result, np.inf)

    def compared(self, throw: PreparedThrow) -> Array:
        """Measured points 1…n (G, n, 2 or 3), moved to the robot's hand where E is relative to it."""
        points = throw.points_m[:, 1:]
        if self.reading != "hand":
            return points
        hand = np.empty((len(throw.time_s), points.shape[-1]))
        places(*throw.hand, throw.time_s, hand)
        off = throw.points_m[:, 0] - hand
        return np.asarray(points - np.where(np.isnan(off), 0.0, off)[:, None])

    def per_metre(self, throw: PreparedThrow, w: float) -> Array:
        """Weight of each distance in E of one throw, eqs. (5) and (6): (G, n)."""
        total = throw.weight.sum(axis=0)
        point = (1.0 + w * np.arange(len(total))) / np.maximum(total, 1e-300) / max((total > 0).sum(), 1)
        return np.asarray(throw.weight * point)

    def point_values(self, throw: PreparedThrow, simulated: Array) -> Array:
        """E_i of simulated points (..., G, n+1, 2 or 3): (..., n) [m]."""
        return point_values(distances(throw.points_m, simulated, self.reading), throw.weight)

    def cost(self, chi: Array) -> Array:
        """E of candidates (B, d), plus the penalty of their deviations from the priors: (B,) [m]."""
        return np.asarray(self.evaluate(chi) + self.space.penalty(chi))

    def residuals(self, chi: Array) -> tuple[Array, Array]:
        """Differences and their weights, such that E is the sum of weight times length of difference.

        Returns
        -------
        differences
            (B, R, 2 or 3) measured minus simulated [m] of every point measured in a used frame of every
            throw; NaN where the simulation failed.
        weights
            (R,).
        """
        parts, weights = [], []
        for throw, share, strings in self.strings_by_throw(chi):
            used = throw.weight > 0
            simulated, _ = simulate_throw(self.model, throw, strings)
            parts.append(differences(throw.points_m, simulated, self.reading)[:, :, 1:][:, used])
            weights.append(share * self.per_metre(throw, self.w)[used])
        return np.concatenate(parts, axis=1), np.concatenate(weights)

    def thinned(self, most: int) -> FitObjective:
        """Return this objective with at most `most` frames of each throw: for derivatives, not for E."""
        return replace(self, throws=tuple(throw.thinned(most) for throw in self.throws))


def simulate_throw(
    model: StringModel, throw: PreparedThrow, strings: StringBatch
) -> tuple[Array, NDArray[np.int64]]:
    """Simulate candidate strings on one throw, as it was measured: (B, G, n+1, 2 or 3) [m], (B,) status."""
    points, status = simulate_batch(model, strings, throw.hand, throw.time_s, throw.start)
    points = throw.as_measured(points, strings[MARKER_SHIFT])
    offset_m = camera_offset_m(strings)
    return points if offset_m is None else points + offset_m[:, None, None], status


def camera_offset_m(strings: StringBatch) -> Array | None:
    """Return the offset of the camera's positions from the robot's (B, 2) [m]; None without."""
    offset_m = np.column_stack([strings[name] for name in CAMERA_OFFSET])
    return offset_m if offset_m.any() else None


@dataclass(eq=False)
class EvaluationLog:
    """All candidates evaluated so far, in order; a search evaluates by calling it.

    Attributes
    ----------
    evaluate
        E of candidates (B, d).
    report
        Called with the number of evaluations and the best E after each batch.
    chi, values, at
        Batches of candidates, their E, and how many evaluations each of them was.
    count
        Strings simulated so far, those for derivatives included.
    converged
        Whether the search ended because nothing improved any more.
    ends
        Costs at which independent searches ended, if there were several.
    found
        The best candidate (d,) so far, and its E.
    """

    evaluate: Callable[[Array], Array]
    report: Callable[[int, float], None] = lambda count, best: None
    chi: list[Array] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    at: list[Array] = field(default_factory=list)
    count: int = 0
    converged: bool = False
    ends: list[float] = field(default_factory=list)
    found: tuple[Array, float] | None = None

    def __call__(self, chi: Array) -> Array:
        """Evaluate candidates (B, d), each clipped to [0, 1], and remember them."""
        clipped = np.clip(chi, 0.0, 1.0)
        values = self.evaluate(clipped)
        values = np.where(np.isnan(values), np.inf, values)
        self.chi.append(clipped)
        self.values.append(values)
        self.at.append(self.count + np.arange(1.0, len(values) + 1))
        self.count += len(values)
        if len(values):
            k = int(np.argmin(values))
            if self.found is None or values[k] < self.found[1]:
                self.found = clipped[k], float(values[k])
        self.report(self.count, self.best()[1])
        return values

    def all(self) -> tuple[Array, Array]:
        """Return all candidates (N, d) and their E (N,)."""
        return np.concatenate(self.chi), np.concatenate(self.values)

    def join(self, other: EvaluationLog) -> None:
        """Add another search's candidates after those of this one, which has converged if the better has."""
        if not self.ends:
            self.ends.append(self.best()[1])
        self.ends.append(other.best()[1])
        if other.best()[1] < self.best()[1]:
            self.found, self.converged = other.found, other.converged
        self.chi, self.values = self.chi + other.chi, self.values + other.values
        self.at += [self.count + at for at in other.at]
        self.count += other.count

    def best(self) -> tuple[Array, float]:
        """Return the best candidate (d,) and its E; a NaN never wins."""
        if self.found is None:
            raise ValueError("nothing was evaluated")
        return self.found

    def rejected(self) -> int:
        """Return how many candidates were invalid."""
        return int(sum(np.sum(~np.isfinite(batch)) for batch in self.values))

    def convergence(self) -> tuple[Array, Array]:
        """Return evaluations and best E at every improvement."""
        values = self.all()[1]
        best = np.minimum.accumulate(values)
        better = np.flatnonzero(np.isfinite(best) & (best < np.r_[np.inf, best[:-1]]))
        at = np.unique(np.r_[better, len(values) - 1])
        return np.concatenate(self.at)[at], best[at]
