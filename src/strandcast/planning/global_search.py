"""Search for a motion from nothing: random screening, then CMA-ES over an ensemble of strings.

In space there are twice the unknowns, and descents take the place of CMA-ES.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from strandcast.config.plan import PlanSettings
from strandcast.core.strings import StringBatch
from strandcast.planning.assessment import assess_rollouts, side_by_side
from strandcast.planning.bezier import Curve, rest_heights
from strandcast.planning.cost import CLEARANCE_M, motion_costs, rollout_cost, start_cost
from strandcast.planning.draw import CurvePrior, JointBounds, draw_first
from strandcast.planning.mesh_refinement import refined_strings, refined_task
from strandcast.planning.motion_descent import MotionResiduals, descend_motion, motion_residuals
from strandcast.planning.paths import Curves, packed, paths_of, whole_durations
from strandcast.planning.rollouts import AFTER_END_S, RolloutConditions, rollouts_of_paths
from strandcast.planning.scenarios import disturbed
from strandcast.planning.search import SearchInputs, minimise
from strandcast.planning.task import PlanningTask
from strandcast.progress import Progress

# All numbers here are chosen; docs/explanation/throws.md has what the planner as a whole achieves with them.
BATCH = 32
SCREENED_WITH = 2  # strings
LARGEST_SLOPE_RAD_S2 = 60.0  # of the random curves' alpha_k (eq. 1)
# One standard deviation of the search: heights, posture, time.
HEIGHT_RAD_S, POSTURE_RAD, TIME_S = 1.5, 0.25, 0.06


class Round(NamedTuple):
    """A round of the search, from the best motions so far; a descent has no spread."""

    searches: int
    share: float  # of the evaluations
    strings: int
    spread: float = 0.0


ROUNDS = (Round(6, 0.5, 4, 0.5), Round(2, 0.27, 8, 0.35), Round(1, 0.23, 16, 0.2))
# A descent from a random motion takes most of its way in two or three steps of some fifty simulations.
ROUNDS_IN_SPACE = (Round(8, 0.45, 4), Round(3, 0.27, 8), Round(1, 0.28, 16))


class Scenario(NamedTuple):
    """The task with its string model, and the strings to simulate a motion with."""

    task: PlanningTask
    strings: StringBatch


class Optimum(NamedTuple):
    """The best point of a search, and its cost [m]."""

    point: np.ndarray
    cost_m: float


@dataclass(frozen=True, eq=False)
class Encoding:
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
        """Return the curves of points (P, d); times beyond the range are clipped."""
        heights, posture, time = np.split(
            points, [self.joints * self.free, self.joints * (self.free + 1)], axis=1
        )
        times_s = whole_durations(np.clip(time[:, 0] * TIME_S, *self.duration_s), self.step_s)
        free = heights.reshape(len(points), self.joints, self.free) * HEIGHT_RAD_S
        return Curves(posture * POSTURE_RAD, times_s, rest_heights(free))


def search_globally(given: SearchInputs) -> tuple[Curve, int]:
    """Return the motion with the least cost over the strings, and the number of rollouts.

    Many motions are tried with few strings, fewer with more: every round starts from the best of the last.
    """
    task, settings, joints = given.task.rough(), given.settings, len(given.task.arm.joints)
    ensemble = disturbed(given.strings, settings.ensemble, joints, given.sizes)
    encoding = Encoding(joints, settings.control_points, settings.duration_range_s, task.step_s)
    found = screen(replace(given, task=task, strings=ensemble.first(SCREENED_WITH)))
    simulations = settings.screening * min(SCREENED_WITH, len(ensemble))
    starts = [encoding.point(curve) for curve in found]
    optima: list[Optimum]
    rounds = ROUNDS_IN_SPACE if task.in_space else ROUNDS
    for number, (searches, share, members, spread) in enumerate(rounds, 1):
        strings = ensemble.first(members)
        scenarios = scenarios_of(task, strings, settings)
        budget = int(share * settings.evaluations / searches)
        # A cost over more strings is another one: each round has lines of its own.
        progress = Progress(f"plan: search {number} of {len(rounds)}, {members} strings", searches * budget)
        optima = []
        report = partial(_report, progress, optima, budget)

        def value(points: np.ndarray, scenarios: list[Scenario] = scenarios) -> np.ndarray:
            return curve_costs(task, scenarios, given.conditions, encoding.curves(points))

        def residuals(points: np.ndarray, strings: StringBatch = strings) -> MotionResiduals:
            return motion_residuals(task, strings, given.conditions, encoding.curves(points))

        for start in starts[:searches]:
            if task.in_space:
                # The time, which is whole steps, stays.
                point, cost_m, tried = descend_motion(residuals, start, len(start) - 1, budget)
                report(tried, cost_m)
            else:
                point, cost_m, tried = minimise(value, start, spread, budget, given.rng, report)
            optima.append(Optimum(point, cost_m))
            simulations += tried * min(members, len(ensemble))
        starts = _best_first(optima)
    return encoding.curves(starts[0][None])[0], simulations


def _report(progress: Progress, before: list[Optimum], budget: int, tried: int, cost_m: float) -> None:
    """Print how far a round is, with the least cost in it."""
    least_m = min([cost_m, *(optimum.cost_m for optimum in before)])
    progress(len(before) * budget + tried, f"best cost {1000 * least_m:.1f} mm")


def _best_first(optima: list[Optimum]) -> list[np.ndarray]:
    return [optimum.point for optimum in sorted(optima, key=lambda optimum: optimum.cost_m)]


def screen(given: SearchInputs) -> list[Curve]:
    """Return random motions, the best first, from postures in which the string hangs freely."""
    task, settings = given.task, given.settings
    drawn = draw_first(
        settings.screening,
        CurvePrior("rest", settings.duration_range_s, settings.control_points, LARGEST_SLOPE_RAD_S2),
        JointBounds(task.arm, task.step_s, task.dynamics),
        given.rng,
        lambda q0: start_cost(task, q0) == 0.0,
    )
    progress = Progress("plan: random motions", total=len(drawn))
    costs = np.full(len(drawn), np.inf)
    for k in range(0, len(drawn), BATCH):
        batch = packed(drawn[k : k + BATCH])
        costs[k : k + BATCH] = curve_costs(task, [Scenario(task, given.strings)], given.conditions, batch)
        progress(min(k + BATCH, len(drawn)), f"best cost {1000 * costs.min():.0f} mm")
    return [drawn[k] for k in np.argsort(costs, kind="stable")]


def scenarios_of(task: PlanningTask, strings: StringBatch, settings: PlanSettings) -> list[Scenario]:
    """Return the strings as scenarios, every other one as a refined chain if wanted."""
    # In space a string has twice as many points from the beginning.
    if task.in_space or not settings.mesh_refinement or len(strings) < 2:
        return [Scenario(task, strings)]
    every = range(len(strings))
    return [
        Scenario(task, strings.take(every[::2])),
        Scenario(refined_task(task), refined_strings(strings.take(every[1::2]))),
    ]


def curve_costs(
    task: PlanningTask, scenarios: list[Scenario], conditions: RolloutConditions, curves: Curves
) -> np.ndarray:
    """Return (P,) the costs of motions [m]."""
    paths = paths_of(curves, task.step_s, AFTER_END_S, task.dynamics)
    price = motion_costs(task, paths) + start_cost(task, curves.q0_rad)
    assessments = []
    for model, strings in scenarios:
        rollouts = rollouts_of_paths(model, strings, conditions, paths)
        assessments.append((assess_rollouts(model, rollouts, CLEARANCE_M), len(strings)))
    return np.asarray(rollout_cost(*side_by_side(assessments), task.step_s) + price)
