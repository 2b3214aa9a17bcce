"""Inputs of the planner: the task, the strings, the past trials."""

from pathlib import Path

import numpy as np

from strandcast.alignment.joints import without_row_noise
from strandcast.arm.load import Arm
from strandcast.arm.servo import Servo
from strandcast.config.experiment import Experiment
from strandcast.core.strings import StringBatch
from strandcast.dynamics.masses import MassLayout
from strandcast.dynamics.model import StringModel
from strandcast.errors import StrandcastError
from strandcast.planning.deviations import trial_deviations
from strandcast.planning.past_trials import Measured, PastTrial, past_trial
from strandcast.planning.rig_scatter import TrialDeviations
from strandcast.planning.start_strings import start_strings
from strandcast.planning.task import PlanningTask
from strandcast.records.estimate import ServoFit
from strandcast.records.joint_log import read_run
from strandcast.records.motion import Motion
from strandcast.stages.context import Context
from strandcast.stages.job import Files
from strandcast.stages.past_trials import Trial, read_members, string_model


def first_inputs(context: Context, arm: Arm, random: np.random.Generator) -> tuple[PlanningTask, StringBatch]:
    """Return the task and plausible strings, for the first motion."""
    model, layout = string_model(context, arm)
    strings = start_strings(context.settings, model.length_m, layout, random)
    return _task(context.settings, arm, model), strings


def task_of(context: Context, arm: Arm) -> PlanningTask:
    """Return the task alone, to check whether its target can be reached."""
    return _task(context.settings, arm, string_model(context, arm)[0])


def next_inputs(context: Context, arm: Arm, ensemble: Path) -> tuple[PlanningTask, StringBatch]:
    """Return the task and the strings fitted to past trials, for a later motion."""
    model, layout = string_model(context, arm)
    return _task(context.settings, arm, model), fitted_strings(ensemble, layout)


def _task(settings: Experiment, arm: Arm, model: StringModel) -> PlanningTask:
    # Without a target, motions are simulated but not planned: see `refuse_without_target`.
    return PlanningTask(
        arm,
        model,
        np.full(2, np.nan) if settings.target_m is None else np.array(settings.target_m),
        settings.hit_radius_m,
        arm.workspace if settings.workspace_m is None else settings.workspace_m,
        settings.objective,
    )


def refuse_without_target(context: Context) -> None:
    """Refuse to plan for an experiment without a target.

    Raises
    ------
    StrandcastError
        SC-F013 the experiment has none.
    """
    if context.settings.target_m is None:
        raise StrandcastError(
            "SC-F013",
            "the experiment has no target, so that no motion can be planned",
            file=context.file,
            field="target_m",
            fix="add target_m: [x, y]; to fit a recording, import it: strandcast import track --help",
        )


def fitted_strings(path: Path, layout: MassLayout) -> StringBatch:
    """Read the fitted strings, without the unknowns that only concern the measurement or the fit."""
    fitted = read_members(path, layout)
    return StringBatch(
        fitted.parameters,
        fitted.masses,
        fitted.rest_curl_rad_m,
        fitted.clamp_offset_rad,
        fitted.bend_factor,
        fitted.bend_friction,
        fitted.drag_along,
        fitted.friction_stick_rad_m,
    )


def past_trial_of(trial: Trial, step_s: float) -> PastTrial:
    """Return a trial on its motion's own clock, joints every `step_s`."""
    assert trial.motion is not None
    return past_trial(trial.motion, measured_of(trial), step_s)


def rehearsal_of(files: Files, arm: Arm, step_s: float) -> PastTrial | None:
    """Return the motion that the arm played without the string, if it did.

    Raises
    ------
    StrandcastError
        SC-P021 the log is that of another motion or arm.
    """
    record = files.optional("rehearsal_run")
    if record is None:
        return None
    run, log = read_run(record.parent)
    motion = Motion.read(files.input("rehearsal_motion"))
    if run.motion_sha256 != motion.content_sha256() or run.motion_start_s is None:
        raise _no_rehearsal(record, "the log is not that of the motion beside it")
    if tuple(motion.joint_names) != tuple(arm.joints) or not set(arm.joints) <= set(log.joint_names):
        raise _no_rehearsal(record, f"its joints are not those of the arm: {', '.join(arm.joints)}")
    columns = [log.joint_names.index(name) for name in arm.joints]
    time_s, rows = np.unique(log.time_s - run.motion_start_s, return_index=True)
    # The rows' noise would shake the simulated strings, and no track shows what it does to them.
    q_rad = without_row_noise(time_s, log.q_rad[rows][:, columns])
    nothing_seen = np.zeros((0, 2, 2))
    return past_trial(motion, Measured(time_s, q_rad, np.zeros(0), nothing_seen, None), step_s)


def _no_rehearsal(record: Path, what: str) -> StrandcastError:
    return StrandcastError(
        "SC-P021",
        what,
        file=record,
        cost="the planner would compensate an error that the joints do not have",
        fix="play the planned motion again into this folder, or move the folder away",
    )


def measured_of(trial: Trial) -> Measured:
    """Return the measurements of a trial since its motion's start."""
    motion, log, start_s = trial.motion, trial.log, trial.alignment.motion_start_s
    assert motion is not None
    if log is None:  # a supplied track: the joints are taken to have followed the commands
        time_s, q_rad = motion.trajectory().time_s, motion.trajectory().q_rad
    else:
        columns = [log.joint_names.index(name) for name in motion.joint_names]
        time_s, rows = np.unique(log.time_s - start_s, return_index=True)
        q_rad = without_row_noise(time_s, log.q_rad[rows][:, columns])
    miss_m = None if trial.shortfall is None else trial.shortfall.miss_m
    return Measured(time_s, q_rad, trial.frame_time_s - start_s, trial.track.detected_m(), miss_m)


def _deviations_of(
    task: PlanningTask, best: StringBatch, trial: Trial, servo: Servo | None
) -> TrialDeviations:
    length_m, error_m = (trial.summary.choices.get(name) for name in ("length_m", "length_sigma_m"))
    known = (length_m, error_m) if isinstance(length_m, float) and isinstance(error_m, float) else None
    past = past_trial_of(trial, task.step_s)
    return trial_deviations(task, best, past, measured_of(trial), servo if trial.log else None, known)


def seen_deviations(
    task: PlanningTask, strings: StringBatch, trials: list[Trial], servo: Servo | None
) -> list[TrialDeviations]:
    """Return what the trials that were played from a motion show of the rig; the best string comes first."""
    played = [trial for trial in trials if trial.motion is not None]
    return [_deviations_of(task, strings.first(1), trial, servo) for trial in played]


def servo_of(fit: ServoFit | None) -> Servo | None:
    """Return the fitted response of the joints, if there is one."""
    if fit is None:
        return None
    numbers = (fit.delay_s, fit.natural_frequency_rad_s, fit.damping_ratio, fit.gain)
    return Servo(*(np.array(values) for values in numbers))
