"""The paper's own planner (section V): random motions until one hits in the simulation of one string."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.planning.assessment import assess_rollouts
from strandcast.planning.bezier import Curve
from strandcast.planning.draw import CurvePrior, JointBounds, Reading, draw_first
from strandcast.planning.rollouts import rollouts_of_curves
from strandcast.planning.search import SearchInputs, SearchResult
from strandcast.planning.task import PlanningTask
from strandcast.progress import Progress

BATCH = 32
# Of alpha_k in eq. 1, which the paper does not give: the largest that leaves motions within the limits.
LARGEST_SLOPES_RAD_S2 = (60.0, 30.0, 15.0, 7.5)
ALTERED_RAD_S = 0.5  # most change of a height from the motion played last (V-B)
TRIES_PER_MOTION = 200  # chosen: alterations of a motion, before its limits are said to leave none


def first_by_paper(given: SearchInputs) -> SearchResult:
    """Return the first random motion that hits with the best string, or the nearest within the budget (V-A).

    Heights by eq. 1, a random time, rejection by the joints' limits, a random posture. A ramp stops the arm
    after the curve; where its jerk is limited, the curve itself begins and ends at rest.

    Raises
    ------
    StrandcastError
        SC-P004: the arm's limits leave no such motions.
    """
    task, settings = given.task, given.settings
    bounds = JointBounds(task.arm, task.step_s, task.dynamics)

    reading: Reading = "rest" if np.isfinite(task.arm.limits.jerk_rad_s3).any() else "paper"
    priors = [CurvePrior(reading, settings.duration_s, slope) for slope in LARGEST_SLOPES_RAD_S2]

    def draw(count: int) -> list[Curve]:
        while len(priors) > 1:
            try:
                return draw_first(count, priors[0], bounds, given.rng)
            except StrandcastError:
                del priors[0]
        return draw_first(count, priors[0], bounds, given.rng)

    return _search(given, "first", draw)


def later_by_paper(given: SearchInputs, played: Curve) -> SearchResult:
    """Return the first hit among random alterations of a motion's heights (V-B).

    Posture and time are kept.

    Raises
    ------
    StrandcastError
        SC-P004: no alteration keeps the arm's limits.
    """

    def draw(count: int) -> list[Curve]:
        tries = (_altered(given.task, played, given.rng) for _ in range(count))
        return [curve for curve in tries if curve is not None]

    return _search(given, "refined", draw)


def _altered(task: PlanningTask, around: Curve, rng: np.random.Generator) -> Curve | None:
    """Return the curve with its free heights altered, None if no alteration tried keeps the limits."""
    reading: Reading = "paper" if around.ramp_s > 0.0 else "rest"
    bounds = JointBounds(task.arm, task.step_s, task.dynamics)
    free = slice(1, None) if reading == "paper" else slice(2, -2)
    for _ in range(TRIES_PER_MOTION):
        heights = around.heights_rad_s.copy()
        heights[:, free] += rng.uniform(-ALTERED_RAD_S, ALTERED_RAD_S, heights[:, free].shape)
        curve = bounds.stopping(replace(around, heights_rad_s=heights), reading)
        if curve is not None and bounds.keeps(curve):
            return curve
    return None


def _search(given: SearchInputs, kind: str, draw: Callable[[int], list[Curve]]) -> SearchResult:
    """Try motions, batch by batch, with the best string: until the first hit, or the budget's end.

    A motion counts as tried if it comes before the first hit, in the order of the draws.
    """
    task, one, budget = given.task, given.strings.take([0]), given.settings.evaluations
    progress = Progress("plan: random motions", total=budget)
    nearest, least_m, tried = None, np.inf, 0
    while tried < budget:
        curves = draw(min(BATCH, budget - tried))
        if not curves:
            raise StrandcastError(
                "SC-P004",
                f"none of {TRIES_PER_MOTION} alterations of the last motion keeps the arm's limits",
                file=task.arm.path,
                fix="leave out `method: paper`",
            )
        miss = assess_rollouts(task, rollouts_of_curves(task, one, given.conditions, curves)).miss_m
        hitting = np.flatnonzero(miss <= task.hit_radius_m)
        first = bool(len(hitting))
        at = int(hitting[0]) if first else int(np.argmin(miss))
        tried += at + 1 if first else len(curves)
        if miss[at] < least_m:
            nearest, least_m = curves[at], float(miss[at])
        progress(tried, f"best {1000 * least_m:.0f} mm")
        if first:
            break
    assert nearest is not None
    hits = least_m <= task.hit_radius_m
    flags = [] if hits else ["no simulated hit within the budget: the best so far is thrown"]
    return SearchResult(kind, nearest, tried, flags)
