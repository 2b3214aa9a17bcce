"""Search for a motion from nothing: random motions, then descents from the best, over many strings."""

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from strandcast.core.strings import StringBatch
from strandcast.planning.bezier import Curve, rest_heights
from strandcast.planning.cost import start_cost
from strandcast.planning.draw import FREE_HEIGHTS, CurvePrior, JointBounds, draw_first
from strandcast.planning.motion_descent import HEIGHT_RAD_S, MotionResiduals, descend_motion, motion_residuals
from strandcast.planning.paths import Curves, packed
from strandcast.planning.scenarios import STRINGS, disturbed
from strandcast.planning.search import SearchInputs
from strandcast.progress import Progress

# All numbers here are chosen; docs/explanation/throws.md has what the planner as a whole achieves with them.
BATCH = 32
SCREENED_WITH = 2  # strings
LARGEST_SLOPE_RAD_S2 = 60.0  # of the random curves' alpha_k (eq. 1)
POSTURE_RAD, TIME_S = 0.25, 0.06  # units of a search, beside that of the heights
# Rounds of descents from the best motions so far: how many, their share of the evaluations, and the strings.
# A descent from a random motion takes most of its way in a few steps.
ROUNDS = ((4, 0.4, 4), (2, 0.25, 8), (1, 0.35, 16))


@dataclass(frozen=True, eq=False)
class Encoding:
    """Motions as points of a search: free heights, posture and time, each over its scale."""

    joints: int
    duration_s: tuple[float, float]
    step_s: float

    def point(self, curve: Curve) -> np.ndarray:
        """Return the point of a rest-to-rest curve."""
        free = curve.heights_rad_s[:, 2:-2].ravel() / HEIGHT_RAD_S
        return np.concatenate([free, curve.q0_rad / POSTURE_RAD, [curve.duration_s / TIME_S]])

    def curves(self, points: np.ndarray) -> Curves:
        """Return the curves of points (P, d); times beyond the range are clipped."""
        ends = self.joints * FREE_HEIGHTS, self.joints * (FREE_HEIGHTS + 1)
        heights, posture, time = np.split(points, ends, axis=1)
        times_s = np.rint(np.clip(time[:, 0] * TIME_S, *self.duration_s) / self.step_s) * self.step_s
        free = heights.reshape(len(points), self.joints, FREE_HEIGHTS) * HEIGHT_RAD_S
        return Curves(posture * POSTURE_RAD, times_s, rest_heights(free))


def search_globally(given: SearchInputs) -> tuple[Curve, int]:
    """Return the motion with the least cost over the strings, and the number of rollouts.

    Many motions are tried with few strings, fewer with more: every round starts from the best of the last.
    """
    task, settings, joints = given.task.rough(), given.settings, len(given.task.arm.joints)
    given = replace(given, task=task, strings=disturbed(given.strings, STRINGS, joints, given.sizes))
    encoding = Encoding(joints, settings.duration_s, task.step_s)
    screened, simulations = screen(given, ROUNDS[0][0])
    starts = [encoding.point(curve) for curve in screened]
    for number, (descents, share, members) in enumerate(ROUNDS, 1):
        strings = given.strings.first(members)
        budget = int(share * settings.evaluations / descents)
        # A cost over more strings is another one: each round has lines of its own.
        progress = Progress(f"plan: search {number} of {len(ROUNDS)}, {members} strings", descents * budget)

        def residuals(
            points: np.ndarray, strings: StringBatch = strings, stops: bool = number == len(ROUNDS)
        ) -> MotionResiduals:
            return motion_residuals(task, strings, given.conditions, encoding.curves(points), stops=stops)

        optima: list[tuple[float, np.ndarray]] = []
        for done, start in enumerate(starts[:descents], 1):
            # The time, which is whole steps, stays.
            point, cost_m, tried = descend_motion(residuals, start, len(start) - 1, budget)
            optima.append((cost_m, point))
            simulations += tried * len(strings)
            progress(done * budget, f"best cost {1000 * min(optima, key=itemgetter(0))[0]:.1f} mm")
        starts = [point for _, point in sorted(optima, key=itemgetter(0))]
    return encoding.curves(starts[0][None])[0], simulations


def screen(given: SearchInputs, count: int) -> tuple[list[Curve], int]:
    """Return the best of many random motions, the best first, and the number of rollouts.

    They start from postures in which the string hangs freely.
    """
    task, settings, strings = given.task, given.settings, given.strings.first(SCREENED_WITH)
    drawn = draw_first(
        settings.evaluations,
        CurvePrior("rest", settings.duration_s, LARGEST_SLOPE_RAD_S2),
        JointBounds(task.arm, task.step_s, task.dynamics),
        given.rng,
        lambda q0: start_cost(task, q0) == 0.0,
    )
    progress = Progress("plan: random motions", total=len(drawn))

    def costs_of(members: np.ndarray, strings: StringBatch) -> np.ndarray:
        batch = packed([drawn[k] for k in members])
        return motion_residuals(task, strings, given.conditions, batch).cost_m

    least, costs = np.full((2, len(drawn)), np.inf)
    for k in range(0, len(drawn), BATCH):
        each = np.arange(k, min(k + BATCH, len(drawn)))
        # The cost is a mean over strings, in part a root mean square: with all of them it is at least this.
        least[each] = costs_of(each, strings.first(1)) / len(strings)
        progress(int(each[-1]) + 1, f"best cost {1000 * least.min():.0f} mm or more")
    order, simulations = np.argsort(least, kind="stable"), len(drawn)
    for k in range(0, len(drawn), BATCH):
        each = order[k : k + BATCH]
        if least[each[0]] > np.partition(costs, count - 1)[count - 1]:
            break  # no other motion can be among the best
        costs[each] = costs_of(each, strings)
        simulations += len(each) * len(strings)
    return [drawn[k] for k in np.argsort(costs, kind="stable")[:count]], simulations
