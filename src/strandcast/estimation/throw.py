"""One measured throw as arrays, and what a simulation of it needs: where and how the string started."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.estimation.evaluation import Array

HAND_MOVED_M, HAND_TURNED_RAD, POINT_MOVED_M = 0.002, 0.01, 0.008
LEAD_S = 0.03
REST_WINDOW_S = 0.06
MOVING_WINDOW_S = 0.012
MOVING_FRAMES = 4
REST_FRAMES = 4


@dataclass(frozen=True, eq=False)
class Throw:
    """What was measured of one trial, on the robot's clock.

    Attributes
    ----------
    time_s
        (F,) time of each frame [s].
    points_m
        (F, n+1, 2) measured points [m], the hand first, NaN where not seen.
    hand_time_s, hand_pose
        (T,) and (T, 3): the hand's path, x, y [m] and the direction of the clamp [rad], unwrapped.
    used
        (F,) frames that enter E: up to the closest approach or the first contact.
    confidence
        (F, n+1) weights of the measured points, or None for equal ones.
    """

    time_s: Array
    points_m: Array
    hand_time_s: Array
    hand_pose: Array
    used: np.ndarray
    confidence: Array | None = None


@dataclass(frozen=True, eq=False)
class Task:
    """A throw cut to what is simulated: from shortly before the motion to the last frame.

    Attributes
    ----------
    frames
        (G,) indices of the throw's frames that are simulated.
    time_s, points_m, weight
        (G,), (G, n+1, 2) and (G, n): their times, measured points, weights in E (0 for frames not used).
    hand_time_s, hand_pose
        The hand's path from the start on.
    start_m, start_velocity_m_s
        (n, 2) observed shape and velocity at the start, or None for hanging at rest.
    """

    frames: np.ndarray
    time_s: Array
    points_m: Array
    weight: Array
    hand_time_s: Array
    hand_pose: Array
    start_m: Array | None
    start_velocity_m_s: Array | None

    def until(self, share: float) -> Task:
        """Return this task with the first `share` of its used frames, and nothing behind them."""
        used = np.flatnonzero(self.weight.any(axis=1))
        return self.cut(used[max(round(share * len(used)), 1) - 1] + 1)

    def part(self, part: int, parts: int) -> Task:
        """Return this task with only one of `parts` equal spans of its used frames weighted."""
        used = np.flatnonzero(self.weight.any(axis=1))
        span = np.array_split(used, parts)[part]
        weight = np.zeros_like(self.weight)
        weight[span] = self.weight[span]
        return replace(self, weight=weight)

    def fitted(self) -> Task:
        """Return this task without the frames behind the last one used."""
        return self.cut(int(np.flatnonzero(self.weight.any(axis=1))[-1]) + 1)

    def cut(self, frames: int) -> Task:
        """Return the first `frames` frames of this task."""
        return self._with(slice(frames), self.weight[:frames])

    def thinned(self, most: int) -> Task:
        """Return this task with every k-th of its frames, such that at most `most` stay."""
        kept = slice(0, None, max(-(-len(self.time_s) // most), 1))
        return self._with(kept, self.weight[kept])

    def _with(self, kept: slice, weight: Array) -> Task:
        return replace(
            self,
            frames=self.frames[kept],
            time_s=self.time_s[kept],
            points_m=self.points_m[kept],
            weight=weight,
        )


def prepare(
    throw: Throw, places_m: Array, start_shape: str = "observed", *, from_seen_hand: bool = False
) -> Task:
    """Cut a throw to its motion and find how the string started.

    Parameters
    ----------
    throw
        The measured throw.
    places_m
        (n+1,) places of the points along the string [m].
    start_shape
        ``observed``: the directions of the string in the frames before the motion, and its sway; ``hanging``:
        at rest under gravity.
    from_seen_hand
        The observed shape begins at the hand as the camera sees it, not as the robot says: where the offset
        between them is not known.

    Raises
    ------
    StrandcastError
        SC-E002 no used frame lies within the hand's path.
    """
    first = int(np.searchsorted(throw.hand_time_s, motion_start_s(throw) + 1e-9, side="right")) - 1
    first = max(first, 0)
    start_s = throw.hand_time_s[first]
    inside = (throw.time_s >= start_s - 1e-9) & (throw.time_s <= throw.hand_time_s[-1] + 1e-9)
    frames = np.flatnonzero(inside)
    weight = _weights(throw)[frames]
    if not weight.any():
        raise StrandcastError(
            "SC-E002",
            "no frame with a point of the string lies within the logged path of the hand",
            fix="look at the alignment's offset, and at the frames before the first contact",
            exit_code=FAILED_TRIALS,
        )
    start, velocity = (None, None)
    if start_shape == "observed":
        seen_from = moved_to_hand(throw) if from_seen_hand else throw
        start, velocity = observed_start(seen_from, places_m, float(start_s))
    return Task(
        frames,
        throw.time_s[frames],
        throw.points_m[frames],
        weight,
        throw.hand_time_s[first:],
        throw.hand_pose[first:],
        start,
        velocity,
    )


def moved_to_hand(throw: Throw) -> Throw:
    """Return the throw with all points moved by what lies between the hand's path and the hand as seen."""
    path = np.column_stack(
        [np.interp(throw.time_s, throw.hand_time_s, throw.hand_pose[:, c]) for c in (0, 1)]
    )
    inside = (throw.time_s >= throw.hand_time_s[0]) & (throw.time_s <= throw.hand_time_s[-1])
    off = (throw.points_m[:, 0] - path)[inside]
    off = off[~np.isnan(off).any(axis=1)]
    return replace(throw, points_m=throw.points_m - np.median(off, axis=0)) if len(off) else throw


def motion_start_s(throw: Throw) -> float:
    """Time from which on to simulate: shortly before hand or string leave their first places [s]."""
    pose = throw.hand_pose
    moved = np.hypot(*(pose[:, :2] - pose[0, :2]).T) > HAND_MOVED_M
    moved |= np.abs(pose[:, 2] - pose[0, 2]) > HAND_TURNED_RAD
    starts = [throw.hand_time_s[moved][0]] if moved.any() else []
    seen = ~np.isnan(throw.points_m[..., 0])
    for i in range(1, throw.points_m.shape[1]):
        at = np.flatnonzero(seen[:, i])
        if len(at) > REST_FRAMES:
            home = np.median(throw.points_m[at[:REST_FRAMES], i], axis=0)
            away = np.hypot(*(throw.points_m[at, i] - home).T) > POINT_MOVED_M
            # A single stray point is no motion.
            left = away[:-1] & away[1:]
            starts += [throw.time_s[at[:-1][left][0]]] if left.any() else []
    seen_first = throw.time_s[seen.any(axis=1)]
    earliest = max(throw.hand_time_s[0], seen_first[0] if len(seen_first) else throw.time_s[0])
    return float(max(earliest, (min(starts) if starts else earliest) - LEAD_S))


def observed_start(throw: Throw, places_m: Array, start_s: float) -> tuple[Array | None, Array | None]:
    """Shape and velocity of the string at `start_s`, from the frames around it.

    With frames of rest before the start, their mean and one common rate of turning about the hand (sway);
    without, a parabola in time through the first frames of each point.

    Returns
    -------
    (n, 2) positions [m] and (n, 2) velocities [m/s], or None and None if no frame shows the string.
    """
    seen = ~np.isnan(throw.points_m[:, 1:, 0]).all(axis=1)
    before = np.flatnonzero(
        seen & (throw.time_s >= start_s - REST_WINDOW_S) & (throw.time_s <= start_s + 0.5 * LEAD_S)
    )
    resting = len(before) >= REST_FRAMES and throw.time_s[before[0]] < start_s - 0.25 * REST_WINDOW_S
    resting |= len(before) >= REST_FRAMES and motion_start_s(throw) > throw.time_s[before[0]]
    if not resting:
        later = np.flatnonzero(seen & (throw.time_s >= start_s - 1e-9))
        before = later[: max(MOVING_FRAMES, int(np.sum(throw.time_s[later] <= start_s + MOVING_WINDOW_S)))]
    if len(before) == 0:
        return None, None
    shapes = np.array([complete(throw, places_m, int(k)) for k in before])
    after_s = throw.time_s[before] - start_s
    return _resting(shapes, after_s) if resting else _moving(shapes, after_s)


def complete(throw: Throw, places_m: Array, frame: int) -> Array:
    """Shape in one frame with the points not seen filled in along the string: (n+1, 2) [m].

    A spline through the points seen, starting at the hand's path in the clamp's direction where few are seen.
    """
    points = throw.points_m[frame].copy()
    hand = np.array(
        [np.interp(throw.time_s[frame], throw.hand_time_s, throw.hand_pose[:, c]) for c in range(3)]
    )
    if np.isnan(points[0, 0]):
        points[0] = hand[:2]
    known = ~np.isnan(points[:, 0])
    if known.all():
        return points
    clamp = np.array([np.cos(hand[2]), np.sin(hand[2])])
    if known.sum() < 2:
        return np.asarray(points[0] + (places_m[:, None] - places_m[0]) * clamp)
    straight: tuple[Literal[1, 2], Array] = (2, np.zeros(2))
    first: tuple[Literal[1, 2], Array] = (1, clamp) if known.sum() <= len(points) // 2 else straight
    spline = CubicSpline(places_m[known], points[known], bc_type=(first, straight))
    points[~known] = spline(places_m[~known])
    return points


def _resting(shapes: Array, after_s: Array) -> tuple[Array, Array]:
    """Mean shape and the rigid turning about the hand that explains its change."""
    mean, middle_s = shapes.mean(axis=0), after_s.mean()
    arm = mean - mean[0]
    across = np.column_stack([-arm[:, 1], arm[:, 0]])
    moved = shapes - mean
    lever = (arm**2).sum()
    spread = ((after_s - middle_s) ** 2).sum()
    turned = np.einsum("knc,nc->k", moved - moved[:, :1], across) / lever
    rate = float(turned @ (after_s - middle_s) / spread) if spread > 0 else 0.0
    start = mean - rate * middle_s * across
    return start[1:], rate * across[1:]


def _moving(shapes: Array, after_s: Array) -> tuple[Array, Array]:
    """Value and slope at the start of a parabola in time through each point."""
    degree = min(2, len(after_s) - 1)
    flat = np.polynomial.polynomial.polyfit(after_s, shapes.reshape(len(shapes), -1), degree)
    shape = flat[0].reshape(shapes.shape[1:])
    slope = flat[1].reshape(shapes.shape[1:]) if degree else np.zeros_like(shape)
    return shape[1:], slope[1:]


def _weights(throw: Throw) -> Array:
    """(F, n) weights of the free points: confidence where used and seen, else 0."""
    confidence = np.ones(throw.points_m.shape[:2]) if throw.confidence is None else throw.confidence
    seen = ~np.isnan(throw.points_m).any(axis=2)
    return np.asarray(np.where(seen & throw.used[:, None], np.nan_to_num(confidence), 0.0)[:, 1:])
