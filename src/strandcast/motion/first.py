"""The first motion, and every one that is planned anew: random screening, then CMA-ES over the ensemble."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.motion.bezier import Curve, rest_heights, sample, whole_steps
from strandcast.motion.cost import motion_cost, start_cost, throw_cost
from strandcast.motion.draw import draw_first
from strandcast.motion.search import minimise
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import World, assessed, throw_curves
from strandcast.progress import Progress

BATCH = 32
SCREENED_WITH = 2  # strings
REFINED = 2  # of the best screened motions
# One standard deviation of the search: heights, posture, time.
HEIGHT_RAD_S, POSTURE_RAD, TIME_S = 1.5, 0.25, 0.06
SPREAD = 0.5


@dataclass(frozen=True, eq=False)
class Coding:
    """Motions as points of a search: free heights, posture and time, each over its scale."""

    joints: int
    free: int
    duration_s: tuple[float, float]
    step_s: float

    def point(self, curve: Curve) -> np.ndarray:
        """Return the point of a rest-to-rest curve."""
        free = curve.heights_rad_s[:, 2:-2].ravel() / HEIGHT_RAD_S
        return np.concatenate([free, curve.q0_rad / POSTURE_RAD, [curve.duration_s / TIME_S]])

    def curve(self, point: np.ndarray) -> Curve:
        """Return the curve of a point; times beyond the range are cut."""
        heights, posture, time = np.split(point, [self.joints * self.free, self.joints * (self.free + 1)])
        time_s = float(np.clip(time[0] * TIME_S, *self.duration_s))
        return Curve(
            posture * POSTURE_RAD,
            whole_steps(time_s, self.step_s),
            rest_heights(heights.reshape(self.joints, self.free) * HEIGHT_RAD_S),
        )


def plan_anew(
    task: Task, strings: Strings, world: World, options: Options, rng: np.random.Generator
) -> tuple[Curve, int]:
    """Return the motion with the least rms miss over the strings, and the throws simulated."""
    limits = task.arm.limits
    low_s, high_s = options.duration_s
    drawn = draw_first(
        options.screening,
        "rest",
        limits,
        (low_s, high_s),
        options.free_heights,
        options.largest_acceleration_rad_s2,
        task.step_s,
        rng,
        lambda q0: not start_cost(task, q0[None], options.clearance_m)[0],
    )
    few = strings.first(SCREENED_WITH)
    tell = Progress("plan: random motions", total=len(drawn))
    costs = np.full(len(drawn), np.inf)
    for k in range(0, len(drawn), BATCH):
        costs[k : k + BATCH] = curve_costs(task, few, world, options, drawn[k : k + BATCH])
        best = int(np.argmin(costs))
        tell(min(k + BATCH, len(drawn)), f"best {1000 * costs[best]:.0f} mm")
    coding = Coding(len(limits.lower_rad), options.free_heights, options.duration_s, task.step_s)
    budget = options.evaluations // REFINED
    tell = Progress("plan: search", total=REFINED * budget)

    def value(points: np.ndarray) -> np.ndarray:
        curves = [coding.curve(point) for point in points]
        return curve_costs(task, strings, world, options, curves)

    results = [
        minimise(value, coding.point(drawn[at]), SPREAD, budget, rng, tell, told=i * budget)
        for i, at in enumerate(np.argsort(costs, kind="stable")[:REFINED])
    ]
    point, _ = min(results, key=lambda result: result[1])
    return coding.curve(point), len(drawn) * len(few) + REFINED * budget * len(strings)


def curve_costs(
    task: Task, strings: Strings, world: World, options: Options, curves: list[Curve]
) -> np.ndarray:
    """Return (P,) the costs of motions [m]."""
    thrown = throw_curves(task, strings, world, curves)
    price = np.array([motion_cost(task, sample(curve, task.step_s)) for curve in curves])
    price += start_cost(task, np.array([curve.q0_rad for curve in curves]), options.clearance_m)
    return throw_cost(assessed(task, thrown, clearance_m=options.clearance_m), len(strings)) + price
