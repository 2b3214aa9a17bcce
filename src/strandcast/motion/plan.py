"""Plan the first motion and every later one."""

from __future__ import annotations

import numpy as np

from strandcast.arm.servo import Servo, identify
from strandcast.errors import StrandcastError
from strandcast.motion.describe import Found, Plan, described
from strandcast.motion.earlier import Earlier
from strandcast.motion.first import plan_anew
from strandcast.motion.later import neighbourhood, plan_near, throw_near
from strandcast.motion.paper import first_by_paper, later_by_paper
from strandcast.motion.rank import likely_miss_m
from strandcast.motion.strings import Strings, regrasped
from strandcast.motion.task import Options, Task, refuse_unreachable
from strandcast.motion.throws import World, throw_curves

GOOD_ENOUGH = (
    1.5  # hit radii: what a motion may cost, lateness and folding included, without a look for others
)


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
        curve, simulations, hit = first_by_paper(task, strings, world, options, rng)
        found = Found("first", curve, simulations, _paper_flags(hit))
    else:
        found = _anew("first", task, strings, world, options, rng)
    return described(task, strings, options, found, throw_curves(task, strings, world, [found.curve]))


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
        No earlier trial was played from a motion with control heights, or the target is out of reach.
    """
    refuse_unreachable(task)
    known = [trial for trial in earlier if trial.curve is not None]
    if not known:
        raise StrandcastError(
            "SC-P005",
            "no earlier trial has a motion with control heights to start from",
            field="bezier",
            fix="throw a motion that `strandcast plan` made, or plan a first motion",
        )
    world = World((servo or fitted_servo(task, earlier)) if options.use_servo else None)
    if options.planner == "paper":
        found = _altered_last(task, strings, world, known[-1], options, rng)
        return described(task, strings, options, found, throw_curves(task, strings, world, [found.curve]))
    misses = [likely_miss_m(task, strings, trial) for trial in known]
    best, least_m = known[int(np.argmin(misses))], min(misses)
    if least_m > options.replan_from_miss_m and (fit_E_m or 0.0) > options.replan_from_E_m:
        why = f"the fit leaves {1000 * (fit_E_m or 0.0):.1f} mm and no throw came near"
        return _replanned(task, strings, world, options, rng, why)
    plan = _refined(task, strings, world, best, least_m, known, options, rng)
    if plan.cost_m <= GOOD_ENOUGH * task.hit_radius_m:
        return plan
    why = f"near trial {best.trial}'s motion the best is {1000 * plan.cost_m:.0f} mm"
    anew = _replanned(task, strings, world, options, rng, why)
    return anew if anew.cost_m < plan.cost_m else plan


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
    few = neighbourhood(task, strings.first(options.members), world, best, known, regrasp=rng)
    curve, simulations = plan_near(task, few, miss_m, options, rng)
    flags = [f"trial {trial.trial}: no tip seen" for trial in known if not np.isfinite(trial.tip_m).any()]
    thrown, shift = throw_near(task, neighbourhood(task, strings, world, best, known), [curve])
    return described(
        task, strings, options, Found("refined", curve, simulations, flags, best.trial), thrown, shift
    )


def _replanned(
    task: Task, strings: Strings, world: World, options: Options, rng: np.random.Generator, why: str
) -> Plan:
    """Plan anew with the fitted strings, as if nothing had been thrown."""
    found = _anew("replanned", task, strings.first(options.members), world, options, rng)
    found.flags.append(f"planned anew: {why}")
    return described(task, strings, options, found, throw_curves(task, strings, world, [found.curve]))


def fitted_servo(task: Task, earlier: list[Earlier]) -> Servo:
    """Return the servo's response that explains the joints of all trials as long as the last one."""
    same = [trial for trial in earlier if trial.q.shape == earlier[-1].q.shape]
    time_s = np.arange(len(same[0].q)) * task.step_s
    q = np.array([trial.q for trial in same])
    return identify(time_s, np.array([trial.q_command for trial in same]), q, task.arm.servo)[0]


def _anew(
    kind: str, task: Task, strings: Strings, world: World, options: Options, rng: np.random.Generator
) -> Found:
    curve, simulations = plan_anew(task, regrasped(strings, rng), world, options, rng)
    return Found(kind, curve, simulations, [])


def _altered_last(
    task: Task, strings: Strings, world: World, last: Earlier, options: Options, rng: np.random.Generator
) -> Found:
    assert last.curve is not None
    curve, simulations, hit = later_by_paper(task, strings, world, options, last.curve, rng)
    return Found("refined", curve, simulations, _paper_flags(hit), last.trial)


def _paper_flags(hit: bool) -> list[str]:
    return [] if hit else ["no simulated hit within the budget: the best so far is thrown"]
