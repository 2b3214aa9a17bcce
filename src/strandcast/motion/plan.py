"""Plan the first motion and every later one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from strandcast.arm.servo import Servo, identify
from strandcast.errors import StrandcastError
from strandcast.motion.bezier import Curve
from strandcast.motion.describe import Found, Plan, described, stopped_outside_m
from strandcast.motion.earlier import Earlier
from strandcast.motion.first import GOOD_ENOUGH, plan_anew
from strandcast.motion.later import neighbourhood, plan_near, throw_near, with_every_disturbance
from strandcast.motion.paper import first_by_paper, later_by_paper
from strandcast.motion.paths import paths_of_any
from strandcast.motion.rank import likely_miss_m
from strandcast.motion.residual import distance_rad_s
from strandcast.motion.strings import Strings, crossed
from strandcast.motion.task import Options, Task, refuse_unreachable
from strandcast.motion.throws import AFTER_END_S, World, assessed, throw_curves

# Within this of a trial, rms over the control heights, nearly nine throws in ten passed within half of a
# hit radius of 20 mm of where they were foreseen to (docs/throws.md).
TESTED_RAD_S = 0.5


def plan_first(task: Task, strings: Strings, options: Options, rng: np.random.Generator) -> Plan:
    """Plan a motion for a string that was never thrown.

    Parameters
    ----------
    task
        Arm, target, workspace.
    strings
        What the string may be.
    options
        Planner and budget.
    rng
        Source of chance.

    Raises
    ------
    StrandcastError
        The target is out of reach, or the arm's limits leave no motion.
    """
    refuse_unreachable(task)
    world = World(task.arm.servo if options.use_servo else None)
    if options.planner == "paper":
        by_paper = first_by_paper(task, strings, world, options, rng)
        found = Found("first", by_paper.curve, by_paper.simulations, _paper_flags(by_paper.hit))
    else:
        found = _anew("first", task, strings, world, options, rng)
    return _described(task, strings, world, options, found)


def plan_next(
    task: Task,
    strings: Strings,
    earlier: list[Earlier],
    options: Options,
    rng: np.random.Generator,
    servo: Servo | None = None,
    fit_E_m: float | None = None,
) -> Plan:
    """Plan the motion after one or more trials.

    Parameters
    ----------
    task, options, rng
        See `plan_first`.
    strings
        The fitted strings, the best first.
    earlier
        The trials so far, in order.
    servo
        The servo's response; identified from the earlier trials' joints if not given.
    fit_E_m
        E of the newest trial after the fit, the best warning of a miss.

    Raises
    ------
    StrandcastError
        The target is out of reach; or, for the paper's planner, no earlier trial was played from a motion
        with control heights.
    """
    refuse_unreachable(task)
    known = [trial for trial in earlier if trial.curve is not None]
    if not known and options.planner == "paper":
        raise StrandcastError(
            "SC-P005",
            "no earlier trial has a motion with control heights to start from",
            fix="throw a motion that `strandcast plan` made, or list the trials under `excluded`: then the "
            "next motion is planned as a first one",
        )
    servo = servo or (fitted_servo(task, earlier) if earlier else task.arm.servo)
    world = World(servo if options.use_servo else None)
    if options.planner == "paper":
        found = _altered_last(task, strings, world, known[-1], options, rng)
        plan = _described(task, strings, world, options, found)
    else:
        plan = _near_or_anew(task, strings, world, known, options, rng, fit_E_m or 0.0)
    return replace(plan, flags=(*plan.flags, *_far_flags(plan.curve, known)))


def _near_or_anew(
    task: Task,
    strings: Strings,
    world: World,
    known: list[Earlier],
    options: Options,
    rng: np.random.Generator,
    fit_E_m: float,
) -> Plan:
    """Plan near the best trial, or anew where no good throw is to be had there."""
    if not known:
        why = "no earlier trial has a motion with control heights"
        return _replanned(task, strings, world, options, rng, why)
    misses = [likely_miss_m(task, strings, trial) for trial in known]
    best, least_m = known[int(np.argmin(misses))], min(misses)
    if least_m > options.replan_from_miss_m and fit_E_m > options.replan_from_E_m:
        why = f"the fit leaves {1000 * fit_E_m:.1f} mm and no throw came near"
        return _replanned(task, strings, world, options, rng, why)
    plan = _refined(task, strings, world, best, least_m, known, options, rng)
    if plan.cost_m <= GOOD_ENOUGH * task.hit_radius_m:
        return plan
    why = f"near trial {best.trial}'s motion the best is {1000 * plan.cost_m:.0f} mm"
    anew = _replanned(task, strings, world, options, rng, why)
    spent = plan.simulations + anew.simulations
    return replace(anew if anew.cost_m < plan.cost_m else plan, simulations=spent)


def _refined(
    task: Task,
    strings: Strings,
    world: World,
    best: Earlier,
    miss_m: float,
    known: list[Earlier],
    options: Options,
    rng: np.random.Generator,
) -> Plan:
    """Plan near the best trial, and describe the motion with all strings as they were fitted."""
    near = neighbourhood(task, strings, world, best, known, options)
    curve, simulations = _stopped_inside(task, lambda task: plan_near(task, near, miss_m, options, rng))
    flags = [f"trial {trial.trial}: no tip seen" for trial in known if not np.isfinite(trial.tip_m).any()]
    paths, heights = paths_of_any([curve], task.step_s, AFTER_END_S), curve.heights_rad_s[None]
    rough = task.rough()
    spread = throw_near(rough, with_every_disturbance(task, near, options), paths, heights)
    found = Found("refined", curve, simulations, flags, best.trial)
    return described(
        task, strings, options, found, throw_near(task, near, paths, heights), assessed(rough, *spread).miss_m
    )


def _replanned(
    task: Task, strings: Strings, world: World, options: Options, rng: np.random.Generator, why: str
) -> Plan:
    """Plan anew with the fitted strings, as if nothing had been thrown."""
    found = _anew("replanned", task, strings, world, options, rng)
    found.flags.append(f"planned anew: {why}")
    return _described(task, strings, world, options, found)


def _described(task: Task, strings: Strings, world: World, options: Options, found: Found) -> Plan:
    """Describe a motion to which nothing is carried over."""
    rough = task.rough()
    every = crossed(strings, len(task.arm.joints), options.disturbances)
    spread_m = assessed(rough, throw_curves(rough, every, world, [found.curve])).miss_m
    thrown = throw_curves(task, strings, world, [found.curve])
    return described(task, strings, options, found, (thrown, None), spread_m)


def fitted_servo(task: Task, earlier: list[Earlier]) -> Servo:
    """Return the servo's response that explains the joints of all trials as long as the last one."""
    same = [trial for trial in earlier if trial.q.shape == earlier[-1].q.shape]
    time_s = np.arange(len(same[0].q)) * task.step_s
    q = np.array([trial.q for trial in same])
    return identify(time_s, np.array([trial.q_command for trial in same]), q, task.arm.servo)[0]


def _anew(
    kind: str, task: Task, strings: Strings, world: World, options: Options, rng: np.random.Generator
) -> Found:
    curve, simulations = _stopped_inside(task, lambda task: plan_anew(task, strings, world, options, rng))
    return Found(kind, curve, simulations, [])


def _stopped_inside(task: Task, search: Callable[[Task], tuple[Curve, int]]) -> tuple[Curve, int]:
    """Search; where a stop could take arm or string out of the arm's workspace, once more with a price on it.

    Most arms have the room, and the price takes time.
    """
    curve, simulations = search(task)
    out_m = stopped_outside_m(task, curve)
    if out_m == 0.0:
        return curve, simulations
    other, more = search(replace(task, price_stops=True))
    return other if stopped_outside_m(task, other) < out_m else curve, simulations + more


def _altered_last(
    task: Task, strings: Strings, world: World, last: Earlier, options: Options, rng: np.random.Generator
) -> Found:
    assert last.curve is not None
    by_paper = later_by_paper(task, strings, world, options, last.curve, rng)
    flags = _paper_flags(by_paper.hit)
    return Found("refined", by_paper.curve, by_paper.simulations, flags, last.trial)


def _far_flags(curve: Curve, known: list[Earlier]) -> list[str]:
    far_rad_s = distance_rad_s(curve, known)
    if far_rad_s <= TESTED_RAD_S:
        return []
    if not np.isfinite(far_rad_s):
        where = "no trial had its posture and time"
    else:
        where = f"{far_rad_s:.1f} rad/s (rms over the heights) from the nearest trial"
    return [f"outside the tested region: {where}: less is known of how it will go"]


def _paper_flags(hit: bool) -> list[str]:
    return [] if hit else ["no simulated hit within the budget: the best so far is thrown"]
