"""The next motion, made from the trials before it, and the throws that are expected of it."""

import time
from collections.abc import Iterator

import numpy as np

from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError
from strandcast.planning.describe import PlannedMotion
from strandcast.planning.plan import SEARCHES, plan_first, plan_next
from strandcast.planning.start_strings import start_string_name
from strandcast.planning.task import PlanningTask
from strandcast.planning.write import to_record
from strandcast.progress import print_line
from strandcast.records.content_hash import result_sha256
from strandcast.records.estimate import Estimate
from strandcast.records.kept_motions import keep_motion
from strandcast.records.motion import Motion
from strandcast.records.predicted import PredictedThrows, write_predicted
from strandcast.report.expected import expected_miss
from strandcast.seeds import rng, seed_of
from strandcast.stages.arms import arm_of
from strandcast.stages.context import Context, about_settings
from strandcast.stages.files import past
from strandcast.stages.job import Files, Job
from strandcast.stages.past_trials import Trial, hashes_of, read_trial
from strandcast.stages.plan_inputs import (
    first_inputs,
    known_inputs,
    next_inputs,
    past_trial_of,
    refuse_without_target,
    rehearsal_of,
)
from strandcast.stages.producers import play_command


def run(job: Job, files: Files) -> None:
    """Plan the motion of one trial.

    Raises
    ------
    StrandcastError
        SC-X010 a real arm has thrown this trial; SC-R032 a folder's name leaves open which trial it holds.
    """
    _refuse_thrown(job)
    began_s = time.monotonic()
    motion, throws = plan_motion(job, files)
    assert motion.provenance is not None
    # How long it took is not part of the result, which is the same every time.
    taken_s = time.monotonic() - began_s
    print_line(f"plan: {motion.provenance.simulations} throws simulated in {taken_s:.1f} s")
    for line in (*motion.provenance.flags, *_answer(job, files, motion)):
        print_line(f"plan: {line}")
    write_predicted(files.output("predicted"), throws)
    motion.write(files.output("motion"))
    if not job.is_lab:  # the lab has played it before another can be planned
        keep_motion(job.context.folder, motion, files.output("predicted"))


def _answer(job: Job, files: Files, motion: Motion) -> Iterator[str]:
    """Yield what is expected of a motion, what limits it, and on a real arm how to throw it."""
    assert motion.predicted is not None
    within = f"within {1000 * job.context.settings.hit_radius_m:.0f} mm of the target"
    yield f"predicted miss {expected_miss(motion)}, {within}"
    most = max(motion.limits_used(), key=lambda used: used[2], default=None)
    if most is not None:
        kind, who, share = most
        yield f"nearest to a limit of {kind}: {who}, {100 * share:.0f} % used"
    if job.is_lab:
        return
    if past(job):  # their pages may name a fault, which is to be corrected before
        yield f"what to do next: strandcast status {job.context.name}"
    else:
        yield f"throw it: {play_command(job.context, job.trial)}"


def first_motion(context: Context, arm: Arm, searches: int = SEARCHES) -> Motion:
    """Return the first motion as it is planned before anything was played."""
    seeded_by = _seeded_by(context, 1)
    random = rng(*seeded_by)
    task, strings = first_inputs(context, arm, random)
    with about_settings(context):
        settings = context.settings
        plan = plan_first(task, strings, settings.plan, random, method=settings.method, searches=searches)
    start = start_string_name(context.settings)
    return to_record(plan, task, context.name, 1, seed_of(*seeded_by), {}, None, start)


def plan_motion(job: Job, files: Files) -> tuple[Motion, PredictedThrows]:
    """Return the planned motion of one trial, and the throws that are expected of it."""
    refuse_without_target(job.context)
    context, arm = job.context, arm_of(job.context)
    settings, seeded_by = context.settings, _seeded_by(context, job.trial)
    random = rng(*seeded_by)
    trials = [read_trial(files, number) for number in past(job)]
    with about_settings(context):
        task, plan = _next(files, arm, trials, random) if trials else _first(files, arm, random)
    elsewhere = files.inputs("known_string")
    parent = next((t.motion for t in trials if t.number == plan.parent_trial), None)
    motion = to_record(
        plan,
        task,
        context.name,
        job.trial,
        seed_of(*seeded_by),
        hashes_of(
            path for role in ("track", "estimate", "ensemble", "rehearsal_run") for path in files.inputs(role)
        )
        | {path.relative_to(context.folder.root).as_posix(): result_sha256(path) for path in elsewhere},
        None if parent is None else parent.content_sha256(),
        None if trials else start_string_name(settings),
    )
    return motion, plan.throws._replace(motion_sha256=motion.content_sha256())


def _seeded_by(context: Context, trial: int) -> tuple[str, int, int, str]:
    return context.name, context.settings.seed, trial, "plan"


def _refuse_thrown(job: Job) -> None:
    """Refuse to replace the motion of a throw of a real arm; the lab throws a new motion again."""
    if job.is_lab:
        return
    job.context.folder.recorded_trials()  # a misnamed folder may hold this trial
    if job.folder.raw_files():
        following = max(job.context.folder.thrown_trials()) + 1
        raise StrandcastError(
            "SC-X010",
            f"trial {job.trial} was thrown: its raw files are there, and its motion is not planned again",
            file=job.folder.data,
            cost="the fit would be made for another motion than the one that was thrown",
            fix=f"plan the next one: strandcast plan {job.context.name} {following}; "
            "if nothing was thrown, move the folder away",
        )


Plan = tuple[PlanningTask, PlannedMotion]


def _first(files: Files, arm: Arm, random: np.random.Generator) -> Plan:
    """Plan for an ensemble of plausible strings, or for one that was thrown in another experiment.

    What a rehearsal shows of the joints is used.
    """
    context = files.job.context
    settings, method = context.settings.plan, context.settings.method
    known = bool(files.inputs("known_string"))
    task, strings = known_inputs(files, arm, random) if known else first_inputs(context, arm, random)
    rehearsal = rehearsal_of(files, task)
    plan = plan_first(task, strings, settings, random, rehearsal, method)
    return task, plan


def _next(files: Files, arm: Arm, trials: list[Trial], random: np.random.Generator) -> Plan:
    """Plan with the strings fitted after the newest trial, and with all trials that were played."""
    context, settings = files.job.context, files.job.context.settings
    task, strings = next_inputs(context, arm, files.input("ensemble"))
    estimate = Estimate.read(files.input("estimate"))
    played = [past_trial_of(trial, task) for trial in trials if trial.motion is not None]
    return task, plan_next(task, strings, played, settings.plan, random, estimate.E_m, settings.method)
