"""The paper's own planner (section V): random motions until one hits in the simulation of one string."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from strandcast.motion.bezier import Curve, sample
from strandcast.motion.draw import draw_first, stopping, within_range, within_rates
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import World, assessed, throw_curves
from strandcast.progress import Progress

BATCH = 32
TRIES_PER_MOTION = 200


def first_by_paper(
    task: Task, strings: Strings, world: World, options: Options, rng: np.random.Generator
) -> tuple[Curve, int, bool]:
    """Return the first random motion that hits with the best string, or the nearest within the budget (V-A).

    Returns
    -------
    The motion, the throws simulated, and whether it hits.
    """

    def draw(count: int) -> list[Curve]:
        return draw_first(
            count,
            "paper",
            task.arm.limits,
            options.duration_s,
            options.free_heights,
            options.largest_acceleration_rad_s2,
            task.step_s,
            rng,
        )

    return _first_hit(task, strings, world, options, draw)


def later_by_paper(
    task: Task, strings: Strings, world: World, options: Options, played: Curve, rng: np.random.Generator
) -> tuple[Curve, int, bool]:
    """Return the first hit among random alterations of the motion that was played last (V-B).

    The posture and the time are kept, every free height is altered by up to `options.altered_rad_s`.
    """

    def draw(count: int) -> list[Curve]:
        return [_altered(task, played, options.altered_rad_s, rng) for _ in range(count)]

    return _first_hit(task, strings, world, options, draw)


def _altered(task: Task, played: Curve, most_rad_s: float, rng: np.random.Generator) -> Curve:
    reading = "paper" if played.ramp_s > 0.0 else "rest"
    inner = slice(1, None) if reading == "paper" else slice(2, -2)
    for _ in range(TRIES_PER_MOTION):
        heights = played.heights_rad_s.copy()
        heights[:, inner] += rng.uniform(-most_rad_s, most_rad_s, heights[:, inner].shape)
        curve = stopping(replace(played, heights_rad_s=heights), reading, task.arm.limits, task.step_s)
        if curve is None:
            continue
        motion = sample(curve, task.step_s)
        if within_rates(task.arm.limits, motion) and within_range(task.arm.limits, motion):
            return curve
    return played


def _first_hit(
    task: Task, strings: Strings, world: World, options: Options, draw: Callable[[int], list[Curve]]
) -> tuple[Curve, int, bool]:
    one = strings.take([0])
    tell = Progress("plan: random motions", total=options.screening)
    nearest, least_m, tried = None, np.inf, 0
    while tried < options.screening or nearest is None:
        curves = draw(min(BATCH, max(options.screening - tried, 1)))
        miss = assessed(task, throw_curves(task, one, world, curves)).miss_m
        hits = np.flatnonzero(miss <= task.hit_radius_m)
        at = int(hits[0]) if len(hits) else int(np.argmin(miss))
        tried += at + 1 if len(hits) else len(curves)
        if miss[at] < least_m or len(hits):
            nearest, least_m = curves[at], float(miss[at])
        tell(tried, f"best {1000 * least_m:.0f} mm")
        if len(hits):
            break
    assert nearest is not None
    return nearest, tried, least_m <= task.hit_radius_m
