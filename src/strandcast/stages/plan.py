"""The next motion: motion.json, made from the trials before it."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from strandcast.arm.load import Arm, Box, load_arm
from strandcast.arm.servo import Servo
from strandcast.errors import StrandcastError
from strandcast.experiment import Experiment, SegmentObjective, ShapeObjective, SwingObjective
from strandcast.motion.earlier import Earlier, earlier_trial
from strandcast.motion.objective import Objective
from strandcast.motion.objectives import Point, Segment, Shape, Swing
from strandcast.motion.plan import Plan, plan_first, plan_next
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, PaperReading, Task
from strandcast.motion.write import to_record
from strandcast.progress import tell
from strandcast.records.estimate import Estimate, ServoFit
from strandcast.records.files import sha256_file
from strandcast.seeds import rng, seed_of
from strandcast.stages.context import Context, context_of
from strandcast.stages.trials import Trial, read_members, read_trial, string_model
from strandcast.string.masses import MassLayout, point_masses
from strandcast.string.model import StringModel
from strandcast.string.parameters import PARAMETERS, StringDraw, ensemble, minima, random_strings

PAPER_DURATION_S = (0.2, 1.2)  # section V-A
FIRST_CURL_RAD_M = 3.0  # cords come off a reel: they may rest bent this much either way


def run(root: Path, name: str, trial: int) -> None:
    """Plan the motion of one trial."""
    context = context_of(root, name)
    arm = load_arm(context.arm_file)
    settings = context.settings
    began_s = time.monotonic()
    random = rng(name, settings.seed, trial, "plan")
    earlier = context.counted_before(trial)
    trials = [read_trial(context, number) for number in earlier]
    try:
        if trials:
            task, strings, options = known_after(context, arm, trials[-1].number)
            plan, start = _next(context, task, strings, options, trials, random), None
        else:
            task, strings, options = known_before(context, arm, random)
            plan, start = plan_first(task, strings, options, random), _start_name(settings)
    except StrandcastError as error:
        # What the planner cannot do is asked for in the experiment's file, unless it is the arm's.
        error.file = error.file or str(context.file)
        raise
    parent = next((t.motion for t in trials if t.number == plan.parent_trial), None)
    # How long it took is no part of the result, which is the same every time.
    tell(f"plan: {plan.simulations} throws simulated in {time.monotonic() - began_s:.1f} s")
    for flag in plan.flags:
        tell(f"plan: {flag}")
    to_record(
        plan,
        task,
        name,
        trial,
        seed_of(name, settings.seed, trial, "plan"),
        _read_files(context, earlier),
        None if parent is None else parent.content_sha256(),
        start,
    ).write(context.folder.trial(trial).results / "motion.json")


def known_before(context: Context, arm: Arm, random: np.random.Generator) -> tuple[Task, Strings, Options]:
    """Return what planning a first motion begins with: the task, what the string may be, the options."""
    model, layout = string_model(context, arm)
    settings = context.settings
    strings = _start_strings(settings, model.length_m, layout, random)
    return _task(settings, arm, model), strings, _options(settings)


def known_after(context: Context, arm: Arm, trial: int) -> tuple[Task, Strings, Options]:
    """Return what planning after a trial begins with: the task, the fitted strings, the options."""
    model, layout = string_model(context, arm)
    settings = context.settings
    fitted = context.folder.trial(trial).results / "ensemble.parquet"
    return _task(settings, arm, model), _fitted_strings(fitted, layout), _options(settings)


def _task(settings: Experiment, arm: Arm, model: StringModel) -> Task:
    target_m, box = np.array(settings.target_m), settings.workspace_m
    workspace = arm.workspace if box is None else Box(box.x_m, box.y_m)
    return Task(arm, model, target_m, settings.hit_radius_m, workspace, _objective(settings))


def _objective(settings: Experiment) -> Objective:
    told = settings.objective
    if isinstance(told, SegmentObjective):
        return Segment(told.ends_m)
    if isinstance(told, ShapeObjective):
        return Shape(tuple(p.along_m for p in told.places), tuple(p.at_m for p in told.places))
    if isinstance(told, SwingObjective):
        return Swing(told.height_m, told.speed_m_s)
    return Point(settings.target_m, told.direction_rad, told.tolerance_rad, told.least_speed_m_s)


def _options(settings: Experiment) -> Options:
    plan = settings.plan
    by_paper = plan.planner == "paper"
    return Options(
        planner=plan.planner,
        duration_s=plan.duration_s or (PAPER_DURATION_S if by_paper else Options.duration_s),
        free_heights=plan.control_points,
        screening=plan.screening,
        evaluations=plan.evaluations,
        members=plan.ensemble,
        use_servo=not by_paper if plan.use_servo is None else plan.use_servo,
        paper=PaperReading(**plan.paper.model_dump()),
        disturbances=plan.disturbances,
        carry_residual=plan.carry_residual,
        finer=plan.finer,
    )


def _start_name(settings: Experiment) -> str:
    return settings.start_string if isinstance(settings.start_string, str) else "given"


def _start_strings(
    settings: Experiment, length_m: float, layout: MassLayout, random: np.random.Generator
) -> Strings:
    """Return the strings that the first motion is planned with."""
    start, string = settings.start_string, settings.string
    if start == "ensemble":
        count = settings.plan.ensemble
        weights = layout.count - layout.stiff
        draw = ensemble(count, length_m, string.n, weights, random, layout.stiff)
        curl = random.uniform(-FIRST_CURL_RAD_M, FIRST_CURL_RAD_M, count)
        return Strings(draw.parameters, point_masses(layout, draw.weight_masses), curl)
    if start == "random":
        draw = random_strings(1, layout.count, random)
    elif isinstance(start, dict):
        given = [
            start.get(name, least) for name, least in zip(PARAMETERS, minima().parameters[0], strict=True)
        ]
        draw = StringDraw(np.array([given]), minima(layout.count).weight_masses)
    else:
        draw = minima(layout.count)
    return Strings(draw.parameters, point_masses(layout, draw.weight_masses))


def _next(
    context: Context,
    task: Task,
    strings: Strings,
    options: Options,
    trials: list[Trial],
    random: np.random.Generator,
) -> Plan:
    newest = Estimate.read(context.folder.trial(trials[-1].number).results / "estimate.json")
    earlier = [earlier_of(trial, task.step_s) for trial in trials if trial.motion is not None]
    return plan_next(task, strings, earlier, options, random, _servo(newest.servo), newest.E_m)


def _fitted_strings(path: Path, layout: MassLayout) -> Strings:
    fitted = read_members(path, layout)
    factor = np.ones_like(fitted.masses) if fitted.bend_factor is None else fitted.bend_factor
    return Strings(
        fitted.parameters,
        fitted.masses,
        fitted.rest_curl_rad_m,
        fitted.clamp_offset_rad,
        bend_friction=fitted.bend_friction,
        bend_factor=factor,
    )


def earlier_of(trial: Trial, step_s: float) -> Earlier:
    """Return what a trial taught, on its motion's own clock, every `step_s`."""
    motion, log, start_s = trial.motion, trial.log, trial.alignment.motion_start_s
    assert motion is not None
    if log is None:  # a supplied track: the joints are taken to have done as they were told
        time_s, q_rad = motion.time_s(), motion.joints()[0]
    else:
        columns = [log.joint_names.index(name) for name in motion.joint_names]
        time_s, q_rad = log.time_s - start_s, log.q_rad[:, columns]
    return earlier_trial(
        motion,
        time_s,
        q_rad,
        trial.frame_time_s - start_s,
        trial.track.seen_m(),
        trial.verdict.miss_m,
        step_s,
    )


def _servo(fit: ServoFit | None) -> Servo | None:
    if fit is None:
        return None
    numbers = (fit.delay_s, fit.natural_frequency_rad_s, fit.damping_ratio, fit.gain)
    return Servo(*(np.array(values) for values in numbers))


def _read_files(context: Context, numbers: list[int]) -> dict[str, str]:
    """Return the hashes of the files that the motion was made from, by their place in the results."""
    if not numbers:
        return {}
    files = [(number, "verdict.json") for number in numbers]
    files += [(numbers[-1], "estimate.json"), (numbers[-1], "ensemble.parquet")]
    paths = [(context.folder.trial(number).results / file) for number, file in files]
    return {f"{path.parent.name}/{path.name}": sha256_file(path) for path in paths}
