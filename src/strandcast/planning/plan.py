"""Plan the first motion and every later one: candidates, the probability that each hits, the likeliest."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, cast

import numpy as np

from strandcast.arm.servo import identify
from strandcast.arm.urdf import massless
from strandcast.arm.yielding_joints import JointResponse, identify_yielding
from strandcast.config.plan import PlanSettings
from strandcast.core.disturbances import TYPICAL_SIZES
from strandcast.core.strings import StringBatch
from strandcast.errors import StrandcastError
from strandcast.planning.bezier import Curve
from strandcast.planning.bias_correction import likely_miss_m, stable_on_past_trials
from strandcast.planning.describe import PlannedMotion, describe, most_likely, stopped_outside_m
from strandcast.planning.global_search import search_globally
from strandcast.planning.local_search import (
    Neighbourhood,
    disturbed_near,
    neighbourhood,
    rollouts_near,
    search_near,
    with_every_disturbance,
)
from strandcast.planning.miss_calibration import FAILED_M, UNTESTED_SHARE, Evidence
from strandcast.planning.paper import first_by_paper, later_by_paper
from strandcast.planning.past_trials import PastTrial
from strandcast.planning.paths import paths_of_any
from strandcast.planning.reachability import refuse_unreachable
from strandcast.planning.rollouts import AFTER_END_S, RolloutConditions, rollouts_of_curves
from strandcast.planning.scenarios import crossed
from strandcast.planning.search import SearchInputs, SearchResult
from strandcast.planning.task import PlanningTask
from strandcast.progress import print_line

# What a further search may still add to the probability of a hit: if less, there is none. Chosen.
WORTH_A_SEARCH = 0.1
SEARCHES = 3  # from nothing; chosen: each takes as long as the first
# What the servo's response leaves of a joint's angle, above which joints are modelled as yielding; chosen: a
# milliradian moves the hand by a millimetre.
YIELDS_RAD = 1e-3

Candidate = Callable[[], PlannedMotion]  # one way to find a motion


def plan_first(
    task: PlanningTask,
    strings: StringBatch,
    settings: PlanSettings,
    rng: np.random.Generator,
    rehearsal: PastTrial | None = None,
    method: Literal["paper"] | None = None,
    searches: int = SEARCHES,
) -> PlannedMotion:
    """Plan a motion for a string that was never thrown.

    Parameters
    ----------
    rehearsal
        A motion that the arm played without the string: how its joints follow is known from there, not from
        the arm's file.
    method
        Paper: plan as the paper, on the commanded angles: it mentions no response of the servo (section V).
    searches
        From nothing, at most.

    Raises
    ------
    StrandcastError
        The target is out of reach, or the arm's limits leave no motion.
    """
    refuse_unreachable(task)
    given = _inputs(task, strings, settings, rng, [rehearsal] if rehearsal else [], method)
    if method == "paper":
        return predicted(given, first_by_paper(given))
    if rehearsal is None or rehearsal.curve is None:
        return likeliest(task, [lambda: from_nothing(given, "first")] * searches)
    near = neighbourhood(task, strings, given.conditions, rehearsal, [rehearsal])
    # Nothing is known of the string, so that every one is disturbed, as in a search from nothing.
    scattered = disturbed_near(task, near, given.sizes)
    far = replace(given, evidence=Evidence(_unexplained_m(task, rehearsal, near)))
    return likeliest(
        task,
        [
            lambda: _near(given, near, scattered, SearchResult("rehearsed", near.best, 0, [])),
            lambda: from_nothing(far, "rehearsed"),
        ],
    )


def plan_next(
    task: PlanningTask,
    strings: StringBatch,
    past_trials: list[PastTrial],
    settings: PlanSettings,
    rng: np.random.Generator,
    fit_E_m: float | None = None,
    method: Literal["paper"] | None = None,
) -> PlannedMotion:
    """Plan the motion after one or more trials.

    Parameters
    ----------
    strings
        The fitted strings, the best first.
    past_trials
        The trials so far, in order.
    fit_E_m
        E of the newest trial after the fit: the model's error far from the trials; None: unknown.
    method
        See `plan_first`.

    Raises
    ------
    StrandcastError
        The target is out of reach; or, for the paper's planner, no past trial was played from a motion with
        control heights.
    """
    refuse_unreachable(task)
    known = [trial for trial in past_trials if trial.curve is not None]
    if not known and method == "paper":
        raise StrandcastError(
            "SC-P005",
            "no past trial has a motion with control heights to start from",
        )
    given = _inputs(task, strings, settings, rng, past_trials, method)
    given = replace(given, evidence=Evidence(fit_E_m or 0.0, _surprises(past_trials)))
    if method == "paper":
        found = later_by_paper(given, cast(Curve, known[-1].curve))
        return predicted(given, replace(found, parent_trial=known[-1].trial))
    given, flags = _without_diverging(given, past_trials)
    again: list[Candidate] = [lambda: from_nothing(given, "replanned")]
    plan = likeliest(task, [*_near_trials(given, known), *again] if known else again * SEARCHES)
    if any(trial.trial == plan.parent_trial and trial.curve is plan.curve for trial in known):
        print_line(f"plan: repeats trial {plan.parent_trial}'s motion: no change was found likelier to hit")
    return replace(plan, flags=(*plan.flags, *flags))


def likeliest(task: PlanningTask, candidates: Sequence[Candidate]) -> PlannedMotion:
    """Return the candidate that is likeliest to hit; the rest is left out once it can add little to that.

    One that the player refuses, because a stop on the way would leave the workspace, is a last resort.
    """

    def preference(plan: PlannedMotion) -> tuple[bool, float]:
        return stopped_outside_m(task, plan.curve) == 0.0, plan.hit_probability(task.hit_radius_m)

    plans: list[PlannedMotion] = []
    for number, candidate in enumerate(candidates, 1):
        try:
            plans.append(candidate())
        except StrandcastError as error:  # a limit is lower than when a motion like it was played
            no_motion = error.field == "plan" or number == len(candidates)
            if error.code != "SC-P004" or (no_motion and not plans):
                raise
            print_line(f"plan: motion {number} is left out: {error.what}")
            continue
        stays, likely = preference(plans[-1])
        print_line(f"plan: motion {number}, {plans[-1].kind}: {100 * likely:.0f} % likely to hit")
        if stays and likely > most_likely(task, plans[-1]) - WORTH_A_SEARCH:
            break
    best = max(plans, key=preference)
    return replace(best, simulations=sum(plan.simulations for plan in plans))


def from_nothing(given: SearchInputs, kind: str) -> PlannedMotion:
    """Plan as if nothing had been thrown."""
    return predicted(given, SearchResult(kind, *search_globally(given), []))


def _near_trials(given: SearchInputs, known: list[PastTrial]) -> list[Candidate]:
    """Return the motions near the best trial's: changed, as it is, and changed for disturbed strings."""
    task = given.task
    misses = [likely_miss_m(task, given.strings, trial) for trial in known]
    best, miss_m = known[int(np.argmin(misses))], min(misses)
    untested_m = UNTESTED_SHARE * min(miss_m, FAILED_M)
    given = replace(given, evidence=given.evidence._replace(untested_m=untested_m))
    near = neighbourhood(task, given.strings, given.conditions, best, known)
    scattered = disturbed_near(task, near, given.sizes)
    flags = [f"trial {trial.trial}: no tip seen" for trial in known if not np.isfinite(trial.tip_m).any()]
    played = SearchResult("refined", near.best, 0, flags, best.trial)
    return [
        lambda: _near(given, near, near, played),
        lambda: predicted_near(given, near, played),
        lambda: _near(given, near, scattered, played),
    ]


def _near(
    given: SearchInputs, near: Neighbourhood, simulated: Neighbourhood, played: SearchResult
) -> PlannedMotion:
    """Plan near a motion that was played, with some strings; describe it with all as they were fitted."""
    curve, simulations = search_near(given.task, simulated, given.settings)
    return predicted_near(given, near, replace(played, curve=curve, simulations=simulations))


def predicted_near(given: SearchInputs, near: Neighbourhood, found: SearchResult) -> PlannedMotion:
    """Describe a motion with the bias correction of the trials near it."""
    task = given.task
    paths = paths_of_any([found.curve], task.step_s, AFTER_END_S)
    heights = found.curve.heights_rad_s[None]
    scattered = rollouts_near(task.rough(), with_every_disturbance(task, near, given.sizes), paths, heights)
    rollouts = rollouts_near(task, near, paths, heights)
    return describe(given, found, rollouts, scattered)


def predicted(given: SearchInputs, found: SearchResult) -> PlannedMotion:
    """Describe a motion without bias correction."""
    task = given.task
    every = crossed(given.strings, len(task.arm.joints), given.sizes)
    scattered = rollouts_of_curves(task.rough(), every, given.conditions, [found.curve])
    rollouts = rollouts_of_curves(task, given.strings, given.conditions, [found.curve])
    return describe(given, found, rollouts, scattered)


def _inputs(
    task: PlanningTask,
    strings: StringBatch,
    settings: PlanSettings,
    rng: np.random.Generator,
    played: list[PastTrial],
    method: str | None,
) -> SearchInputs:
    servo = None if method == "paper" else fitted_servo(task, played)
    sizes = settings.disturbances * TYPICAL_SIZES
    inputs = SearchInputs(task, strings, RolloutConditions(servo), settings, rng, sizes)
    return replace(inputs, planner=method or inputs.planner)


def _unexplained_m(task: PlanningTask, rehearsal: PastTrial, near: Neighbourhood) -> float:
    """Return by how much (rms) the joints' response leaves the hand wrong: far away, nothing corrects it."""
    q_rad = rehearsal.q_rad
    off_m = task.arm.hand_m(q_rad) - task.arm.hand_m(q_rad - near.bias.joints_rad[0])
    return float(np.sqrt(np.mean((off_m**2).sum(axis=1))))


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
    if left_rad.max() < YIELDS_RAD or massless(task.arm.model(), task.arm.joints):
        return servo
    yielding, still_left_rad = identify_yielding(time_s, commands, q, task.arm.spatial_dynamics)
    return yielding if still_left_rad.max() < 0.5 * left_rad.max() else servo
