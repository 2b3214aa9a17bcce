"""How strings that were fitted at other targets predict a throw: transfer.json (section VIII)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.estimation.evaluation import evaluation_value
from strandcast.estimation.objective import play
from strandcast.estimation.space import Strings
from strandcast.estimation.throw import Task, prepare
from strandcast.paper.gather import last_trial
from strandcast.records.files import sha256_file
from strandcast.records.paper import Foretold, Transfer
from strandcast.stages.context import Context, context_of
from strandcast.stages.estimate import throw_of
from strandcast.stages.trials import read_members, read_trial, string_model
from strandcast.string.model import StringModel


def run(root: Path, name: str, fitted: list[str]) -> None:
    """Write transfer.json of an experiment: its last throw under the last fits of others and its own."""
    context = context_of(root, name)
    model, layout = string_model(context, load_arm(context.arm_file))
    settings, trial = context.settings.estimate, last_trial(context.folder.results)
    throw = throw_of(read_trial(context, trial), settings)
    task = prepare(
        throw, model.places_m(), settings.start_shape, from_seen_hand=settings.camera_offset_sd_m is not None
    ).fitted()
    others = [context_of(root, other) for other in fitted]
    fits = []
    for other in others:
        after = last_trial(other.folder.results)
        strings = read_members(_ensemble(other, after), layout)
        values = _values_m(model, task, strings, settings.evaluation)
        fits.append(
            Foretold(
                experiment=other.name,
                target_m=list(other.settings.target_m),
                trial=after,
                E_m=values[0],
                ensemble_E_m=values,
            )
        )
    Transfer(
        experiment=name,
        trial=trial,
        target_m=list(context.settings.target_m),
        fits=fits,
        planned_from={
            f"{other.name}/{path.parent.name}/{path.name}": sha256_file(path)
            for other in others
            for path in [_ensemble(other, last_trial(other.folder.results))]
        },
    ).write(context.folder.results / "transfer.json")


def _ensemble(context: Context, trial: int) -> Path:
    return context.folder.trial(trial).results / "ensemble.parquet"


def _values_m(model: StringModel, task: Task, strings: Strings, reading: str) -> list[float | None]:
    """Return E (w = 0) of the throw under each string, None where it blows up."""
    simulated, _ = play(model, task, strings)
    values = np.atleast_1d(evaluation_value(task.points_m, simulated, 0.0, task.weight, reading))
    return [float(value) if np.isfinite(value) else None for value in values]
