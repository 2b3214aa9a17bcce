"""Plan the first motion and every later one."""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np

from strandcast.arm.link_masses import massless_joints
from strandcast.arm.servo import identify
from strandcast.arm.yielding_joints import JointResponse, YieldingJoints, identify_yielding
from strandcast.config.plan import PlanSettings
from strandcast.core.disturbances import TYPICAL_SIZES
from strandcast.core.strings import StringBatch
from strandcast.errors import StrandcastError
from strandcast.planning.bezier import Curve
from strandcast.planning.describe import PlannedMotion, describe, stopped_outside_m
from strandcast.planning.global_search import search_globally
from strandcast.planning.local_search import (
    Neighbourhood,
    disturbed_near,
    neighbourhood,
    rollouts_near,
    search_near,
    with_every_disturbance,
)
from strandcast.planning.miss_calibration import FAILED_M, UNTESTED_SHARE, Evidence, rms_of
from strandcast.planning.paper import first_by_paper, later_by_paper
from strandcast.planning.past_trials import PastTrial
from strandcast.planning.paths import paths_of_any
from strandcast.planning.ranking import likely_miss_m, stable_on_past_trials
from strandcast.planning.reachability import refuse_unreachable
from strandcast.planning.rollouts import AFTER_END_S, RolloutConditions, rollouts_of_curves
from strandcast.planning.scenarios import crossed
from strandcast.planning.search import SearchInputs, SearchResult
from strandcast.planning.task import PlanningTask
from strandcast.progress import print_line

# A later motion in the plane is searched for globally if both the fit's E and the least miss so far are above
# these. A fit above 8 mm is the best warning of a miss; 20 mm is the default hit radius.
REPLAN_FROM_E_M = 0.008
REPLAN_FROM_MISS_M = 0.020
# After a miss, a later motion is also compared with one searched for from nothing if the best near the trials
# misses by more than this share of the hit radius (rms) and the fit's E is at most this; chosen.
NEAR_ENOUGH, TRUSTED_E_M = 0.25, 0.005
# Probabilities of a hit below which a later motion is compared with others near it, or a search in space is
# repeated, and below which any motion is searched for again from nothing; chosen.
LIKELY, FAIR = 0.9, 0.6
MOST_ATTEMPTS = 3  # of a search from nothing; chosen: each takes as long as the first
# What the servo's response leaves of a joint's angle above which joints are taken to yield, where that
# leaves less than half, and up to which yielding joints are known far from a played motion, too; chosen: a
# milliradian moves the hand by a millimetre.
YIELDS_RAD, KNOWN_RAD = 1e-3, 2e-3
FAR_PROMISE = 0.5  # of the rms miss near a motion that was played: a motion far off must promise less; chosen
HOPELESS = 10.0  # hit radii: so far off it is not bad luck of the search, and another attempt finds the same


def plan_first(
    task: PlanningTask,
    strings: StringBatch,
    settings: PlanSettings,
    rng: np.random.Generator,
    rehearsal: PastTrial | None = None,
) -> PlannedMotion:
    """Plan a motion for a string that was never thrown.

    Parameters
    ----------
    task
        Arm, target, workspace.
    strings
        The plausible strings.
    settings
        Planner and budget.
    rng
        Random numbers.
    rehearsal
        A motion that the arm played without the string: how its joints follow is known from there, not from
        the arm's file.

    Raises
    ------
    StrandcastError
        The target is out of reach, or the arm's limits leave no motion.
    """
    refuse_unreachable(task)
    conditions = _conditions(task, settings, [rehearsal] if rehearsal else [])
    given = SearchInputs(task, strings, conditions, settings, rng, _sizes(settings))
    if settings.planner == "paper":
        return predicted(given, first_by_paper(given))
    if rehearsal and rehearsal.curve is not None and settings.plans_with_servo:
        return _near_rehearsal(given, rehearsal)
    return _globally(given, "first")


def plan_next(
    task: PlanningTask,
    strings: StringBatch,
    past_trials: list[PastTrial],
    settings: PlanSettings,
    rng: np.random.Generator,
    fit_E_m: float | None = None,
) -> PlannedMotion:
    """Plan the motion after one or more trials.

    Parameters
    ----------
    task, settings, rng
        See `plan_first`.
    strings
        The fitted strings, the best first.
    past_trials
        The trials so far, in order.
    fit_E_m
        E of the newest trial after the fit, by which strings are trusted far from the trials; None: unknown.

    Raises
    ------
    StrandcastError
        The target is out of reach; or, for the paper's planner, no past trial was played from a motion with
        control heights.
    """
    refuse_unreachable(task)
    known = [trial for trial in past_trials if trial.curve is not None]
    if not known and settings.planner == "paper":
        raise StrandcastError(
            "SC-P005",
            "no past trial has a motion with control heights to start from",
        )
    conditions = _conditions(task, settings, past_trials)
    # A motion from scratch meets the model's error as the newest trial did, without bias correction.
    evidence = Evidence(fit_E_m or 0.0, _surprises(past_trials))
    given = SearchInputs(task, strings, conditions, settings, rng, _sizes(settings), evidence)
    if settings.planner == "paper":
        found = later_by_paper(given, cast(Curve, known[-1].curve))
        return predicted(given, replace(found, parent_trial=known[-1].trial))
    simulated, flags = _without_diverging(given, past_trials)
    plan = _near_or_globally(simulated, known, np.nan if fit_E_m is None else fit_E_m)
    return replace(plan, flags=(*plan.flags, *flags))


def _surprises(trials: list[PastTrial]) -> tuple[float, ...]:
    """Return the miss of each trial over the median that was stated, where both are known."""
    return tuple(
        trial.miss_m / trial.stated_m for trial in trials if trial.miss_m is not None and trial.stated_m
    )


def _without_diverging(given: SearchInputs, trials: list[PastTrial]) -> tuple[SearchInputs, list[str]]:
    """Leave out strings that diverge on the joints of a past trial, unless all do; return flags, too.

    The real string was thrown on them, so that such a string is wrong; its miss of a metre would dominate.
    """
    stable = stable_on_past_trials(given.task.rough(), given.strings, trials)
    if stable.all() or not stable.any():
        return given, []
    left_out = f"{(~stable).sum()} of {len(stable)} fitted strings left out"
    strings = given.strings.take(np.flatnonzero(stable))
    return replace(given, strings=strings), [f"{left_out}: they diverge on the joints of a past trial"]


def _sizes(settings: PlanSettings) -> np.ndarray:
    """Return the standard deviations of the disturbances (1, 5), in the order of `DISTURBING`."""
    return settings.disturbances * TYPICAL_SIZES


def _conditions(
    task: PlanningTask, settings: PlanSettings, past_trials: list[PastTrial]
) -> RolloutConditions:
    return RolloutConditions(fitted_servo(task, past_trials) if settings.plans_with_servo else None)


def fitted_servo(task: PlanningTask, past_trials: list[PastTrial]) -> JointResponse:
    """Return the joints' response that explains the logs of all trials as long as the last one.

    Joints that a servo's response does not describe are taken to yield to the arm's torques. Without a log
    it is the arm's nominal response.
    """
    logged = [trial for trial in past_trials if trial.logged]
    if not logged:
        return task.arm.servo
    same = [trial for trial in logged if trial.q_rad.shape == logged[-1].q_rad.shape]
    time_s = np.arange(len(same[0].q_rad)) * task.step_s
    commands, q = np.array([trial.q_command_rad for trial in same]), np.array([trial.q_rad for trial in same])
    servo, left_rad = identify(time_s, commands, q, task.arm.servo)
    if left_rad.max() < YIELDS_RAD or massless_joints(task.arm):
        return servo
    yielding, still_left_rad = identify_yielding(time_s, commands, q, task.arm.spatial_dynamics)
    return yielding if still_left_rad.max() < 0.5 * left_rad.max() else servo


def _globally(given: SearchInputs, kind: str) -> PlannedMotion:
    """Plan with the strings as if nothing had been thrown; search again where a hit is not likely."""
    radius_m = given.task.hit_radius_m
    # The search in space more often ends far from the best motion, and the simulated share is too high.
    enough = LIKELY if given.task.in_space else FAIR
    plans: list[PlannedMotion] = []
    while len(plans) < MOST_ATTEMPTS:
        if plans:
            likely = f"{100 * _likelihood(given.task, plans[-1]):.0f} %"
            print_line(f"plan: {likely} likely to hit, {100 * enough:.0f} % wanted: another search begins")
        curve, simulations = _stopped_inside(
            given.task, lambda task: search_globally(replace(given, task=task))
        )
        plans.append(predicted(given, SearchResult(kind, curve, simulations, [])))
        if _likelihood(given.task, plans[-1]) >= enough or plans[-1].cost_m > HOPELESS * radius_m:
            break
    likeliest = max(plans, key=lambda plan: _likelihood(given.task, plan))
    return replace(likeliest, simulations=sum(plan.simulations for plan in plans))


def _likelihood(task: PlanningTask, plan: PlannedMotion) -> float:
    """Return the probability of a hit by which motions are compared.

    In space it is the simulation's: the search then is the same with and without a calibration, so that one
    search's misses calibrate the next.
    """
    if task.in_space:
        return plan.simulated_hit_probability(task.hit_radius_m)
    return plan.hit_probability(task.hit_radius_m)


def _near_or_globally(given: SearchInputs, known: list[PastTrial], fit_E_m: float) -> PlannedMotion:
    """Plan near the best trial, or globally where no good throw can be found there."""
    if not known:
        return _from_scratch(given, "no past trial has a motion with control heights")
    task = given.task
    misses = [likely_miss_m(task, given.strings, trial) for trial in known]
    best, least_m = known[int(np.argmin(misses))], min(misses)
    # In space the bias corrects the tip near a thrown motion even after a bad fit; elsewhere nothing does.
    bad_fit = not task.in_space and fit_E_m > REPLAN_FROM_E_M
    if bad_fit and least_m > REPLAN_FROM_MISS_M:
        return _from_scratch(given, f"the fit leaves {1000 * fit_E_m:.1f} mm and no throw came near")
    near = _near(given, best, least_m, known)
    # A motion that has hit is a better bet than one found with strings that do not explain why.
    if best.miss_m is not None and best.miss_m <= task.hit_radius_m:
        return near
    likely, rms_m = _likelihood(task, near), _rms_m(near)
    promising = fit_E_m <= TRUSTED_E_M and rms_m > NEAR_ENOUGH * task.hit_radius_m
    if likely >= FAIR and not promising:
        return near
    reason = f"near trial {best.trial}'s motion the best misses by {1000 * rms_m:.1f} mm (rms)"
    again = _from_scratch(given, reason)
    better = likely < FAIR and _likelihood(task, again) > likely
    better |= promising and _rms_m(again) < FAR_PROMISE * rms_m
    return replace(again if better else near, simulations=near.simulations + again.simulations)


def _rms_m(plan: PlannedMotion) -> float:
    """Return the rms of a plan's simulated misses [m]."""
    return rms_of(plan.throws.miss_m)


def _near_rehearsal(given: SearchInputs, rehearsal: PastTrial) -> PlannedMotion:
    """Plan near a motion that was played without the string, with the joints' measured error there."""
    task, settings = given.task, given.settings
    near = neighbourhood(task, given.strings, given.conditions, rehearsal, [rehearsal])
    # Nothing is known of the string, so that every one is disturbed, as in a search from nothing.
    scattered = disturbed_near(task, near, settings.ensemble, given.sizes)
    miss_m = likely_miss_m(task, given.strings, rehearsal)
    curve, simulations = _stopped_inside(
        task, lambda task: search_near(task, scattered, miss_m, settings, given.rng)
    )
    plan = predicted_near(given, near, SearchResult("rehearsed", curve, simulations, []))
    left_rad = np.sqrt(np.mean(near.bias.joints_rad**2, axis=(0, 1))).max()
    if not isinstance(given.conditions.servo, YieldingJoints) or left_rad > KNOWN_RAD:
        return plan
    # The first search assumed that these joints follow; other motions may suit them better.
    print_line("plan: the joints yield more than was assumed: another search begins")
    again = _globally(given, "rehearsed")
    simulations = plan.simulations + again.simulations
    better = _rms_m(again) < FAR_PROMISE * _rms_m(plan)
    return replace(again if better else plan, simulations=simulations)


def _from_scratch(given: SearchInputs, reason: str) -> PlannedMotion:
    print_line(f"plan: a search from scratch begins: {reason}")
    return _globally(given, "replanned")


def _near(given: SearchInputs, best: PastTrial, miss_m: float, known: list[PastTrial]) -> PlannedMotion:
    """Plan near the best trial, and describe the motion with all strings as they were fitted.

    Where the motion is not likely enough to hit, one that is searched for with disturbances and the best
    trial's own are compared with it, and the likeliest is taken.
    """
    task, settings = given.task, given.settings
    given = replace(
        given, evidence=given.evidence._replace(untested_m=UNTESTED_SHARE * min(miss_m, FAILED_M))
    )
    near = neighbourhood(task, given.strings, given.conditions, best, known)
    flags = [f"trial {trial.trial}: no tip seen" for trial in known if not np.isfinite(trial.tip_m).any()]

    def found(strings: Neighbourhood) -> PlannedMotion:
        curve, simulations = _stopped_inside(
            task, lambda task: search_near(task, strings, miss_m, settings, given.rng)
        )
        return described(curve, simulations)

    def described(curve: Curve, simulations: int = 0) -> PlannedMotion:
        result = SearchResult("refined", curve, simulations, flags, best.trial)
        return predicted_near(given, near, result)

    plan = found(near)
    likely = _likelihood(task, plan)
    if likely >= LIKELY:
        return plan
    print_line(f"plan: {100 * likely:.0f} % likely to hit: another search begins, with disturbances")
    others = [
        found(disturbed_near(task, near, settings.ensemble, given.sizes)),
        described(near.best),
    ]
    likeliest = max([plan, *others], key=lambda other: _likelihood(task, other))
    if likeliest is others[-1]:
        print_line(f"plan: repeats trial {best.trial}'s motion: no change was found likelier to hit")
    return replace(likeliest, simulations=plan.simulations + others[0].simulations)


def predicted_near(given: SearchInputs, near: Neighbourhood, found: SearchResult) -> PlannedMotion:
    """Describe a motion with the bias correction of the trials near it."""
    task, settings = given.task, given.settings
    paths = paths_of_any([found.curve], task.step_s, AFTER_END_S)
    heights = found.curve.heights_rad_s[None]
    scattered = rollouts_near(task.rough(), with_every_disturbance(task, near, given.sizes), paths, heights)
    rollouts = rollouts_near(task, near, paths, heights)
    return describe(task, given.strings, settings.planner, found, rollouts, scattered, given.evidence)


def predicted(given: SearchInputs, found: SearchResult) -> PlannedMotion:
    """Describe a motion without bias correction."""
    task, settings = given.task, given.settings
    every = crossed(given.strings, len(task.arm.joints), given.sizes)
    scattered = rollouts_of_curves(task.rough(), every, given.conditions, [found.curve])
    rollouts = rollouts_of_curves(task, given.strings, given.conditions, [found.curve])
    return describe(task, given.strings, settings.planner, found, rollouts, scattered, given.evidence)


def _stopped_inside(
    task: PlanningTask, search: Callable[[PlanningTask], tuple[Curve, int]]
) -> tuple[Curve, int]:
    """Search; if a stop could take arm or string out of the arm's workspace, repeat with a price on that.

    Most arms have the room, and the price takes time. In space there is no such price.
    """
    curve, simulations = search(task)
    if task.in_space:
        return curve, simulations
    out_m = stopped_outside_m(task, curve)
    if out_m == 0.0:
        return curve, simulations
    print_line(f"plan: a stop could lead {1000 * out_m:.0f} mm out of the workspace: another search begins")
    other, more = search(replace(task, price_stops=True))
    return other if stopped_outside_m(task, other) < out_m else curve, simulations + more
