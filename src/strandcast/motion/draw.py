"""Random motions within the arm's limits (section V of the paper)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from strandcast.arm.dynamics import NO_DYNAMICS, PlanarDynamics
from strandcast.arm.limits import Limits
from strandcast.errors import StrandcastError
from strandcast.motion.bezier import (
    Curve,
    paper_heights,
    rest_heights,
    sample,
    whole_steps,
    with_stop_ramp,
)
from strandcast.motion.paths import WITHIN, Curves, paths_of, paths_of_any, whole_durations

MOST_DRAWS = 20_000
BATCH = 256
CALMED, CALMING = 0.8, 8  # a motion that asks for too much torque is slowed by this factor, so often at most


def draw_first(
    count: int,
    reading: str,
    limits: Limits,
    duration_s: tuple[float, float],
    free_heights: int,
    largest_acceleration_rad_s2: float,
    step_s: float,
    rng: np.random.Generator,
    may_start: Callable[[np.ndarray], np.ndarray] = lambda q0: np.ones(len(q0), bool),
    dynamics: PlanarDynamics = NO_DYNAMICS,
) -> list[Curve]:
    """Return random motions from random postures, all within the arm's limits.

    Parameters
    ----------
    count
        How many.
    reading
        ``rest`` or ``paper`` (see `strandcast.motion.bezier`).
    duration_s
        Shortest and longest time of the curve [s].
    free_heights
        Control heights of each joint that are not zero.
    largest_acceleration_rad_s2
        The slopes alpha_k of eq. 1 are uniform within this.
    may_start
        Which of the postures (P, J) a motion may start from: (P,).
    dynamics
        Of the arm, for its torques.

    Raises
    ------
    StrandcastError
        The limits leave no room for such motions.
    """
    found: list[Curve] = []
    draws = max(MOST_DRAWS, 20 * count)
    for _ in range(draws if reading == "paper" else -(-draws // BATCH)):
        if reading == "paper":
            time_s = whole_steps(rng.uniform(*duration_s), step_s)
            found += _by_paper(
                limits, time_s, free_heights, largest_acceleration_rad_s2, step_s, rng, dynamics
            )
        else:
            found += _at_rest(
                limits,
                duration_s,
                free_heights,
                largest_acceleration_rad_s2,
                step_s,
                rng,
                may_start,
                dynamics,
            )
        if len(found) >= count:
            return found[:count]
    raise _too_few(len(found), count, reading, limits)


def _too_few(found: int, count: int, reading: str, limits: Limits) -> StrandcastError:
    how, fix = (
        ("kept the arm's limits and let the string hang freely before", "widen workspace_m,")
        if reading == "rest"
        else ("by eq. 1 kept the arm's limits", "lower plan.paper.largest_slope_rad_s2,")
    )
    fix += " allow other durations (plan.duration_s), or look at the arm's limits"
    if reading == "paper" and np.isfinite(limits.jerk_rad_s3).any():
        fix = (
            "set plan.paper.ends to rest: eq. 1 begins with a jump in acceleration, the arm's jerk is limited"
        )
    return StrandcastError(
        "SC-P004", f"only {found} random motions {how}, {count} are wanted", field="plan", fix=fix
    )


def _by_paper(
    limits: Limits,
    time_s: float,
    free: int,
    largest: float,
    step_s: float,
    rng: np.random.Generator,
    dynamics: PlanarDynamics,
) -> list[Curve]:
    """Return one motion by eq. 1, or none if it breaks a limit."""
    joints = len(limits.lower_rad)
    heights = paper_heights(rng.uniform(-largest, largest, (joints, free)), time_s)
    stopped = stopping(Curve(np.zeros(joints), time_s, heights), "paper", limits, step_s)
    if stopped is None:
        return []
    swept = sample(stopped, step_s).q
    low, high = limits.lower_rad - swept.min(axis=0), limits.upper_rad - swept.max(axis=0)
    if (low > high).any():
        return []
    # A joint without a range starts anywhere on its turn.
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    placed = replace(stopped, q0_rad=rng.uniform(np.minimum(low, high), high))
    return [placed] if keeps(limits, dynamics, placed, step_s) else []


def _at_rest(
    limits: Limits,
    duration_s: tuple[float, float],
    free: int,
    largest: float,
    step_s: float,
    rng: np.random.Generator,
    may_start: Callable[[np.ndarray], np.ndarray],
    dynamics: PlanarDynamics,
) -> list[Curve]:
    """Return those of a batch of motions that keep the limits: eq. 1 over the inner heights, slowed."""
    joints = len(limits.lower_rad)
    times_s = whole_durations(rng.uniform(*duration_s, BATCH), step_s)
    slopes = rng.uniform(-largest, largest, (BATCH, joints, free))
    inner = np.cumsum(slopes * times_s[:, None, None] / (free + 3), axis=2)
    wild = Curves(np.zeros((BATCH, joints)), times_s, rest_heights(inner))
    paths = paths_of(wild, step_s)
    rates = [
        limit / np.maximum(most, 1e-9)
        for limit, most in (
            (limits.velocity_rad_s, paths.speed),
            (limits.acceleration_rad_s2, paths.acceleration),
            (limits.jerk_rad_s3, paths.jerk),
        )
    ]
    share = np.minimum(1.0, 0.999 * WITHIN * np.min(rates, axis=0))
    # A joint without a range starts anywhere on its turn.
    low = np.maximum(limits.lower_rad - share * paths.low, -np.pi)
    high = np.minimum(limits.upper_rad - share * paths.high, np.pi)
    q0 = low + rng.random((BATCH, joints)) * (high - low)
    good = np.flatnonzero((low < high).all(axis=1))
    good = good[may_start(q0[good])]
    curves = _calmed(
        Curves(q0, times_s, share[:, :, None] * wild.heights_rad_s).take(good), limits, step_s, dynamics
    )
    return [curves[p] for p in range(len(curves))]


def _calmed(curves: Curves, limits: Limits, step_s: float, dynamics: PlanarDynamics) -> Curves:
    """Return motions with those slowed that ask for too much torque, without those that still do."""
    if not len(dynamics.links) or not len(curves):
        return curves
    heights = curves.heights_rad_s.copy()
    for _ in range(CALMING):
        curves = replace(curves, heights_rad_s=heights)
        over = paths_of(curves, step_s, dynamics=dynamics).excess(limits) > 0.0
        if not over.any():
            return curves
        heights = np.where(over[:, None, None], CALMED * heights, heights)
    return curves.take(np.flatnonzero(~over))


def stopping(curve: Curve, reading: str, limits: Limits, step_s: float) -> Curve | None:
    """Return the curve with its stop ramp if it needs one; None if the arm cannot stop."""
    return curve if reading == "rest" else with_stop_ramp(curve, limits.acceleration_rad_s2, step_s)


def keeps(limits: Limits, dynamics: PlanarDynamics, curve: Curve, step_s: float) -> bool:
    """Tell whether a motion keeps all the limits."""
    return bool(paths_of_any([curve], step_s, dynamics=dynamics).excess(limits)[0] == 0.0)
