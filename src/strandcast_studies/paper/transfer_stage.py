"""Predictions of a throw with strings fitted at other targets: transfer.json (section VIII)."""

from pathlib import Path

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.core.strings import StringBatch
from strandcast.dynamics.model import StringModel
from strandcast.estimation.evaluation import distances, evaluation_of_points, point_values
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.measured import prepare
from strandcast.estimation.throws import PreparedThrow
from strandcast.records.content_hash import result_sha256
from strandcast.stages.context import Context, context_of
from strandcast.stages.estimate import throw_of
from strandcast.stages.past_trials import read_members, read_trial, string_model
from strandcast.stages.run import files_of
from strandcast_studies.paper.gather import last_trial
from strandcast_studies.paper.records import Transfer, TransferPrediction


def run(root: Path, name: str, fitted: list[str]) -> None:
    """Write transfer.json of an experiment: its last throw with the last fits of others and its own."""
    context = context_of(root, name)
    model, layout = string_model(context, load_arm(context.arm_file).planar())
    settings, trial = context.settings.estimate, last_trial(context.folder.results)
    throw = throw_of(read_trial(files_of("estimate", root, name, trial), trial), settings)
    task = prepare(
        throw,
        model.places_m(),
        settings.start_shape,
        from_measured_hand=settings.camera_offset_sd_m is not None,
    ).fitted()
    others = [context_of(root, other) for other in fitted]
    fits = []
    for other in others:
        after = last_trial(other.folder.results)
        strings = read_members(_ensemble(other, after), layout)
        values = _values_m(model, task, strings, settings.evaluation)
        fits.append(
            TransferPrediction(
                experiment=other.name,
                target_m=list(other.settings.target_m or ()),
                trial=after,
                E_m=values[0],
                ensemble_E_m=values,
            )
        )
    Transfer(
        experiment=name,
        trial=trial,
        target_m=list(context.settings.target_m or ()),
        fits=fits,
        planned_from={
            f"{other.name}/{path.parent.name}/{path.name}": result_sha256(path)
            for other in others
            for path in [_ensemble(other, last_trial(other.folder.results))]
        },
    ).write(context.folder.results / "transfer.json")


def _ensemble(context: Context, trial: int) -> Path:
    return context.folder.trial(trial).results / "ensemble.parquet"


def _values_m(
    model: StringModel, task: PreparedThrow, strings: StringBatch, reading: str
) -> list[float | None]:
    """Return E (w = 0) of the throw with each string, None where the simulation diverged."""
    simulated, _ = simulate_throw(model, task, strings)
    distance = distances(task.points_m, simulated, reading)
    values = np.atleast_1d(evaluation_of_points(point_values(distance, task.weight)))
    return [float(value) if np.isfinite(value) else None for value in values]
