"""Run a stage with the files that it declares."""

import importlib
from collections.abc import Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from strandcast.records.lineage import made_by_stage
from strandcast.stages.context import context_of
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job


def files_of(stage: str, root: Path, experiment: str, trial: int = 0, trials: Sequence[int] = ()) -> Files:
    """Return the files that a stage reads and writes for an experiment and its trial, or all its trials."""
    return Files(STAGES[stage], Job(context_of(root, experiment), trial, tuple(trials)))


def run_stage(stage: str, root: Path, experiment: str, trial: int = 0, trials: Sequence[int] = ()) -> None:
    """Run a stage on an experiment and its trial, or all its trials; only this stage's code is imported."""
    files = files_of(stage, root, experiment, trial, trials)
    inputs = (path for role in files.stage.lineage_roles() for path in files.inputs(role))
    run = importlib.import_module(f"strandcast.stages.{stage}").run
    # One thread for linear algebra: the last digits of results must not depend on the number of cores.
    with made_by_stage(stage, root, inputs), threadpool_limits(1):
        run(files.job, files)
