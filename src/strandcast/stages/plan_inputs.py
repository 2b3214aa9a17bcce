"""Inputs of the planner: the task, the strings, the past trials."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy

from strandcast.arm.load import Arm
from strandcast.arm.servo import Servo
from strandcast.config.experiment import Experiment
from strandcast.core.interpolation import resampled
from strandcast.core.strings import FAR_OFFSET, PARAMETERS, StringBatch
from strandcast.dynamics.model import StringModel
from strandcast.errors import StrandcastError
from strandcast.planning.past_trials import PastTrial, past_trial
from strandcast.planning.scenarios import STRINGS
from strandcast.planning.start_strings import (
    in_another_clamp,
    rescaled,
    start_strings,
    start_strings_in_space,
)
from strandcast.planning.task import PlanningTask
from strandcast.records.estimate import Estimate, ServoFit
from strandcast.records.joint_log import read_run
from strandcast.records.motion import Motion
from strandcast.stages.context import Context
from strandcast.stages.job import Files
from strandcast.stages.past_trials import Trial, read_members, smooth_joints, string_model

# Of a rehearsal's log during the motion: fewer rows do not show how joints follow; soft joints stay within
# some tenths of a radian of the motion, those in degrees or of another order do not. Chosen.
FEWEST_ROWS, MISSING_S, FARTHEST_RAD = 20, 0.02, 0.5
MOVED_M = 0.01  # between two declarations of a weight, from the end of the same string (chosen)
FEWEST_PLACES = 4  # of a shape, the hand's included; chosen: through fewer, the model's own is as good


def first_inputs(context: Context, arm: Arm, random: np.random.Generator) -> tuple[PlanningTask, StringBatch]:
    """Return the task and plausible strings, for the first motion."""
    model, layout = string_model(context, arm)
    settings = context.settings
    if arm.axes == 3:
        strings = start_strings_in_space(STRINGS, model.length_m, layout, random)
    else:
        strings = start_strings(settings, model.length_m, layout, random)
    return _task(settings, arm, model), strings


def known_inputs(files: Files, arm: Arm, random: np.random.Generator) -> tuple[PlanningTask, StringBatch]:
    """Return the task and the strings fitted in another experiment, for the first motion.

    With the same free length as there, the string is taken to be in its clamp still.

    Raises
    ------
    StrandcastError
        SC-F003 it is a string in the other of plane and space, held at both ends, fitted as the paper does,
        or with other weights or stiff sections.
    """
    context = files.job.context
    estimate_file, ensemble_file = files.inputs("known_string")
    estimate, (model, layout) = Estimate.read(estimate_file), string_model(context, arm)
    strings = read_members(ensemble_file, layout) if len(estimate.weights) == layout.count else None
    fitted_m, spacing_m = estimate.length_m, estimate.length_m / estimate.points
    same_length = bool(np.isclose(fitted_m, model.length_m))
    kinds = ["weight"] * (layout.count - layout.stiff) + ["stiff"] * layout.stiff
    moved_m = [
        abs(fitted_m - one.place_m - (model.length_m - place_m)) if one.kind == kind else np.inf
        for one, kind, place_m in zip(estimate.weights, kinds, layout.places_m, strict=False)
    ]
    wrong = {
        "was fitted as the paper does": estimate.search == "paper",
        "has other weights or stiff sections, by their places from its end": strings is None
        or max(moved_m, default=0.0) > MOVED_M
        or (layout.stiff > 0 and not np.isclose(spacing_m, model.spacing_m)),
    }
    if strings is not None:
        other = estimate.reading != model.reading or strings.in_space != (arm.axes == 3)
        wrong["is of the other of plane and space, or held at both ends"] = (
            other or strings.sides(FAR_OFFSET).any()
        )
    if strings is None or any(wrong.values()):
        fix = "name an estimate of this string, or leave start_string out"
        what = f"the string of {estimate_file} {next(words for words, holds in wrong.items() if holds)}"
        raise StrandcastError("SC-F003", what, file=context.file, field="start_string", fix=fix)
    same_clamp = same_length and bool(strings.parameters[:, PARAMETERS.index("k_ph")].all())
    strings = rescaled(strings, (fitted_m, spacing_m), model.length_m, layout)
    if not same_clamp:
        strings = in_another_clamp(strings, random)
    return _task(context.settings, arm, model), strings.thrown().first(STRINGS)


def task_of(context: Context, arm: Arm) -> PlanningTask:
    """Return the task alone, to check whether its target can be reached."""
    return _task(context.settings, arm, string_model(context, arm)[0])


def next_inputs(context: Context, arm: Arm, ensemble: Path) -> tuple[PlanningTask, StringBatch]:
    """Return the task and the strings fitted to past trials, for a later motion."""
    model, layout = string_model(context, arm)
    # Without the unknowns that only concern the measurement or the fit.
    return _task(context.settings, arm, model), read_members(ensemble, layout).thrown()


def _task(settings: Experiment, arm: Arm, model: StringModel) -> PlanningTask:
    # Without a target, motions are simulated but not planned: see `refuse_without_target`.
    target_m = np.full(arm.axes, np.nan) if settings.target_m is None else np.array(settings.target_m)
    return PlanningTask(
        arm,
        model,
        target_m,
        settings.hit_radius_m,
        settings.workspace_m,
        settings.objective,
    )


def refuse_without_target(context: Context) -> None:
    """Refuse to plan for an experiment without a target.

    Raises
    ------
    StrandcastError
        SC-F014 the experiment has none.
    """
    if context.settings.target_m is None:
        raise StrandcastError(
            "SC-F014",
            "the experiment has no target, so that no motion can be planned",
            file=context.file,
            field="target_m",
            fix="add target_m: [x, y], or [x, y, z] for an arm in space; to fit a recording, import it: "
            "strandcast import track --help",
        )


def past_trial_of(trial: Trial, task: PlanningTask) -> PastTrial:
    """Return a trial on its motion's own clock, joints as often as the task's."""
    motion = trial.motion
    assert motion is not None
    if (played := tuple(motion.joint_names)) != task.arm.joints:
        what = f"trial {trial.number} moved {', '.join(played)}, and the arm's are "
        fix = "begin an experiment for the other joints, or exclude the trials before"
        raise StrandcastError(
            "SC-X004", what + ", ".join(task.arm.joints), file=task.arm.path, field="throw.joints", fix=fix
        )
    log, start_s = trial.log, trial.alignment.motion_start_s
    if log is None:  # a supplied track: the joints are taken to have followed the commands
        joints = motion.trajectory().time_s, motion.trajectory().q_rad
    else:
        joints = smooth_joints(log, played, (start_s, trial.alignment.motion_end_s), start_s)
    nearest = trial.shortfall(task.hit_radius_m)
    points = trial.frame_time_s - start_s, trial.track.detected_m()
    past = past_trial(motion, task.step_s, joints, points, nearest and nearest.miss_m, logged=log is not None)
    if not np.array_equal(motion.target_m, task.target_m):  # the miss is to another target
        past = replace(past, stated_m=None)
    if not task.in_space:
        return past
    # The track has markers, wherever they are on the string.
    length_m = task.model.length_m
    places = trial.summary.places_m(length_m) / length_m
    hand_m = task.arm.hand_m(past.q_rad[0])
    return replace(past, start_m=shape_through(hand_m, past.start_m, places, task.model.points))


def shape_through(
    hand_m: np.ndarray, markers_m: np.ndarray | None, places: np.ndarray, points: int
) -> np.ndarray | None:
    """Return mass points (n, 3) on a spline through hand (3,) and markers (m, 3); None through too few."""
    if markers_m is None or len(places) < FEWEST_PLACES:
        return None
    spline = scipy.interpolate.CubicSpline(places, np.vstack([hand_m, markers_m]))
    return np.asarray(spline(np.linspace(0.0, 1.0, points + 1)[1:]))


def rehearsal_of(files: Files, task: PlanningTask) -> PastTrial | None:
    """Return the motion that the arm played without the string, if it did.

    Raises
    ------
    StrandcastError
        SC-P021 the log is that of another motion, arm or target, or not whole.
    """
    record = files.optional("rehearsal_run")
    if record is None:
        folder = files.job.context.folder.rehearsal
        if not files.job.is_lab and (folder / "joints.csv").is_file():
            raise _no_rehearsal(folder / "run.json", "is missing beside joints.csv")
        return None
    run, log = read_run(record.parent)
    arm, motion = task.arm, Motion.read(files.input("rehearsal_motion"))
    if run.motion_sha256 != motion.content_sha256() or run.motion_start_s is None:
        raise _no_rehearsal(record, "the log is not that of the motion beside it")
    if tuple(motion.joint_names) != tuple(arm.joints) or not set(arm.joints) <= set(log.joint_names):
        raise _no_rehearsal(record, f"its joints are not those of the arm: {', '.join(arm.joints)}")
    _refuse_rehearsal_for_another(record.with_name("motion.json"), motion, task)
    planned, start_s = motion.trajectory(), run.motion_start_s
    since_s = np.unique(log.time_s - start_s)
    rows = ((since_s >= 0.0) & (since_s <= planned.end_s)).sum()
    if rows < FEWEST_ROWS or since_s[0] > MISSING_S or since_s[-1] < planned.end_s - MISSING_S:
        span = f"{rows} rows from {since_s[0]:.2f} to {since_s[-1]:.2f} s"
        raise _no_rehearsal(record, f"the log has {span} of a motion from 0 to {planned.end_s:.2f} s")
    time_s, q_rad = smooth_joints(log, arm.joints, (start_s, start_s + planned.end_s), start_s)
    during = (time_s >= 0.0) & (time_s <= planned.end_s)
    off_rad = q_rad[during] - resampled(time_s[during], planned.time_s, planned.q_rad)
    rms_rad = float(np.sqrt(np.mean(off_rad**2)))
    if rms_rad > FARTHEST_RAD:
        raise _no_rehearsal(record, f"the logged joints are {rms_rad:.1f} rad rms from the motion beside it")
    nothing_seen = np.zeros(0), np.zeros((0, 2, arm.axes))
    return past_trial(motion, task.step_s, (time_s, q_rad), nothing_seen)


def _refuse_rehearsal_for_another(file: Path, motion: Motion, task: PlanningTask) -> None:
    """Refuse a motion for another target, beyond the hit radius, or for another arm."""
    fix = "move the folder away, plan, and rehearse the new motion if you like"
    if motion.robot.name != task.arm.name:
        what = f"was planned for {motion.robot.name}, and the arm is {task.arm.name}"
        raise _no_rehearsal(file, what, "robot", fix)
    if motion.robot.urdf_sha256 != task.arm.urdf_sha256:
        what = f"was planned for {task.arm.name} with another URDF than {task.arm.urdf_path.name}"
        raise _no_rehearsal(file, what, "robot", fix)
    its_m, target_m = np.array(motion.target_m), task.target_m
    if its_m.shape != target_m.shape or np.linalg.norm(its_m - target_m) > task.hit_radius_m:
        what = f"was planned for the target {motion.target_m}, and the experiment's is {target_m.tolist()}"
        raise _no_rehearsal(file, what, "target_m", fix)


def _no_rehearsal(file: Path, what: str, field: str | None = None, fix: str | None = None) -> StrandcastError:
    cost = "the planner would compensate an error that the joints do not have"
    return StrandcastError("SC-P021", what, file=file, field=field, cost=cost, fix=fix)


def servo_of(fit: ServoFit | None) -> Servo | None:
    """Return the fitted response of the joints, if there is one."""
    if fit is None:
        return None
    numbers = (fit.delay_s, fit.natural_frequency_rad_s, fit.damping_ratio, fit.gain)
    return Servo(*(np.array(values) for values in numbers))
