"""The string that explains the newest trials: estimate.json, ensemble.parquet, simulated.parquet."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import StringBatch
from strandcast.dynamics.masses import MassLayout
from strandcast.dynamics.model import StringModel
from strandcast.errors import StrandcastError
from strandcast.estimation.estimate import estimate
from strandcast.estimation.measured import Throw, parts_of_throws
from strandcast.estimation.space import Space
from strandcast.estimation.throws import TrialParts
from strandcast.estimation.unknowns import forces_of, space_of
from strandcast.records.estimate import ENSEMBLE, SIMULATED, Estimate
from strandcast.records.motion import Motion
from strandcast.records.tables import read_arrow, read_facts, write_table
from strandcast.records.track import TRACK, UNSURE, TrackSummary, is_in_space
from strandcast.seeds import rng
from strandcast.stages.context import refuse_settings_of_others
from strandcast.stages.estimate_record import ensemble_table, estimate_record, points_table, servo_record
from strandcast.stages.files import past, recent
from strandcast.stages.job import Files, Job
from strandcast.stages.past_trials import (
    Trial,
    hashes_of,
    read_members,
    read_trial,
    servo_of,
    spatial_settings,
    string_model,
    until_s,
)
from strandcast.stages.rig_offsets import rig_offsets_of
from strandcast.stages.seen_weights import seen_weights
from strandcast.stages.trials_in_space import (
    cable_of_trials,
    fitted_parts,
    parts_in_space,
    read_trial_in_space,
)

# All chosen.
DOUBT_M = 0.003  # standard deviation of a point at which its weight in E halves
UNSURE_WEIGHT = 0.25  # of points that the tracker flags as unsure
CAPTURE_SEARCHES = 3  # independent ones of a capture, with parameters that are read; a throw is thrown again
SOURCES = ("planned", "fitted", "predicted", "string", "predicted_string")  # of simulated points


# The first arguments of `estimate`, and those that have names.
Fitted = tuple[Mapping[str, TrialParts], StringModel, Space, EstimateSettings, dict[str, Any]]


def run(job: Job, files: Files) -> None:
    """Estimate the string after one trial: from the recent ones, starting from the estimate before."""
    context = job.context
    if job.trial in context.settings.held_out:
        raise StrandcastError(
            "SC-E009",
            f"trial {job.trial} is held out: it is never fitted",
            file=context.file,
            field="held_out",
            fix=f"predict it: strandcast predict {context.name} {job.trial} --from ESTIMATE.json",
        )
    numbers, before = recent(job), past(job)
    trials, (parts, model, space, settings, known) = what_is_fitted(files)
    in_space = not space.in_plane
    layout, previous = space.layout, files.input("previous") if before else None
    random = rng(context.name, context.settings.seed, job.trial, "estimate")
    fit = estimate(
        parts,
        model,
        space,
        settings,
        random,
        previous=None if previous is None else read_members(previous, layout),
        previous_roll="" if previous is None else str(read_facts(previous, ENSEMBLE).get("roll", "")),
        older=len(before) + 1 - len(trials),
        **known,
    )
    read = [files.input(role, n) for n in numbers for role in ("track", "alignment", "hand", "summary")]
    record = estimate_record(context, settings, model, layout, numbers, fit, hashes_of(read))
    if in_space:
        record.fitted = fitted_parts(trials, parts[fit.roll])
    else:
        _add_what_the_rig_shows(record, files, trials, random)
    paths_m = {"planned": fit.planned_m, "fitted": fit.fitted_m, **fit.paths_m}
    paths = [(source, paths_m.get(source)) for source in SOURCES]
    facts = {"roll": fit.roll} if in_space else {}
    members = ensemble_table(fit.members, fit.member_values_m)
    write_table(files.output("ensemble"), ENSEMBLE, members, facts)
    write_table(files.output("simulated"), SIMULATED, points_table(paths, fit, trials[-1].track))
    record.write(files.output("estimate"))


def what_is_fitted(files: Files) -> tuple[list[Trial], Fitted]:
    """Return the trials that the fit after a job's trial reads, and what `estimate` takes of them."""
    job = files.job
    in_space = is_in_space(read_arrow(files.input("track", job.trial), TRACK).column_names)
    refuse_settings_of_others(job.context, in_space=in_space)
    trials = [(read_trial_in_space if in_space else read_trial)(files, number) for number in recent(job)]
    return trials, (_in_space if in_space else _in_plane)(files, trials)


def _in_space(files: Files, trials: list[Trial]) -> Fitted:
    model, space = cable_of_trials(files, trials)
    parts = parts_in_space(files, trials, model.points)
    _refuse_unseen(files, trials, next(iter(parts.values())))
    context = files.job.context
    settings = spatial_settings(context)
    thrown = context.settings.aims_in_space
    _, tried = forces_of(settings.forces, in_plane=False, thrown=thrown)
    known = {"references": True, "tried": tried, "searches": 1 if thrown else CAPTURE_SEARCHES}
    return parts, model, space, settings, known


def _refuse_unseen(files: Files, trials: list[Trial], parts: TrialParts) -> None:
    """Refuse trials, or parts of them, in which no marker enters E."""
    whole = enumerate(parts.whole, parts.trials - len(parts.whole))
    for row, throw in [*whole, *zip(parts.trial, parts.throws, strict=True)]:
        if not throw.weight.any():
            span = f"from {throw.time_s[0]:.2f} to {throw.time_s[-1]:.2f} s"
            raise StrandcastError(
                "SC-T004",
                f"no marker between the driven ends is seen without a jump {span}",
                file=files.input("track", trials[row].number),
                fix="import it with a marker on the free string; check --time-unit and the places",
            )


def _in_plane(files: Files, trials: list[Trial]) -> Fitted:
    context, newest = files.job.context, trials[-1]
    thrown = context.settings.target_m is not None
    settings = context.settings.estimate if thrown else context.settings.estimate.of_captures()
    model, layout = string_model(context, load_arm(files.input("arm")).planar())
    if not np.isfinite(newest.track.points_m[:, 1:]).any():
        raise StrandcastError(
            "SC-T004",
            "no point of the string is in the track",
            file=files.input("track", newest.number),
            fix=f"check the track's report; exclude trial {newest.number} with a reason",
        )
    throws = [throw_of(trial, settings) for trial in trials]
    parts = parts_of_throws(throws, model.places_m(), settings)
    known = {
        "planned": _planned(newest.motion, layout),
        "references": not thrown,
        "searches": 1 if thrown or settings.search == "paper" else CAPTURE_SEARCHES,
        "tried": forces_of(settings.forces, thrown=thrown)[1],
    }
    return {"": parts}, model, space_of(settings, layout, thrown=thrown), settings, known


def _add_what_the_rig_shows(
    record: Estimate, files: Files, trials: list[Trial], random: np.random.Generator
) -> None:
    """Add to the record how the servos respond, and what is wrong with the declared weights and the arm."""
    context, arm = files.job.context, load_arm(files.input("arm")).planar()
    response = servo_of(arm, trials)
    record.servo = None if response is None else servo_record(arm, response)
    seen = TrackSummary.read(files.input("summary", files.job.trial)).weights
    throws = [throw_of(trial, context.settings.estimate) for trial in trials]
    record.faults, warnings = seen_weights(context, arm, throws, record.E_m, seen, random)
    record.warnings += [*(fault.words for fault in record.faults), *warnings]
    record.rig_offsets = rig_offsets_of(arm, trials, files.inputs("cameras"), record)
    record.warnings += [] if record.rig_offsets is None else record.rig_offsets.warnings


def throw_of(trial: Trial, settings: EstimateSettings) -> Throw:
    """Return a trial as input of the estimation: the measured points, weighted by their certainty."""
    track = trial.track
    confidence = 1.0 / (1.0 + (np.nan_to_num(track.sigma_m) / DOUBT_M) ** 2)
    confidence = np.where((track.flags & UNSURE) > 0, UNSURE_WEIGHT * confidence, confidence)
    used = trial.frame_time_s <= until_s(trial, settings)
    return Throw(trial.frame_time_s, track.detected_m(), trial.hand_time_s, trial.hand_pose, used, confidence)


def _planned(motion: Motion | None, layout: MassLayout) -> StringBatch | None:
    """Return the string with which the motion was planned; None if it was not planned here."""
    if motion is None or motion.provenance is None:
        return None
    return motion.provenance.string.strings(layout.stiff_joints())
