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
REFINED = 2  # of the best screened motions, with half of the strings; the better one then with all
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
    screened = screen(task, strings.first(SCREENED_WITH), world, options, rng)
    coding = Coding(len(task.arm.joints), options.free_heights, options.duration_s, task.step_s)
    tell = Progress("plan: search", total=options.evaluations)
    half = strings.first(max(len(strings) // 2, 1))
    budget = options.evaluations // (2 * REFINED)
    spent = REFINED * budget

    def search(
        members: Strings, start: np.ndarray, spread: float, budget: int, told: int
    ) -> tuple[np.ndarray, float]:
        def value(points: np.ndarray) -> np.ndarray:
            return curve_costs(task, members, world, options, [coding.curve(point) for point in points])

        return minimise(value, start, spread, budget, rng, tell, told)

    tried = [
        search(half, coding.point(curve), SPREAD, budget, i * budget)
        for i, curve in enumerate(screened[:REFINED])
    ]
    best = min(tried, key=lambda result: result[1])[0]
    point, _ = search(strings, best, 0.5 * SPREAD, options.evaluations - spent, spent)
    screening = options.screening * min(SCREENED_WITH, len(strings))
    return coding.curve(point), screening + spent * len(half) + (options.evaluations - spent) * len(strings)


def screen(
    task: Task, strings: Strings, world: World, options: Options, rng: np.random.Generator
) -> list[Curve]:
    """Return random motions, the best first, from postures in which the string hangs freely."""
    drawn = draw_first(
        options.screening,
        "rest",
        task.arm.limits,
        options.duration_s,
        options.free_heights,
        options.largest_acceleration_rad_s2,
        task.step_s,
        rng,
        lambda q0: not start_cost(task, q0[None], options.clearance_m)[0],
    )
    tell = Progress("plan: random motions", total=len(drawn))
    costs = np.full(len(drawn), np.inf)
    for k in range(0, len(drawn), BATCH):
        costs[k : k + BATCH] = curve_costs(task, strings, world, options, drawn[k : k + BATCH])
        tell(min(k + BATCH, len(drawn)), f"best {1000 * costs.min():.0f} mm")
    return [drawn[k] for k in np.argsort(costs, kind="stable")]


def curve_costs(
    task: Task, strings: Strings, world: World, options: Options, curves: list[Curve]
) -> np.ndarray:
    """Return (P,) the costs of motions [m]."""
    thrown = throw_curves(task, strings, world, curves)
    price = np.array([motion_cost(task, sample(curve, task.step_s)) for curve in curves])
    price += start_cost(task, np.array([curve.q0_rad for curve in curves]), options.clearance_m)
    told = assessed(task, thrown, clearance_m=options.clearance_m)
    return throw_cost(told, len(strings), task.step_s) + price
