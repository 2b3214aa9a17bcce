"""E of candidate strings over all throws of the fit, counted and remembered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from strandcast.estimation.evaluation import Array, distances, point_values
from strandcast.estimation.space import Space, Strings
from strandcast.estimation.throw import Task
from strandcast.string.hand import places
from strandcast.string.model import StringModel
from strandcast.string.simulate import BLEW_UP, OK, evaluate_batch, simulate_batch


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
        result, status = evaluate_batch(
            self.model,
            strings.parameters,
            strings.masses,
            task.hand_time_s,
            task.hand_pose,
            task.time_s,
            self.compared(task),
            self.per_metre(task, self.w if w is None else w),
            task.start_m,
            task.start_velocity_m_s,
            rest_curl_rad_m=strings.rest_curl_rad_m,
            clamp_offset_rad=strings.clamp_offset_rad,
            bend_factor=strings.bend_factor,
            bend_friction=strings.bend_friction,
            shift_m=None if self.reading == "hand" else strings.shift_m,
        )
        allowed = (status == OK) | (self.overstretched_allowed & (status != BLEW_UP))
        return np.where(allowed & np.isfinite(result), result, np.inf)

    def compared(self, task: Task) -> Array:
        """Measured points 1…n (G, n, 2), moved to the robot's hand where E is relative to it."""
        points = task.points_m[:, 1:]
        if self.reading != "hand":
            return points
        hand = np.empty((len(task.time_s), 2))
        places(task.hand_time_s, task.hand_pose, task.time_s, hand)
        off = task.points_m[:, 0] - hand
        return np.asarray(points - np.where(np.isnan(off), 0.0, off)[:, None])

    def per_metre(self, task: Task, w: float) -> Array:
        """Weight of each distance in E of one throw, eqs. (5) and (6): (G, n)."""
        total = task.weight.sum(axis=0)
        point = (1.0 + w * np.arange(len(total))) / np.maximum(total, 1e-300) / max((total > 0).sum(), 1)
        return np.asarray(task.weight * point)

    def point_values(self, task: Task, simulated: Array) -> Array:
        """E_i of simulated points (..., G, n+1, 2): (..., n) [m]."""
        return point_values(distances(task.points_m, simulated, self.reading), task.weight)

    def cost(self, chi: Array) -> Array:
        """E of candidates (B, d) and what their deviations from the priors cost: (B,) [m]."""
        return np.asarray(self.evaluate(chi) + self.space.penalty(chi))

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
            weights.append(share * self.per_metre(task, self.w)[used])
        return np.concatenate(parts, axis=1), np.concatenate(weights)

    def thinned(self, most: int) -> Objective:
        """Return this objective with at most `most` frames of each throw: for slopes, not for E."""
        return replace(self, tasks=tuple(task.thinned(most) for task in self.tasks))


def play(model: StringModel, task: Task, strings: Strings) -> tuple[Array, NDArray[np.int64]]:
    """Simulate candidate strings on one throw, as the camera sees them: (B, G, n+1, 2) [m], (B,) status."""
    points, status = simulate_batch(
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
        bend_factor=strings.bend_factor,
        bend_friction=strings.bend_friction,
    )
    if strings.shift_m.any():
        points = points + strings.shift_m[:, None, None]
    return points, status


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
    converged
        Whether the search that wrote here ended because nothing gained any more.
    """

    evaluate: Callable[[Array], Array]
    tell: Callable[[int, float], None] = lambda count, best: None
    chi: list[Array] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    at: list[Array] = field(default_factory=list)
    count: int = 0
    converged: bool = False

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
