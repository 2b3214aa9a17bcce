"""One command for each stage; the rules of the workflow call them."""

import os
from collections.abc import Callable
from contextlib import nullcontext
from typing import Annotated, Any

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, TrialNumber, complete_trial, show
from strandcast.core.trial_names import LAST_TRIAL, trial_name
from strandcast.progress import print_line, set_context
from strandcast.records.folders import WITHIN_WORKFLOW, ExperimentFolder

EXPERIMENT_STAGES = {
    "lab_calibrate": "Photograph the calibration boards in the virtual lab.",
    "lab_rehearse": "Plan the first motion and play it with an empty clamp in the virtual lab.",
    "calibrate": "Calibrate the lens and the plane of motion.",
}
TRIAL_STAGES = {
    "lab_throw": "Play a planned motion in the virtual lab and film the throw.",
    "lab_capture": "Play a planned motion in the virtual lab in space and capture the throw.",
    "ingest": "Hash and check the raw files of a trial.",
    "track": "Track the string of a trial as mass points.",
    "reconstruct": "Reconstruct the track of a trial in metres from its detections.",
    "clip": "Cut the film of a trial's throw for its page.",
    "align": "Align the camera's clock with the robot's.",
    "register_track": "Register a track and an alignment that were measured elsewhere.",
    "register_motion": "Register the motion that a real arm has played as the trial's motion.",
    "score": "Compute by how much the throw missed its objective.",
    "estimate": "Fit the string parameters to the newest throws.",
    "plan": "Plan the motion of a trial from the trials before it.",
    "report": "Write the page of a trial.",
}


def stage_commands() -> dict[str, tuple[Callable[..., None], str]]:
    """Return the stages' commands by name: function and help text."""
    commands = {stage: (_of_experiment(stage), text) for stage, text in EXPERIMENT_STAGES.items()}
    commands |= {stage: (_of_trial(stage), text) for stage, text in TRIAL_STAGES.items()}
    return {stage.replace("_", "-"): command for stage, command in commands.items()}


def _of_experiment(stage: str) -> Callable[..., None]:
    def command(experiment: ExperimentName, as_json: AsJson = False) -> None:
        _run(as_json, stage, experiment, experiment)

    return command


def _of_trial(stage: str) -> Callable[..., None]:
    def command(experiment: ExperimentName, trial: TrialNumber, as_json: AsJson = False) -> None:
        _run(as_json, stage, f"{experiment} {trial_name(trial)}", experiment, trial)

    return command


def summary(
    experiment: ExperimentName,
    trials: Annotated[
        list[int] | None,
        typer.Argument(metavar="TRIAL", min=1, max=LAST_TRIAL, autocompletion=complete_trial),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write the page and the summary of an experiment (default: all trials that have a page)."""
    chosen = trials or ExperimentFolder(ROOT, experiment).reported_trials()
    _run(as_json, "summary", experiment, experiment, 0, chosen)


def _run(as_json: bool, stage: str, subject: str, *arguments: Any) -> None:
    """Run a stage; lines of progress begin with its subject. Each stage imports only what it needs."""
    from strandcast.stages.run import files_of, run_stage
    from strandcast.stages.usage import usage_written
    from strandcast.workflow.locks import lease

    set_context(subject)
    print_line(f"{subject} {stage}")
    with lease(ROOT, arguments[0]):
        files = files_of(stage, ROOT, *arguments)
        with usage_written(files.usage) if WITHIN_WORKFLOW in os.environ else nullcontext():
            run_stage(stage, ROOT, *arguments)
    show(as_json, {"stage": stage, "experiment": arguments[0], "files": files.all_outputs()}, ())
