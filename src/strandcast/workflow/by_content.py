"""Let Snakemake decide by content which stages run: by the notes of the stages, and by no time of a file."""

import atexit
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from snakemake.dag import DAG
from snakemake.jobs import Job as SnakemakeJob
from snakemake.persistence import PersistenceBase

from strandcast.records.known_hashes import remembered
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job
from strandcast.stages.made import changes_since_made
from strandcast.workflow.events import STAGES as STAGE_OF_RULE
from strandcast.workflow.targets import experiment


class Changes(list[str]):
    """What has changed since a job's results were made; Snakemake prints it."""

    def __str__(self) -> str:
        return "; ".join(self)


def decide_by_content(changes_of: Callable[[Any], Changes]) -> None:
    """Replace what Snakemake asks about a stage's job: times, its own notes, and marks of jobs not finished.

    A job that was killed has left no note of what it wrote.
    """
    memory = ExitStack()
    memory.enter_context(remembered(Path()))
    atexit.register(memory.close)

    async def soon(answer: Any) -> Any:  # Snakemake waits for these answers
        return answer

    _replace(PersistenceBase, "has_metadata", lambda job: True)
    _replace(PersistenceBase, "has_outdated_metadata", lambda job: False)
    _replace(PersistenceBase, "params_changed", changes_of)
    for name in ("input_changed", "code_changed", "software_stack_changed"):
        _replace(PersistenceBase, name, lambda job: [])
    _replace(PersistenceBase, "incomplete", lambda job: soon([]))
    # It deletes results "older" than their inputs.
    _replace(DAG, "check_output_mtime", lambda job: soon(None))
    times = vars(SnakemakeJob)["output_mintime"].fget
    own = property(lambda job: soon(None) if is_stage(job) else times(job))
    SnakemakeJob.output_mintime = own


def _replace(place: type, name: str, answer: Callable[[Any], Any]) -> None:
    """Replace a method for jobs of stages; the page of all experiments is left to Snakemake."""
    original = getattr(place, name)

    def method(self: Any, job: Any, *others: Any, **named: Any) -> Any:
        return answer(job) if is_stage(job) else original(self, job, *others, **named)

    setattr(place, name, method)


def is_stage(job: Any) -> bool:
    """Return whether a job of Snakemake runs a stage."""
    return _stage_of(job) in STAGES


def _stage_of(job: Any) -> str:
    rule: str = job.rule.name
    return STAGE_OF_RULE.get(rule, rule)


def changes(job: Any) -> Changes:
    """Return in words what has changed since the results of a job of Snakemake were made."""
    names, stage = job.wildcards, _stage_of(job)
    trials = tuple(job.params.trials) if stage == "summary" else ()
    files = Files(STAGES[stage], Job(experiment(names.experiment), int(names.get("trial", 0)), trials))
    return Changes(changes_since_made(files))
