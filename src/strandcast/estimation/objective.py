"""E of candidate strings over all throws of the fit, counted and remembered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from strandcast.estimation.evaluation import Array, distances, evaluation_of_points, point_values
from strandcast.estimation.space import Space, Strings
from strandcast.estimation.throw import Task
from strandcast.string.integrators import BLEW_UP, OK
from strandcast.string.model import StringModel
from strandcast.string.simulate import simulate_batch


@dataclass(frozen=True, eq=False)
class Objective:
    """What is minimised.

    Attributes
    ----------
    model, space
        The string model and the unknowns.
    tasks, shares
        The throws of the fit and their shares in E, which sum to 1.
    w, reading
        Weight of eq. (6) and the frame of reference of eq. (4).
    overstretched_allowed
        Whether a string longer than 3 l0 in a segment may be chosen; one that blew up never may.
    """

    model: StringModel
    space: Space
    tasks: tuple[Task, ...]
    shares: Array
    w: float
    reading: str
    overstretched_allowed: bool

    def evaluate(self, chi: Array) -> Array:
        """E of candidates (B, d): (B,) [m], infinite where the simulation is invalid."""
        strings = self.space.strings(chi)
        total = np.zeros(len(strings))
        for task, share in zip(self.tasks, self.shares, strict=True):
            total += share * self.value(task, strings)
        return np.where(np.isfinite(total), total, np.inf)

    def value(self, task: Task, strings: Strings, w: float | None = None) -> Array:
        """E of strings on one throw: (B,) [m], infinite where invalid."""
        simulated, status = play(self.model, task, strings)
        values = self.point_values(task, simulated)
        result = evaluation_of_points(values, self.w if w is None else w)
        allowed = (status == OK) | (self.overstretched_allowed & (status != BLEW_UP))
        return np.where(allowed & np.isfinite(result), result, np.inf)

    def point_values(self, task: Task, simulated: Array) -> Array:
        """E_i of simulated points (..., G, n+1, 2): (..., n) [m]."""
        return point_values(distances(task.points_m, simulated, self.reading), task.weight)

    def residuals(self, chi: Array) -> tuple[Array, Array]:
        """Differences and their weights, such that E is the sum of weight times length of difference.

        Returns
        -------
        differences
            (B, R, 2) measured minus simulated [m] of every point seen in a used frame of every throw; NaN
            where the simulation failed.
        weights
            (R,).
        """
        strings = self.space.strings(chi)
        parts, weights = [], []
        for task, share in zip(self.tasks, self.shares, strict=True):
            used = task.weight > 0
            simulated, _ = play(self.model, task, strings)
            difference = task.points_m - simulated
            if self.reading == "hand":
                hand = difference[..., :1, :]
                difference = difference - np.where(np.isnan(hand), 0.0, hand)
            parts.append(difference[:, :, 1:][:, used])
            total = task.weight.sum(axis=0)
            point = (1.0 + self.w * np.arange(len(total))) / np.maximum(total, 1e-300) / (total > 0).sum()
            weights.append(share * (task.weight * point)[used])
        return np.concatenate(parts, axis=1), np.concatenate(weights)


def play(model: StringModel, task: Task, strings: Strings) -> tuple[Array, NDArray[np.int64]]:
    """Simulate candidate strings on one throw: (B, G, n+1, 2) [m] and (B,) status."""
    return simulate_batch(
        model,
        strings.parameters,
        strings.masses,
        task.hand_time_s,
        task.hand_pose,
        task.time_s,
        task.start_m,
        task.start_velocity_m_s,
        rest_curl_rad_m=strings.rest_curl_rad_m,
        clamp_offset_rad=strings.clamp_offset_rad,
    )


@dataclass(eq=False)
class Ledger:
    """All candidates evaluated so far, in order; searches draw on it and write to it.

    Attributes
    ----------
    evaluate
        E of candidates (B, d).
    tell
        Called with the number of evaluations and the best E after each batch.
    chi, values, at
        Batches of candidates, their E, and how many evaluations each of them was.
    count
        Strings simulated so far, those for derivatives included.
    """

    evaluate: Callable[[Array], Array]
    tell: Callable[[int, float], None] = lambda count, best: None
    chi: list[Array] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    at: list[Array] = field(default_factory=list)
    count: int = 0

    def __call__(self, chi: Array) -> Array:
        """Evaluate candidates (B, d), each clipped to [0, 1], and remember them."""
        clipped = np.clip(chi, 0.0, 1.0)
        values = self.evaluate(clipped)
        values = np.where(np.isnan(values), np.inf, values)
        self.chi.append(clipped)
        self.values.append(values)
        self.at.append(self.count + np.arange(1.0, len(values) + 1))
        self.count += len(values)
        self.tell(self.count, self.best()[1])
        return values

    def all(self) -> tuple[Array, Array]:
        """Return all candidates (N, d) and their E (N,)."""
        return np.concatenate(self.chi), np.concatenate(self.values)

    def best(self) -> tuple[Array, float]:
        """Return the best candidate (d,) and its E; a NaN never wins."""
        chi, values = self.all()
        k = int(np.argmin(values))
        return chi[k], float(values[k])

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
