"""One measured throw as arrays: when it starts, and with which shape and velocity of the string."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from strandcast.dynamics.batch import HANGING_AT_REST, StringStart
from strandcast.estimation.evaluation import Array

# All chosen.
HAND_MOVED_M, HAND_TURNED_RAD, POINT_MOVED_M = 0.002, 0.01, 0.008
LEAD_S = 0.03
REST_WINDOW_S = 0.06
MOVING_WINDOW_S = 0.012
MOVING_FRAMES = 4
REST_FRAMES = 4


@dataclass(frozen=True, eq=False)
class Throw:
    """The measurements of one trial, on the robot's clock.

    Attributes
    ----------
    time_s
        (F,) time of each frame [s].
    points_m
        (F, n+1, 2) measured points [m], the hand first, NaN where not measured.
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

    def hand_at(self, time_s: Array) -> Array:
        """Return the hand's path at times (...), linear between its samples: (..., 3)."""
        return np.stack([np.interp(time_s, self.hand_time_s, column) for column in self.hand_pose.T], axis=-1)


def moved_to_hand(throw: Throw) -> Throw:
    """Return the throw with all points shifted by the offset of the measured hand from its path."""
    inside = (throw.time_s >= throw.hand_time_s[0]) & (throw.time_s <= throw.hand_time_s[-1])
    off = (throw.points_m[:, 0] - throw.hand_at(throw.time_s)[:, :2])[inside]
    off = off[~np.isnan(off).any(axis=1)]
    return replace(throw, points_m=throw.points_m - np.median(off, axis=0)) if len(off) else throw


def motion_start_s(throw: Throw) -> float:
    """Return when to start the simulation: shortly before hand or string leave their first places [s]."""
    pose = throw.hand_pose
    moved = np.hypot(*(pose[:, :2] - pose[0, :2]).T) > HAND_MOVED_M
    moved |= np.abs(pose[:, 2] - pose[0, 2]) > HAND_TURNED_RAD
    starts = [throw.hand_time_s[moved][0]] if moved.any() else []
    measured = ~np.isnan(throw.points_m[..., 0])
    for i in range(1, throw.points_m.shape[1]):
        at = np.flatnonzero(measured[:, i])
        if len(at) > REST_FRAMES:
            home = np.median(throw.points_m[at[:REST_FRAMES], i], axis=0)
            away = np.hypot(*(throw.points_m[at, i] - home).T) > POINT_MOVED_M
            # A single outlier is no motion.
            left = away[:-1] & away[1:]
            starts += [throw.time_s[at[:-1][left][0]]] if left.any() else []
    first_frame = int(measured.any(axis=1).argmax())
    earliest = max(throw.hand_time_s[0], throw.time_s[first_frame])
    return float(max(earliest, (min(starts) if starts else earliest) - LEAD_S))


def observed_start(throw: Throw, places_m: Array, start_s: float) -> StringStart:
    """Shape and velocity of the string at `start_s`, from the frames around it.

    With frames of rest before the start, their mean and one common rate of turning about the hand (sway);
    without, a parabola in time through the first frames of each point. Hanging at rest if the string is in no
    frame.
    """
    measured = ~np.isnan(throw.points_m[:, 1:, 0]).all(axis=1)
    before = np.flatnonzero(
        measured & (throw.time_s >= start_s - REST_WINDOW_S) & (throw.time_s <= start_s + 0.5 * LEAD_S)
    )
    resting = len(before) >= REST_FRAMES and throw.time_s[before[0]] < start_s - 0.25 * REST_WINDOW_S
    resting |= len(before) >= REST_FRAMES and motion_start_s(throw) > throw.time_s[before[0]]
    if not resting:
        later = np.flatnonzero(measured & (throw.time_s >= start_s - 1e-9))
        before = later[: max(MOVING_FRAMES, int(np.sum(throw.time_s[later] <= start_s + MOVING_WINDOW_S)))]
    if len(before) == 0:
        return HANGING_AT_REST
    shapes = np.array([complete(throw, places_m, int(k)) for k in before])
    after_s = throw.time_s[before] - start_s
    return StringStart(*(_resting if resting else _moving)(shapes, after_s))


def complete(throw: Throw, places_m: Array, frame: int) -> Array:
    """Return the shape in one frame with missing points interpolated along the string: (n+1, 2) [m].

    A spline through the measured points; if there are few, it starts at the hand's path in the clamp's
    direction.
    """
    points = throw.points_m[frame].copy()
    hand = throw.hand_at(throw.time_s[frame])
    if np.isnan(points[0, 0]):
        points[0] = hand[:2]
    known = ~np.isnan(points[:, 0])
    if known.all():
        return np.asarray(points)
    clamp = np.array([np.cos(hand[2]), np.sin(hand[2])])
    if known.sum() < 2:
        return np.asarray(points[0] + (places_m[:, None] - places_m[0]) * clamp)
    straight: tuple[Literal[1, 2], Array] = (2, np.zeros(2))
    first: tuple[Literal[1, 2], Array] = (1, clamp) if known.sum() <= len(points) // 2 else straight
    spline = CubicSpline(places_m[known], points[known], bc_type=(first, straight))
    points[~known] = spline(places_m[~known])
    return np.asarray(points)


def _resting(shapes: Array, after_s: Array) -> tuple[Array, Array]:
    """Return the mean shape and velocities of the rigid turning about the hand that explains its change."""
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
    """Return value and slope at the start of a parabola in time through each point."""
    shape, slope = value_and_slope(after_s, shapes)
    return shape[1:], slope[1:]


def value_and_slope(since_s: Array, path: Array) -> tuple[Array, Array]:
    """Return value and slope (...) at 0 of a parabola through a path (k, ...), a line through two frames."""
    degree = min(2, len(since_s) - 1)
    fitted = np.polynomial.polynomial.polyfit(since_s, path.reshape(len(path), -1), degree)
    value = fitted[0].reshape(path.shape[1:])
    return value, fitted[1].reshape(path.shape[1:]) if degree else np.zeros_like(value)
