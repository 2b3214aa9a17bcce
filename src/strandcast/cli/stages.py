"""One command for each stage; the rules of the workflow call them."""

import json
import os
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, TrialNumber, complete_trial, show
from strandcast.core.trial_names import LAST_TRIAL, trial_name
from strandcast.progress import print_line, set_context
from strandcast.records.folders import WITHIN_WORKFLOW, ExperimentFolder

MAX_RSS_PER_MB = 1 << (20 if sys.platform == "darwin" else 10)
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
    "align": "Align the camera's clock with the robot's.",
    "join_views": "Join what several cameras saw of a throw to a track in space.",
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


def campaign(as_json: AsJson = False) -> None:
    """Write the page of all experiments, results/report.html, from their summaries."""
    from strandcast.workflow.campaign import write_campaign
    from strandcast.workflow.runner import refuse_elsewhere

    refuse_elsewhere(ROOT)
    tally, page = write_campaign(ROOT)
    show(as_json, tally.to_json() | {"page": page}, [f"{tally}; page: {page}"])


def _run(as_json: bool, stage: str, subject: str, *arguments: Any) -> None:
    """Run a stage; lines of progress begin with its subject. Each stage imports only what it needs."""
    from strandcast.stages.run import files_of, run_job
    from strandcast.workflow.locks import lease

    set_context(subject)
    print_line(f"{subject} {stage}")
    with lease(ROOT, arguments[0]):
        files = files_of(stage, ROOT, *arguments)
        with _usage_written(files.usage) if WITHIN_WORKFLOW in os.environ else nullcontext():
            run_job(files)
    show(as_json, {"stage": stage, "experiment": arguments[0], "files": files.all_outputs()}, ())


@contextmanager
def _usage_written(path: Path) -> Iterator[None]:
    """Write the block's wall time [s] and the process's CPU time [s] and peak memory [MB], if it succeeds.

    The fields are those of Snakemake's `benchmark`, which looks at all processes of the computer twice a
    second and would not find the forks of the stage server.
    """
    began_s = time.monotonic()
    yield
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    record = {
        "s": round(time.monotonic() - began_s, 4),
        "cpu_time": round(sum(each.ru_utime + each.ru_stime for each in used), 4),
        "max_rss": round(max(each.ru_maxrss for each in used) / MAX_RSS_PER_MB, 1),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record) + "\n", encoding="utf-8")
