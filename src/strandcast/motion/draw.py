"""Random motions within the arm's limits (section V of the paper)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from strandcast.arm.limits import Limits
from strandcast.errors import StrandcastError
from strandcast.motion.bezier import (
    Curve,
    Samples,
    paper_heights,
    rest_heights,
    sample,
    whole_steps,
    with_stop_ramp,
)

MOST_DRAWS = 20_000
# Between the samples a controller goes a little further.
WITHIN = 0.995


def draw_first(
    count: int,
    reading: str,
    limits: Limits,
    duration_s: tuple[float, float],
    free_heights: int,
    largest_acceleration_rad_s2: float,
    step_s: float,
    rng: np.random.Generator,
    may_start: Callable[[np.ndarray], bool] = lambda q0: True,
) -> list[Curve]:
    """Return random motions from random postures, all within the limits of position, speed and acceleration.

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
        Whether a motion may start from a posture (J,).

    Raises
    ------
    StrandcastError
        The limits leave no room for such motions.
    """
    found: list[Curve] = []
    for _ in range(max(MOST_DRAWS, 20 * count)):
        if len(found) == count:
            return found
        time_s = whole_steps(rng.uniform(*duration_s), step_s)
        curve = _random_curve(reading, limits, time_s, free_heights, largest_acceleration_rad_s2, step_s, rng)
        placed = place_at_random(curve, reading, limits, step_s, rng)
        if placed is not None and may_start(placed.q0_rad):
            found.append(placed)
    raise StrandcastError(
        "SC-P004",
        f"only {len(found)} random motions kept the arm's limits and let the string hang freely before,"
        f" {count} are wanted",
        fix="widen workspace_m, allow longer motions (plan.duration_s), or look at the arm's limits",
    )


def _random_curve(
    reading: str,
    limits: Limits,
    time_s: float,
    free: int,
    largest: float,
    step_s: float,
    rng: np.random.Generator,
) -> Curve:
    joints = len(limits.lower_rad)
    if reading == "paper":
        return Curve(
            np.zeros(joints), time_s, paper_heights(rng.uniform(-largest, largest, (joints, free)), time_s)
        )
    # Eq. 1 over the inner heights; the two at either end are zero.
    slopes = rng.uniform(-largest, largest, (joints, free))
    inner = np.cumsum(slopes * time_s / (free + 3), axis=1)
    return slowed(Curve(np.zeros(joints), time_s, rest_heights(inner)), limits, step_s)


def slowed(curve: Curve, limits: Limits, step_s: float) -> Curve:
    """Return the curve with the heights of too fast joints scaled down to the limits of their rates."""
    motion = sample(curve, step_s)
    room = np.minimum(
        limits.velocity_rad_s / np.maximum(np.abs(motion.qd).max(axis=0), 1e-9),
        limits.acceleration_rad_s2 / np.maximum(np.abs(motion.qdd).max(axis=0), 1e-9),
    )
    return replace(curve, heights_rad_s=curve.heights_rad_s * np.minimum(1.0, 0.999 * WITHIN * room)[:, None])


def place_at_random(
    curve: Curve, reading: str, limits: Limits, step_s: float, rng: np.random.Generator
) -> Curve | None:
    """Return the curve from a random posture that keeps the joints in range, None if it breaks a limit."""
    stopped = stopping(curve, reading, limits, step_s)
    if stopped is None:
        return None
    motion = sample(replace(stopped, q0_rad=np.zeros(len(curve.q0_rad))), step_s)
    if not within_rates(limits, motion):
        return None
    low = limits.lower_rad - motion.q.min(axis=0)
    high = limits.upper_rad - motion.q.max(axis=0)
    if (low > high).any():
        return None
    # A joint without a range starts anywhere on its turn.
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    return replace(stopped, q0_rad=rng.uniform(np.minimum(low, high), high))


def stopping(curve: Curve, reading: str, limits: Limits, step_s: float) -> Curve | None:
    """Return the curve with its stop ramp if it needs one; None if the arm cannot stop."""
    return curve if reading == "rest" else with_stop_ramp(curve, limits.acceleration_rad_s2, step_s)


def within_rates(limits: Limits, motion: Samples) -> bool:
    """Tell whether speeds and accelerations stay within the limits."""
    return bool(
        (np.abs(motion.qd).max(axis=0) <= WITHIN * limits.velocity_rad_s).all()
        and (np.abs(motion.qdd).max(axis=0) <= WITHIN * limits.acceleration_rad_s2).all()
    )


def within_range(limits: Limits, motion: Samples) -> bool:
    """Tell whether the joints stay in their ranges."""
    return bool((motion.q >= limits.lower_rad).all() and (motion.q <= limits.upper_rad).all())


def excess(limits: Limits, motion: Samples, step_s: float) -> float:
    """Return how far a motion breaks the limits: the excess summed over joints and kinds, 1 = the limit."""
    room = np.where(
        np.isfinite(limits.upper_rad - limits.lower_rad), limits.upper_rad - limits.lower_rad, np.pi
    )
    parts = [
        (motion.q - limits.upper_rad).max(axis=0) / room,
        (limits.lower_rad - motion.q).max(axis=0) / room,
        np.abs(motion.qd).max(axis=0) / limits.velocity_rad_s - WITHIN,
        np.abs(motion.qdd).max(axis=0) / limits.acceleration_rad_s2 - WITHIN,
    ]
    if np.isfinite(limits.jerk_rad_s3).any():
        jerk = np.abs(np.diff(motion.qdd, axis=0)).max(axis=0) / step_s
        parts.append(jerk / limits.jerk_rad_s3 - WITHIN)
    return float(sum(np.maximum(part, 0.0).sum() for part in parts))
