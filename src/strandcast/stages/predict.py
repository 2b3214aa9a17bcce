"""Predict recorded trials with a fitted string, without fitting anything."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import STATUS
from strandcast.errors import StrandcastError
from strandcast.estimation.cable_space import CableSpace
from strandcast.estimation.evaluation import distances, evaluation_of_points, point_values, tip_error
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.measured import parts_of_throws
from strandcast.estimation.throws import PreparedThrow
from strandcast.imports.track_checks import LENGTH_ERROR
from strandcast.records.content_hash import result_sha256
from strandcast.records.estimate import ENSEMBLE, SIMULATED, Estimate
from strandcast.records.tables import read_arrow, read_facts, write_table
from strandcast.records.track import TRACK, Track, is_in_space
from strandcast.stages.context import context_of
from strandcast.stages.declarations import STAGES
from strandcast.stages.estimate import throw_of
from strandcast.stages.estimate_record import points_table
from strandcast.stages.files import supplied
from strandcast.stages.job import Files, Job
from strandcast.stages.past_trials import read_trial, string_model
from strandcast.stages.run import run_stage
from strandcast.stages.trials_in_space import length_in_space_m, read_trial_in_space, series_of


@dataclass(frozen=True)
class TrialPrediction:
    """The file of a predicted series, and its error.

    Attributes
    ----------
    tip_m, tip_share
        Mean distance of the last marker, and that over the string's length; None where it was not measured
        or is at a driven end.
    points_m, E_m
        Mean distance of all markers measured, and E (w = 0).
    """

    trial: int
    file: Path
    tip_m: float | None
    tip_share: float | None
    points_m: float
    E_m: float


def predict(root: Path, experiment: str, number: int, estimate_file: Path, out: Path) -> TrialPrediction:
    """Write a trial's motion as an estimate predicts it, open loop from its start: trial-NN.parquet in `out`.

    Raises
    ------
    StrandcastError
        SC-E009 the estimate is of a string in the plane and the trial in space, or the reverse, or their
        strings are driven at other ends; any that its files raise.
    """
    estimate = Estimate.read(estimate_file)
    files = Files(STAGES["estimate"], Job(context_of(root, experiment), number))
    if supplied(files.job, number):
        run_stage("register_track", root, experiment, number)
    in_space = is_in_space(read_arrow(files.input("track", number), TRACK).column_names)
    if in_space is not (estimate.string.options.keys() >= {"length_change"}):
        raise _other_string(files, "the estimate is of a string in the plane, or the trial is")
    read = _in_space if in_space else _in_plane
    model, throw, track, stiff = read(files, estimate, estimate_file)
    points_m, status = simulate_throw(model, throw, estimate.string.strings(stiff))
    if not np.isfinite(points_m).all():
        what = f"the string of this estimate diverges in trial {number} ({STATUS[status[0]]})"
        raise StrandcastError("SC-E009", what, file=estimate_file, fix="name another estimate")
    if not (throw.weight > 0).any():
        raise _other_string(files, "no point of this trial was measured")
    off_m = distances(throw.seen_m, points_m[0], estimate.evaluation)
    tip_m, file = tip_error(off_m), out / f"{files.job.folder.results.name}.parquet"
    seen = np.isfinite(tip_m)
    found = TrialPrediction(
        number,
        file,
        tip_m=tip_m if seen else None,
        tip_share=tip_m / estimate.length_m if seen else None,
        points_m=float(np.nanmean(off_m)),
        E_m=float(evaluation_of_points(point_values(off_m, throw.weight))),
    )
    rows = points_table([("predicted", points_m[0])], throw, track)
    error = {name: value for name, value in asdict(found).items() if name not in ("trial", "file")}
    write_table(file, SIMULATED, rows, error | {"estimate_sha256": result_sha256(estimate_file)})
    return found


Read = tuple[StringModel, PreparedThrow, Track, np.ndarray]


def _in_space(files: Files, estimate: Estimate, estimate_file: Path) -> Read:
    """Return the model, a trial in space, its track, and no stiff joints (n,)."""
    trial = read_trial_in_space(files, files.job.trial)
    roll = str(read_facts(estimate_file.with_name("ensemble.parquet"), ENSEMBLE)["roll"])
    rolls = series_of(files, trial)
    if roll not in rolls:
        raise _other_string(files, f"the driven ends cannot turn as those of the estimate do ({roll})")
    series = rolls[roll]
    unknowns = {fit.name for fit in estimate.parameters}
    held = {how.needs for how in CableSpace.ways().values() if how.name in unknowns}
    pinned, far_clamp = "clamp" not in held, "two clamps" in held
    if pinned != series.pinned or far_clamp != (series.two_ends() and not pinned):
        raise _other_string(files, "the estimate is of a string that is driven at other ends")
    length_m = length_in_space_m(files.job.context)
    if abs(estimate.length_m / length_m - 1.0) > LENGTH_ERROR:
        fitted = f"the estimate is of a string of {estimate.length_m:g} m"
        raise _other_string(files, f"{fitted}, and not of {length_m:g} m")
    model = StringModel(estimate.length_m, estimate.points, reading="strain", dt_s=estimate.dt_s)
    throw = series.prepared(0, len(series.time_s), model.points)
    return model, throw, trial.track, np.zeros(model.points, dtype=bool)


def _in_plane(files: Files, estimate: Estimate, _: Path) -> Read:
    """Return the model, a trial in the plane, its track, and which joints are stiff (n,)."""
    context = files.job.context
    settings, trial = context.settings.estimate, read_trial(files, files.job.trial)
    model, layout = string_model(context, load_arm(context.arm_file).planar())
    model = replace(model, reading=cast(Any, estimate.reading), dt_s=estimate.dt_s)
    if (estimate.length_m, estimate.points) != (model.length_m, model.points):
        fitted = f"the estimate is of a string of {estimate.length_m:g} m as {estimate.points} points"
        raise _other_string(files, f"{fitted}, and not of {model.length_m:g} m as {model.points}")
    throw = parts_of_throws([throw_of(trial, settings)], model.places_m(), settings).newest
    return model, throw, trial.track, layout.stiff_joints()


def _other_string(files: Files, what: str) -> StrandcastError:
    return StrandcastError(
        "SC-E009", what, file=files.input("track", files.job.trial), fix="name an estimate of such a trial"
    )
