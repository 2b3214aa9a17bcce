"""Random motions within the arm's limits (section V of the paper)."""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from strandcast.arm.dynamics import NO_DYNAMICS, Dynamics
from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError
from strandcast.planning.bezier import (
    Curve,
    paper_heights,
    rest_heights,
    sample,
    whole_steps,
    with_stop_ramp,
)
from strandcast.planning.paths import WITHIN, Curves, paths_of, paths_of_any

MOST_DRAWS = 20_000  # chosen: seconds, before the limits are said to leave no room
BATCH = 256
# A motion that asks for too much torque is slowed by this factor, so often at most; chosen.
SLOWED, SLOWING = 0.8, 8

FREE_HEIGHTS = 6  # of each joint's velocity curve, not zero; chosen, the paper does not give its N
Reading = Literal["rest", "paper"]


class CurvePrior(NamedTuple):
    """Which random curves to draw.

    Attributes
    ----------
    reading
        ``rest`` or ``paper`` (see `strandcast.planning.bezier`).
    duration_s
        Shortest and longest time of the curve [s].
    largest_slope_rad_s2
        The slopes alpha_k of eq. 1 are uniform within this.
    """

    reading: Reading
    duration_s: tuple[float, float]
    largest_slope_rad_s2: float


class JointBounds(NamedTuple):
    """The arm with its limits, the dynamics that give the joints' torques, and the time step [s]."""

    arm: Arm
    step_s: float
    dynamics: Dynamics = NO_DYNAMICS

    def keeps(self, curve: Curve) -> bool:
        """Whether a motion keeps all the limits."""
        paths = paths_of_any([curve], self.step_s, dynamics=self.dynamics)
        return bool(paths.excess(self.arm)[0] == 0.0)

    def stopping(self, curve: Curve, reading: Reading) -> Curve | None:
        """Return the curve with its stop ramp if it needs one; None if the arm cannot stop."""
        if reading == "rest":
            return curve
        return with_stop_ramp(curve, self.arm.limits.acceleration_rad_s2, self.step_s)


def anywhere(q0: np.ndarray) -> np.ndarray:
    """Allow every start posture (P, J): return (P,) true."""
    return np.ones(len(q0), bool)


def draw_first(
    count: int,
    prior: CurvePrior,
    bounds: JointBounds,
    rng: np.random.Generator,
    may_start: Callable[[np.ndarray], np.ndarray] = anywhere,
) -> list[Curve]:
    """Return random motions from random postures, all within the arm's limits.

    `may_start` returns which of the postures (P, J) a motion may start from: (P,).

    Raises
    ------
    StrandcastError
        SC-P004: the limits leave no room for such motions.
    """
    found: list[Curve] = []
    draws = max(MOST_DRAWS, 20 * count)
    for _ in range(draws if prior.reading == "paper" else -(-draws // BATCH)):
        if prior.reading == "paper":
            found += _by_paper(prior, bounds, rng)
        else:
            found += _at_rest(prior, bounds, rng, may_start)
        if len(found) >= count:
            return found[:count]
    raise _too_few(len(found), count, prior.reading)


def _too_few(found: int, count: int, reading: Reading) -> StrandcastError:
    how, first_fix = "by eq. 1 kept the arm's limits", "leave out `method: paper`"
    if reading == "rest":
        how, first_fix = "kept the arm's limits and let the string hang freely before", "widen workspace_m"
    fix = f"{first_fix}, allow other durations (plan.duration_s), or check the arm's limits"
    return StrandcastError(
        "SC-P004", f"only {found} random motions {how}, {count} are wanted", field="plan", fix=fix
    )


def _by_paper(prior: CurvePrior, bounds: JointBounds, rng: np.random.Generator) -> list[Curve]:
    """Return one motion by eq. 1, or none if it breaks a limit."""
    limits, joints = bounds.arm.limits, len(bounds.arm.joints)
    time_s = whole_steps(rng.uniform(*prior.duration_s), bounds.step_s)
    largest = prior.largest_slope_rad_s2
    heights = paper_heights(rng.uniform(-largest, largest, (joints, FREE_HEIGHTS)), time_s)
    stopped = bounds.stopping(Curve(np.zeros(joints), time_s, heights), "paper")
    if stopped is None:
        return []
    swept = sample(stopped, bounds.step_s).q_rad
    low, high = limits.lower_rad - swept.min(axis=0), limits.upper_rad - swept.max(axis=0)
    if (low > high).any():
        return []
    placed = replace(stopped, q0_rad=rng.uniform(*within_one_turn(low, high)))
    return [placed] if bounds.keeps(placed) else []


def _at_rest(
    prior: CurvePrior,
    bounds: JointBounds,
    rng: np.random.Generator,
    may_start: Callable[[np.ndarray], np.ndarray],
) -> list[Curve]:
    """Return those of a batch of motions that keep the limits: eq. 1 over the inner heights, slowed."""
    limits, joints = bounds.arm.limits, len(bounds.arm.joints)
    largest = prior.largest_slope_rad_s2
    times_s = np.rint(rng.uniform(*prior.duration_s, BATCH) / bounds.step_s) * bounds.step_s
    slopes = rng.uniform(-largest, largest, (BATCH, joints, FREE_HEIGHTS))
    inner = np.cumsum(slopes * times_s[:, None, None] / (FREE_HEIGHTS + 3), axis=2)
    wild = Curves(np.zeros((BATCH, joints)), times_s, rest_heights(inner))
    paths = paths_of(wild, bounds.step_s)
    rates = [
        limit / np.maximum(most, 1e-9)
        for limit, most in (
            (limits.velocity_rad_s, paths.speed),
            (limits.acceleration_rad_s2, paths.acceleration),
            (limits.jerk_rad_s3, paths.jerk),
        )
    ]
    share = np.minimum(1.0, 0.999 * WITHIN * np.min(rates, axis=0))
    low, high = within_one_turn(limits.lower_rad - share * paths.low, limits.upper_rad - share * paths.high)
    q0 = low + rng.random((BATCH, joints)) * (high - low)
    good = np.flatnonzero((low < high).all(axis=1))
    good = good[may_start(q0[good])]
    curves = _slowed(Curves(q0, times_s, share[:, :, None] * wild.heights_rad_s).take(good), bounds)
    return [curves[p] for p in range(len(curves))]


def within_one_turn(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return from where to where joints start, (..., J) [rad]: of a wider range, the turn nearest to zero."""
    wide = high - low > 2.0 * np.pi
    middle = np.clip(0.0, np.where(wide, low + np.pi, 0.0), np.where(wide, high - np.pi, 0.0))
    return np.where(wide, middle - np.pi, low), np.where(wide, middle + np.pi, high)


def _slowed(curves: Curves, bounds: JointBounds) -> Curves:
    """Slow down motions beyond a limit of torque or of the whole arm; drop those that still are."""
    arm = bounds.arm
    if (bounds.dynamics is NO_DYNAMICS and not arm.limits.whole_arm_limited.any()) or not len(curves):
        return curves
    heights = curves.heights_rad_s.copy()
    for _ in range(SLOWING):
        curves = replace(curves, heights_rad_s=heights)
        paths = paths_of(curves, bounds.step_s, dynamics=bounds.dynamics)
        over = paths.excess(arm) > 0.0
        if not over.any():
            return curves
        share = np.full(len(curves), SLOWED)
        if arm.limits.whole_arm_limited.any():
            share = np.minimum(share, SLOWED / paths.whole_arm_shares(arm).max(axis=1))
        heights = np.where(over[:, None, None], share[:, None, None] * heights, heights)
    return curves.take(np.flatnonzero(~over))
