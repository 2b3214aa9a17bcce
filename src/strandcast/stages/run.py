"""Run a stage with the files that it declares."""

import importlib
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from strandcast.config.camera import CameraSettings
from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.progress import print_line
from strandcast.records.folders import parted
from strandcast.records.lineage import made_by_stage
from strandcast.stages.context import Context, context_of, context_of_camera
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job
from strandcast.stages.made import made_from, write_note
from strandcast.stages.producers import BY_CAMERA, Step, producers
from strandcast.stages.raw_files import missing_file

OF_CAMERA = re.compile(rf"\bcamera\.(?={'|'.join(CameraSettings.model_fields)})")
PAGES = ("report", "summary")  # they show what is missing


def files_of(stage: str, root: Path, experiment: str, trial: int = 0, trials: Sequence[int] = ()) -> Files:
    """Return the files that a stage reads and writes for an experiment and its trial, or all its trials.

    Raises
    ------
    StrandcastError
        As `context_of_camera`, for stages of one camera.
    """
    of = context_of_camera if stage in (*BY_CAMERA, "calibrate") else context_of
    return Files(STAGES[stage], Job(of(root, experiment), trial, tuple(trials)))


def run_stage(stage: str, root: Path, experiment: str, trial: int = 0, trials: Sequence[int] = ()) -> None:
    """Run a stage on an experiment and its trial, or all its trials."""
    run_job(files_of(stage, root, experiment, trial, trials))


def run_job(files: Files) -> None:
    """Run the stage of these files; only its code is imported."""
    stage, root = files.stage.name, files.job.context.folder.root
    if stage not in PAGES:
        _refuse_unmade(files)
    inputs = (path for role in files.stage.lineage_roles() for path in files.inputs(role))
    run = importlib.import_module(f"strandcast.stages.{stage}").run
    at_start = made_from(files)
    # One thread for linear algebra: the last digits of results must not depend on the number of cores.
    with made_by_stage(stage, root, inputs), threadpool_limits(1):
        try:
            run(files.job, files)
        except StrandcastError as error:
            _name_camera(error, files.job.context)
            if stage in PAGES and error.exit_code == INTEGRITY:  # raised after the page was written
                write_note(files, at_start)
            raise
    write_note(files, at_start)
    for warning in _warnings(files):
        print_line(f"{stage}: warning: {warning}")


def _name_camera(error: StrandcastError, context: Context) -> None:
    """Let an error about settings name those of the camera, where the experiment has several."""
    _, camera = parted(context.name)
    if camera:
        error.file = error.file or str(context.file)
        error.field, error.fix = (
            text and OF_CAMERA.sub(f"cameras.{camera}.", text) for text in (error.field, error.fix)
        )


def _warnings(files: Files) -> Iterator[str]:
    """Yield the warnings in the records that a stage has written."""
    for path in files.all_outputs():
        if path.suffix == ".json" and path.is_file():
            record = json.loads(path.read_bytes())
            yield from (*(record.get("lens") or {}).get("warnings", ()), *record.get("warnings", ()))


def _how_to_make(files: Files, step: Step) -> str:
    """Return the commands that make an input: a recording comes first, except in the lab."""
    name, trial, until = files.job.context.name, step.trial, files.stage.name.replace("_", "-")
    run = f"strandcast run {name} --until {until}"
    if trial and not files.job.is_lab and not files.job.context.folder.trial(trial).raw_files():
        folder = files.job.context.folder.trial(trial).data
        return (
            f"record trial {trial} first: copy its video into {folder}, or import motion capture "
            f"(strandcast import track {name} {trial} FILE.csv); then: {run}"
        )
    return f"make it first: {step.command(name)} ({run} makes all that is needed)"


def _refuse_unmade(files: Files) -> None:
    """Refuse inputs that another stage has not made yet, and raw files that are not there."""
    missing = next((path for path in files.all_inputs() if not path.is_file()), None)
    if missing is None:
        return
    context = files.job.context
    step = producers(context, range(1, files.job.trial + 1)).get(missing)
    if step is None:
        raise missing_file(context, missing)
    what = f"{files.stage.name} needs this file, which has not been made yet"
    fix = _how_to_make(files, step)
    raise StrandcastError("SC-W030", what, file=missing, fix=fix)
