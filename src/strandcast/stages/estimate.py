"""The string that explains the newest trials: estimate.json, ensemble.parquet, simulated.parquet."""

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import StringBatch
from strandcast.dynamics.masses import MassLayout
from strandcast.errors import StrandcastError
from strandcast.estimation.estimate import estimate
from strandcast.estimation.measured import Throw
from strandcast.records.estimate import ENSEMBLE, SIMULATED
from strandcast.records.motion import Motion
from strandcast.records.tables import read_arrow, write_table
from strandcast.records.track import TRACK, UNSURE, TrackSummary, is_in_space
from strandcast.records.verdict import AFTER_MOTION_S
from strandcast.seeds import rng
from strandcast.stages.estimate_in_space import estimate_in_space
from strandcast.stages.estimate_record import ensemble_table, estimate_record, servo_record, simulated_table
from strandcast.stages.files import past, recent
from strandcast.stages.job import Files, Job
from strandcast.stages.past_trials import (
    Trial,
    hashes_of,
    read_members,
    read_trial,
    servo_of,
    string_model,
)
from strandcast.stages.rig_offsets import rig_offsets_of
from strandcast.stages.seen_weights import seen_weights

# All chosen.
DOUBT_M = 0.003  # standard deviation of a point at which its weight in E halves
UNSURE_WEIGHT = 0.25  # of points that the tracker flags as unsure
SAME_PASS_S = 0.1  # a planned hit and a closest approach this near belong to the same pass of the tip


def run(job: Job, files: Files) -> None:
    """Estimate the string after one trial: from the recent ones, starting from the estimate before."""
    context, settings = job.context, job.context.settings.estimate
    if job.trial in context.settings.held_out:
        raise StrandcastError(
            "SC-E009",
            f"trial {job.trial} is held out: it is never fitted",
            file=context.file,
            field="held_out",
            fix=f"predict it: strandcast predict {context.name} {job.trial} --from ESTIMATE.json",
        )
    if is_in_space(read_arrow(files.input("track", job.trial), TRACK).column_names):
        estimate_in_space(job, files)
        return
    if settings.marker_shift:
        raise StrandcastError(
            "SC-E008",
            "estimate.marker_shift does not apply to a string in the plane",
            file=context.file,
            field="estimate.marker_shift",
        )
    arm = load_arm(files.input("arm")).planar()
    model, layout = string_model(context, arm)
    trials = [read_trial(files, number) for number in recent(job)]
    if not np.isfinite(trials[-1].track.points_m[:, 1:]).any():
        raise StrandcastError(
            "SC-T004",
            "no point of the string is in the track",
            file=files.input("track", job.trial),
            fix=f"check the track's report; exclude trial {job.trial} with a reason",
        )
    before = past(job)
    previous = read_members(files.input("previous"), layout) if before else None
    throws = [throw_of(t, settings) for t in trials]
    random = rng(context.name, context.settings.seed, job.trial, "estimate")
    fit = estimate(
        throws,
        model,
        layout,
        settings,
        random,
        planned=_planned(trials[-1].motion, layout),
        previous=previous,
        older=len(before) + 1 - len(trials),
        references=context.settings.target_m is None,
    )
    response = servo_of(arm, trials)
    servo = None if response is None else servo_record(arm, response)
    read = [files.input(role, t.number) for t in trials for role in ("track", "alignment", "hand", "summary")]
    record = estimate_record(context, model, layout, [t.number for t in trials], fit, servo, hashes_of(read))
    seen = TrackSummary.read(files.input("summary", job.trial)).weights
    weights = seen_weights(context, arm, throws, fit.E_m, seen, random)
    record.faults = weights.faults
    record.warnings += [*(fault.words for fault in weights.faults), *weights.warnings]
    record.rig_offsets = rig_offsets_of(arm, trials, files.inputs("cameras"), record)
    record.warnings += [] if record.rig_offsets is None else record.rig_offsets.warnings
    write_table(files.output("ensemble"), ENSEMBLE, ensemble_table(fit.members, fit.member_values_m))
    write_table(files.output("simulated"), SIMULATED, simulated_table(fit, trials[-1]))
    record.write(files.output("estimate"))


def throw_of(trial: Trial, settings: EstimateSettings) -> Throw:
    """Return a trial as input of the estimation: the measured points, weighted by their certainty."""
    track = trial.track
    confidence = 1.0 / (1.0 + (np.nan_to_num(track.sigma_m) / DOUBT_M) ** 2)
    confidence = np.where((track.flags & UNSURE) > 0, UNSURE_WEIGHT * confidence, confidence)
    used = trial.frame_time_s <= _until_s(trial, settings)
    return Throw(trial.frame_time_s, track.detected_m(), trial.hand_time_s, trial.hand_pose, used, confidence)


def _until_s(trial: Trial, settings: EstimateSettings) -> float:
    """Return the robot time of the last frame that enters E.

    Without a target, all frames of the motion do. A touch ends the free motion. After a miss, the closest
    approach may belong to another pass of the tip than the planned one; the fit then uses the planned pass.
    """
    reach_m = settings.contact_radius_m
    nearest, expected_s = trial.shortfall(reach_m or 0.0), _expected_s(trial)
    if nearest is not None and reach_m is not None and nearest.miss_m <= reach_m:
        return nearest.time_s
    closest_s = None if nearest is None else nearest.time_s
    known_s = [s for s in (closest_s, expected_s) if s is not None]
    if settings.horizon_s is None or not known_s or trial.aim is None:
        return trial.alignment.motion_end_s + AFTER_MOTION_S
    if len(known_s) == 2 and abs(known_s[0] - known_s[1]) > SAME_PASS_S:
        return known_s[1] + settings.horizon_s
    return max(known_s) + settings.horizon_s


def _expected_s(trial: Trial) -> float | None:
    """Return the robot time at which the motion was planned to hit."""
    if trial.motion is None or trial.motion.predicted is None:
        return None
    return trial.alignment.motion_start_s + trial.motion.predicted.hit_time_s


def _planned(motion: Motion | None, layout: MassLayout) -> StringBatch | None:
    """Return the string with which the motion was planned; None if it was not planned here."""
    if motion is None or motion.provenance is None:
        return None
    return motion.provenance.string.strings(layout.stiff_joints())
