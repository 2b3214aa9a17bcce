"""The first motion, and every one that is planned anew: random screening, then CMA-ES over the ensemble."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.motion.bezier import Curve, rest_heights
from strandcast.motion.cost import motion_costs, start_cost, throw_cost
from strandcast.motion.draw import draw_first
from strandcast.motion.finer import finer_strings, finer_task
from strandcast.motion.objective import side_by_side
from strandcast.motion.paths import Curves, packed, paths_of, whole_durations
from strandcast.motion.search import minimise
from strandcast.motion.strings import Strings, disturbed
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import AFTER_END_S, World, assessed, throw_paths
from strandcast.progress import Progress

BATCH = 32
SCREENED_WITH = 2  # strings
# Rounds of the search: searches, from the best motions so far; share of the evaluations; strings; spread.
ROUNDS = ((6, 0.5, 4, 0.5), (2, 0.27, 8, 0.35), (1, 0.23, 16, 0.2))
MOST_ATTEMPTS = 2
GOOD_ENOUGH = 1.5  # hit radii: what a motion may cost, lateness and folding included, with no look for others
HOPELESS = 10.0  # hit radii: so far off, it was no bad luck of the search, and another look finds the same
# One standard deviation of the search: heights, posture, time.
HEIGHT_RAD_S, POSTURE_RAD, TIME_S = 1.5, 0.25, 0.06

Cast = tuple[Task, Strings]  # the model, and the strings that are thrown with it
End = tuple[np.ndarray, float]  # of a search: the best point, and its cost [m]


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

    def curves(self, points: np.ndarray) -> Curves:
        """Return the curves of points (P, d); times beyond the range are cut."""
        heights, posture, time = np.split(
            points, [self.joints * self.free, self.joints * (self.free + 1)], axis=1
        )
        times_s = whole_durations(np.clip(time[:, 0] * TIME_S, *self.duration_s), self.step_s)
        free = heights.reshape(len(points), self.joints, self.free) * HEIGHT_RAD_S
        return Curves(posture * POSTURE_RAD, times_s, rest_heights(free))


def plan_anew(
    task: Task, strings: Strings, world: World, options: Options, rng: np.random.Generator
) -> tuple[Curve, int]:
    """Return the motion with the least rms miss over the strings, and the throws simulated.

    Where the best that was found is no good one, but near one, all is done once more with other random
    motions.
    """
    task = task.rough()
    thrown = disturbed(strings, options.members, len(task.arm.joints), options.disturbances)
    coding = Coding(len(task.arm.joints), options.free_heights, options.duration_s, task.step_s)
    ends: list[End] = []
    simulations = 0
    while len(ends) < MOST_ATTEMPTS:
        end, more = _attempt(task, thrown, world, options, coding, rng)
        ends.append(end)
        simulations += more
        if not GOOD_ENOUGH < end[1] / task.hit_radius_m < HOPELESS:
            break
    return coding.curves(_best_first(ends)[0][None])[0], simulations


def _attempt(
    task: Task, thrown: Strings, world: World, options: Options, coding: Coding, rng: np.random.Generator
) -> tuple[End, int]:
    """Return the best point found from random motions, its cost, and the throws simulated.

    Many motions are tried with few strings, fewer with more: every round starts from the best of the last.
    """
    found = screen(task, thrown.first(SCREENED_WITH), world, options, rng)
    simulations = options.screening * min(SCREENED_WITH, len(thrown))
    starts = [coding.point(curve) for curve in found]
    ends: list[End] = []
    tell, told = Progress("plan: search", total=options.evaluations), 0
    for searches, share, members, spread in ROUNDS:
        casts = casts_of(task, thrown.first(members), options)
        budget = int(share * options.evaluations / searches)

        def value(points: np.ndarray, casts: list[Cast] = casts) -> np.ndarray:
            return curve_costs(task, casts, world, options, coding.curves(points))

        ends = []
        for start in starts[:searches]:
            point, cost, tried = minimise(value, start, spread, budget, rng, tell, told)
            ends.append((point, cost))
            told += budget
            simulations += tried * min(members, len(thrown))
        starts = _best_first(ends)
    return min(ends, key=lambda end: end[1]), simulations


def _best_first(ends: list[End]) -> list[np.ndarray]:
    return [point for point, _ in sorted(ends, key=lambda end: end[1])]


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
        lambda q0: start_cost(task, q0, options.clearance_m) == 0.0,
        task.dynamics,
    )
    tell = Progress("plan: random motions", total=len(drawn))
    costs = np.full(len(drawn), np.inf)
    for k in range(0, len(drawn), BATCH):
        costs[k : k + BATCH] = curve_costs(
            task, [(task, strings)], world, options, packed(drawn[k : k + BATCH])
        )
        tell(min(k + BATCH, len(drawn)), f"best {1000 * costs.min():.0f} mm")
    return [drawn[k] for k in np.argsort(costs, kind="stable")]


def casts_of(task: Task, strings: Strings, options: Options) -> list[Cast]:
    """Return what motions are thrown with: the strings, every other one as a finer chain if wanted."""
    if not options.finer or len(strings) < 2:
        return [(task, strings)]
    every = range(len(strings))
    return [
        (task, strings.take(every[::2])),
        (finer_task(task), finer_strings(strings.take(every[1::2]))),
    ]


def curve_costs(task: Task, casts: list[Cast], world: World, options: Options, curves: Curves) -> np.ndarray:
    """Return (P,) the costs of motions [m]."""
    paths = paths_of(curves, task.step_s, AFTER_END_S, task.dynamics)
    price = motion_costs(task, paths) + start_cost(task, curves.q0_rad, options.clearance_m)
    told = [
        (
            assessed(model, throw_paths(model, strings, world, paths), clearance_m=options.clearance_m),
            len(strings),
        )
        for model, strings in casts
    ]
    return throw_cost(*side_by_side(told), task.step_s) + price
