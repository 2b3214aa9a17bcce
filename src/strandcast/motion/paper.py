"""The paper's own planner (section V): random motions until one hits in the simulation of one string."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.motion.bezier import Curve
from strandcast.motion.draw import draw_first, keeps, stopping
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import World, assessed, throw_curves
from strandcast.progress import Progress

BATCH = 32
TRIES_PER_MOTION = 200


@dataclass(frozen=True, eq=False)
class PaperFound:
    """What the search came to: the motion, the throws simulated, and whether it hits in the simulation."""

    curve: Curve
    simulations: int
    hit: bool


def first_by_paper(
    task: Task, strings: Strings, world: World, options: Options, rng: np.random.Generator
) -> PaperFound:
    """Return the first random motion that hits with the best string, or the nearest within the budget (V-A).

    Heights by eq. 1, a random time, rejection by the joints' limits, a random posture.

    Raises
    ------
    StrandcastError
        SC-P004: the arm's limits leave no such motions.
    """
    reading = "paper" if options.paper.ends == "ramp" else "rest"

    def draw(count: int, _: Curve | None) -> list[Curve]:
        return draw_first(
            count,
            reading,
            task.arm.limits,
            options.duration_s,
            options.free_heights,
            options.paper.largest_slope_rad_s2,
            task.step_s,
            rng,
            dynamics=task.dynamics,
        )

    return _search(task, strings, world, options, draw)


def later_by_paper(
    task: Task, strings: Strings, world: World, options: Options, played: Curve, rng: np.random.Generator
) -> PaperFound:
    """Return the first hit among random alterations of a motion's heights (V-B).

    Posture and time are kept. The heights altered are those of the motion played last or, ``walking``, of the
    nearest try so far.

    Raises
    ------
    StrandcastError
        SC-P007: no alteration keeps the arm's limits.
    """

    def draw(count: int, nearest: Curve | None) -> list[Curve]:
        walks = options.paper.altered_from == "walking" and nearest is not None
        around = nearest if walks and nearest is not None else played
        tries = (_altered(task, around, options.paper.altered_rad_s, rng) for _ in range(count))
        return [curve for curve in tries if curve is not None]

    return _search(task, strings, world, options, draw)


def _altered(task: Task, around: Curve, most_rad_s: float, rng: np.random.Generator) -> Curve | None:
    """Return the curve with its free heights altered, None if none that was tried keeps the limits."""
    reading = "paper" if around.ramp_s > 0.0 else "rest"
    free = slice(1, None) if reading == "paper" else slice(2, -2)
    for _ in range(TRIES_PER_MOTION):
        heights = around.heights_rad_s.copy()
        heights[:, free] += rng.uniform(-most_rad_s, most_rad_s, heights[:, free].shape)
        curve = stopping(replace(around, heights_rad_s=heights), reading, task.arm.limits, task.step_s)
        if curve is not None and keeps(task.arm.limits, task.dynamics, curve, task.step_s):
            return curve
    return None


def _search(
    task: Task,
    strings: Strings,
    world: World,
    options: Options,
    draw: Callable[[int, Curve | None], list[Curve]],
) -> PaperFound:
    """Try motions, batch by batch, with the best string: until the first hit, or the budget's end.

    A motion counts as tried if it comes before the first hit, in the order of the draws.
    """
    one, budget = strings.take([0]), options.screening
    stops = options.paper.accept == "first_hit"
    tell = Progress("plan: random motions", total=budget)
    nearest, least_m, tried = None, np.inf, 0
    while tried < budget:
        curves = draw(min(BATCH, budget - tried), nearest)
        if not curves:
            raise StrandcastError(
                "SC-P007",
                f"none of {TRIES_PER_MOTION} alterations of the earlier motion keeps the arm's limits",
                file=task.arm.path,
                fix="alter less (plan.paper.altered_rad_s), or plan with `planner: ensemble`",
            )
        miss = assessed(task, throw_curves(task, one, world, curves)).miss_m
        hits = np.flatnonzero(miss <= task.hit_radius_m)
        first = bool(len(hits)) and stops
        at = int(hits[0]) if first else int(np.argmin(miss))
        tried += at + 1 if first else len(curves)
        if miss[at] < least_m:
            nearest, least_m = curves[at], float(miss[at])
        tell(tried, f"best {1000 * least_m:.0f} mm")
        if first:
            break
    assert nearest is not None
    return PaperFound(nearest, tried, least_m <= task.hit_radius_m)
