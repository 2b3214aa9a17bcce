"""The loop in space: plan, throw in the lab, fit to the supplied track, plan again.

    python -m strandcast_studies.benchmarks.space.run --seeds 7001-7020 --out results/bench-space.json

Every seed has its own string, target, servo and throw-to-throw variation; even ones throw with six joints,
odd ones with seven. Nothing but lengths, the places of weights, the joint log and the track leaves the lab.
With ``--rehearsed`` the first motion is played with an empty clamp and planned again before trial 1; as it
was before it is thrown, too, as trial 0 under ``unrehearsed``, with the same throw-to-throw variation.
"""

import json
import time
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from strandcast.config.estimate import EstimateSettings
from strandcast.config.plan import PlanSettings
from strandcast.core.closest_approach import closest_approach
from strandcast.core.interpolation import resampled
from strandcast.dynamics.masses import mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.estimation.cable_series import CableSeries
from strandcast.estimation.cable_space import THROWN_POINTS, space_of_cable
from strandcast.estimation.estimate import estimate
from strandcast.estimation.fit import StringFit
from strandcast.estimation.unknowns import given_of
from strandcast.estimation.windows import parts_of_series
from strandcast.lab.driver import joint_log
from strandcast.lab.strings import EMPTY_CLAMP
from strandcast.lab.swing import LabSwing
from strandcast.lab.swing_in_space import VariationInSpace, simulate_swing_in_space
from strandcast.lab.tracked_points import TrackerNoise, points_at, with_tracker_noise
from strandcast.lab.truth import true_miss
from strandcast.lab.variation import LabClocks, draw_variation
from strandcast.planning.describe import PlannedMotion
from strandcast.planning.miss_calibration import rms_of
from strandcast.planning.past_trials import PastTrial, start_shape
from strandcast.planning.plan import plan_first, plan_next
from strandcast.planning.rollouts import AFTER_END_S
from strandcast.planning.scenarios import STRINGS
from strandcast.planning.start_strings import start_strings_in_space
from strandcast.planning.task import PlanningTask
from strandcast.stages.trials_in_space import FASTEST_M_S, FITTED_AFTER_S, FITTED_BEFORE_S
from strandcast_studies.benchmarks.loop.run import outcome, run_jobs, run_parser
from strandcast_studies.benchmarks.loop.throw import FILMED_AFTER_S, FILMED_BEFORE_S, FRAME_RATE_HZ
from strandcast_studies.benchmarks.space.drawn import SpaceCase, drawn_case

REPORTED_SEEDS = range(7001, 7021)
POINTS = THROWN_POINTS
# Chosen: some twenty seconds of one core. These arms are slower than those of the plane, and on tuning seeds
# motions of up to 1.3 s hit targets that shorter ones miss.
PLAN = PlanSettings(evaluations=1800, duration_s=(0.4, 1.3))
ESTIMATE = EstimateSettings(evaluations=800).in_space(thrown=True)
HIT_RADIUS_M = 0.020
JOINTS_SMOOTHED = 11  # samples of the joint log: its noise would shake the string; chosen


class SpaceTrial(NamedTuple):
    """One throw, as the fit and the planner take it, and its true miss [m]."""

    past: PastTrial
    series: CableSeries
    true_miss_m: float


class PlayedSwing(NamedTuple):
    """A motion that the lab played: its swing, and times and joints of the log (R,), (R, J) [s, rad]."""

    swing: LabSwing
    log_s: np.ndarray
    q_rad: np.ndarray


@dataclass(frozen=True)
class SpaceOutcome:
    """What is reported of one throw, named as in `LoopTrial`; lengths in metres, CPU times in seconds."""

    trial: int
    kind: str
    miss_m: float | None
    true_miss_m: float
    predicted_m: float
    hit_probability: float
    simulated_hit_probability: float
    miss_rms_m: float
    fit_E_m: float | None
    tip_speed_m_s: float
    simulations: int
    flags: tuple[str, ...]
    plan_cpu_s: float
    estimate_cpu_s: float


def task_of_case(case: SpaceCase) -> PlanningTask:
    """Return the planning task of a case."""
    model = StringModel(case.string.length_m, POINTS, dt_s=ESTIMATE.dt_s)
    return PlanningTask(case.arm, model, case.target_m, HIT_RADIUS_M)


def run_case(
    seed: int, trials: int, *, drag_along: bool = True, rehearsed: bool = False, every: bool = False
) -> list[SpaceOutcome]:
    """Throw until the string's tip hits, `trials` times at most.

    Parameters
    ----------
    seed, trials
        Number of the case, and most throws.
    drag_along
        Whether the fit has a drag along the string of its own.
    rehearsed
        Whether the first motion is rehearsed; as it was before, it is thrown as trial 0.
    every
        Whether to go on after a hit.
    """
    case = drawn_case(seed)
    task, random = task_of_case(case), np.random.default_rng([seed, 8])
    layout = mass_layout(case.string.length_m, POINTS, case.weight_places_m)
    first = start_strings_in_space(STRINGS, case.string.length_m, layout, random)
    begin_s = fitted_s = time.process_time()
    plan = plan_first(task, first, PLAN, random)
    thrown: list[SpaceTrial] = []
    done: list[SpaceOutcome] = []
    fit: StringFit | None = None
    if rehearsed:
        cpu_s = time.process_time() - fitted_s, 0.0
        before = throw_in_space(case, plan, 0, np.random.default_rng([seed, 0, 9]))
        done.append(_outcome(plan, before, None, cpu_s))
        # Other random numbers, so that throws vary as they do without a rehearsal.
        played = rehearse(case, plan, np.random.default_rng([seed, 10]))
        begin_s = fitted_s = time.process_time()
        plan = plan_first(task, first, PLAN, random, rehearsal=played)
    while True:
        cpu_s = time.process_time() - fitted_s, fitted_s - begin_s
        thrown.append(
            throw_in_space(case, plan, len(thrown) + 1, np.random.default_rng([seed, len(thrown), 9]))
        )
        done.append(_outcome(plan, thrown[-1], fit, cpu_s))
        hit = thrown[-1].true_miss_m <= HIT_RADIUS_M and not every
        if hit or len(thrown) == trials:
            return done
        begin_s = time.process_time()
        fit = estimated(case, thrown, fit, random, drag_along=drag_along)
        fitted_s = time.process_time()
        strings = fit.members.thrown()
        past = [trial.past for trial in thrown]
        plan = plan_next(task, strings, past, PLAN, random, fit_E_m=fit.E_m)


def rehearse(case: SpaceCase, plan: PlannedMotion, random: np.random.Generator) -> PastTrial:
    """Play a motion with an empty clamp; what is measured are the joints."""
    along, across = _variation(case, random)
    held_well = VariationInSpace(replace(along, grasp_length_m=0.0), across)
    bare = replace(case, string=EMPTY_CLAMP, curl_turn_rad=0.0)
    played = _played(bare, plan, held_well, random)
    return _past(case, plan, 0, played, np.zeros(0), np.zeros((0, POINTS + 1, 3)))


def throw_in_space(
    case: SpaceCase, plan: PlannedMotion, trial: int, random: np.random.Generator
) -> SpaceTrial:
    """Throw a motion in the lab, and return what is measured of it."""
    motion_s = plan.motion.end_s
    played = _played(case, plan, _variation(case, random), random)
    frame_s, points_m = _track(played.swing, motion_s, random)
    past = _past(case, plan, trial, played, frame_s, points_m)
    used = (frame_s >= -FITTED_BEFORE_S) & (frame_s <= motion_s + FITTED_AFTER_S)
    pose = case.arm.hand_path(resampled(frame_s[used], played.log_s, played.q_rad))
    places = np.linspace(0.0, 1.0, POINTS + 1)[1:]
    series = CableSeries(frame_s[used], pose, points_m[used, 1:], places, fastest_m_s=FASTEST_M_S)
    return SpaceTrial(past, series, true_miss(played.swing, case.target_m, motion_s)[0])


def _variation(case: SpaceCase, random: np.random.Generator) -> VariationInSpace:
    return VariationInSpace(*(draw_variation(random, len(case.arm.joints), 1.0) for _ in range(2)))


def _played(
    case: SpaceCase, plan: PlannedMotion, variation: VariationInSpace, random: np.random.Generator
) -> PlayedSwing:
    """Play a motion in the lab, and return the swing and the joint log on the motion's clock."""
    arm, motion_s = case.arm, plan.motion.end_s
    command = plan.motion.resampled(1.0 / arm.log_rate_hz)
    swing = simulate_swing_in_space(arm, case.servo, case.string, case.curl_turn_rad, variation, command)
    log = joint_log(arm, swing, variation.along, LabClocks(-swing.time_s[0], 0.0, 0.0), motion_s, random)
    log_s = log.time_s - log.time_s[0] + swing.time_s[0]
    return PlayedSwing(swing, log_s, savgol_filter(log.q_rad, JOINTS_SMOOTHED, 2, axis=0))


def _past(
    case: SpaceCase,
    plan: PlannedMotion,
    trial: int,
    played: PlayedSwing,
    frame_s: np.ndarray,
    points_m: np.ndarray,
) -> PastTrial:
    """Return what the planner takes of a motion that was played; `points_m` (F, n+1, 3) is its track."""
    motion_s = plan.motion.end_s
    until_s = motion_s + AFTER_END_S
    time_s = np.arange(round(until_s / plan_step_s(case)) + 1) * plan_step_s(case)
    seen = (frame_s >= 0.0) & (frame_s <= until_s) & np.isfinite(points_m[:, -1]).all(axis=1)
    found, _ = closest_approach(
        frame_s[seen], points_m[seen, -1], case.target_m, 1.0 / FRAME_RATE_HZ, (0.0, until_s)
    )
    return PastTrial(
        trial=trial,
        curve=plan.curve,
        q_command_rad=resampled(time_s, plan.motion.time_s, plan.motion.q_rad),
        q_rad=resampled(time_s, played.log_s, played.q_rad),
        frame_s=frame_s,
        tip_m=points_m[:, -1],
        start_m=start_shape(frame_s, points_m[:, 1:]),
        sway_rad_s=0.0,
        miss_m=None if found is None else found.distance_m,
    )


def plan_step_s(case: SpaceCase) -> float:
    """Return the time between a motion's points [s]."""
    return 1.0 / case.arm.log_rate_hz


def _track(swing: LabSwing, motion_s: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return times (F,) [s] since the motion's start, and the mass points (F, n+1, 3) [m] with noise."""
    time_s = np.arange(-FILMED_BEFORE_S, motion_s + FILMED_AFTER_S, 1.0 / FRAME_RATE_HZ)
    points_m = points_at(swing, np.linspace(0.0, swing.places_m[-1], POINTS + 1), time_s)
    noise = TrackerNoise()
    time_s = time_s + noise.offset_s * random.standard_normal()
    return time_s, with_tracker_noise(points_m, 1.0 / FRAME_RATE_HZ, noise, random)


def estimated(
    case: SpaceCase,
    thrown: list[SpaceTrial],
    before: StringFit | None,
    random: np.random.Generator,
    *,
    drag_along: bool,
) -> StringFit:
    """Fit the string to all throws."""
    model, space = space_of_cable(
        case.string.length_m,
        False,
        points=POINTS,
        step_s=ESTIMATE.dt_s,
        weight_places_m=case.weight_places_m,
        **given_of(ESTIMATE) | {"forces": {"rest_curl"} | ({"drag_along"} if drag_along else set())},
    )
    parts = parts_of_series([trial.series for trial in thrown], POINTS)
    previous = None if before is None else before.members
    return estimate({"": parts}, model, space, ESTIMATE, random, previous=previous, references=True)


def _outcome(
    plan: PlannedMotion, trial: SpaceTrial, fit: StringFit | None, cpu_s: tuple[float, float]
) -> SpaceOutcome:
    return SpaceOutcome(
        trial=trial.past.trial,
        kind=plan.kind,
        miss_m=trial.past.miss_m,
        true_miss_m=trial.true_miss_m,
        predicted_m=plan.miss_m,
        hit_probability=plan.hit_probability(HIT_RADIUS_M),
        simulated_hit_probability=plan.simulated_hit_probability(HIT_RADIUS_M),
        miss_rms_m=rms_of(plan.throws.miss_m),
        fit_E_m=None if fit is None else fit.E_m,
        tip_speed_m_s=plan.tip_speed_m_s,
        simulations=plan.simulations,
        flags=plan.flags,
        plan_cpu_s=cpu_s[0],
        estimate_cpu_s=cpu_s[1],
    )


def _job(seed: int, trials: int, **how: bool) -> dict[str, Any]:
    case = drawn_case(seed)
    drawn = {
        "seed": seed,
        "arm": case.arm.name,
        "servo": case.servo,
        "length_m": case.string.length_m,
        "linear_density_kg_m": case.string.linear_density_kg_m,
        "weights": len(case.string.weights),
        "target_m": case.target_m.tolist(),
    }
    run = drawn | outcome(partial(run_case, seed, trials, **how))
    run["unrehearsed"] = [trial for trial in run["trials"] if trial["trial"] == 0]
    run["trials"] = [trial for trial in run["trials"] if trial["trial"] > 0]
    return run


def main(arguments: list[str] | None = None) -> None:
    """Run the experiments; write each result as soon as it is known."""
    parser = run_parser(__doc__, list(REPORTED_SEEDS), "results/bench-space.json", strings=False)
    parser.add_argument("--one-drag", action="store_true", help="fit one drag for all directions")
    parser.add_argument("--rehearsed", action="store_true", help="play the first motion without string first")
    parser.add_argument("--every", action="store_true", help="throw all trials, also after a hit")
    options = parser.parse_args(arguments)
    job = partial(_job, drag_along=not options.one_drag, rehearsed=options.rehearsed, every=options.every)
    jobs = [(seed, options.trials) for seed in options.seeds]
    print(json.dumps(run_jobs(job, jobs, options.jobs, options.out), indent=1))


if __name__ == "__main__":
    main()
