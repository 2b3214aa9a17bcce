"""Shared by all rules: the shell's environment, and the calls of `strandcast.workflow`."""

import os
import shlex
import sys
from functools import partial, wraps
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.records.folders import WITHIN_WORKFLOW
from strandcast.workflow import locks, targets
from strandcast.workflow.code_version import code_version
from strandcast.workflow.targets import stage_outputs

# Jobs use the Python that runs Snakemake, and rely on the lease that it holds.
PYTHON_FOLDER = shlex.quote(str(Path(sys.executable).parent))
shell.prefix(
    f"set -euo pipefail; export PATH={PYTHON_FOLDER}:$PATH {WITHIN_WORKFLOW}=1; "
)


def reported(function):
    """Return a function that ends Snakemake with a user's error as one message, without a traceback."""

    @wraps(function)
    def call(*arguments):
        try:
            return function(*arguments)
        except StrandcastError as error:
            sys.stderr.write(f"{error}\n")
            os._exit(error.exit_code)

    return call


def stage_inputs(stage, trials=lambda w: ()):
    """Return the input function of a stage: its files by role. `trials` are those that a summary covers."""

    @reported
    def inputs(wildcards):
        trial = int(wildcards.get("trial", 0))
        return targets.stage_inputs(
            stage, wildcards.experiment, trial, trials(wildcards)
        )

    return inputs


def stage_settings(stage):
    """Return the params function of a stage: the settings that it reads, as JSON."""
    return reported(lambda w: targets.stage_settings(stage, w.experiment))


@reported
def all_trials(wildcards):
    """Return the trials of an experiment; in the lab, each verdict says whether another one follows."""
    return targets.trials_of(
        wildcards.experiment, partial(verdict_of, wildcards.experiment)
    )


def verdict_of(experiment, trial):
    """Return a trial's verdict; Snakemake makes it first, then asks again."""
    return checkpoints.score.get(experiment=experiment, trial=trial).output.verdict


@reported
def take_leases():
    """Take the leases of the experiments that the jobs to come belong to, until Snakemake ends."""
    jobs = workflow.dag.needrun_jobs()
    locks.hold_until_exit(
        Path(),
        {
            job.wildcards.experiment
            for job in jobs
            if "experiment" in job.wildcards.keys()
        },
    )


def kept(outputs):
    """Return outputs that Snakemake restores if their job fails, instead of removing them."""
    return {role: update(paths) for role, paths in outputs.items()}


def shown(outputs, category, **captions):
    """Return outputs, those with a caption in workflow/report/ marked for `snakemake --report`."""
    marked = {
        role: report(
            outputs[role],
            category=category,
            subcategory="{experiment}",
            labels=labels_of(outputs[role], caption),
            caption=f"../report/{caption}.rst",
        )
        for role, caption in captions.items()
    }
    return outputs | marked


def labels_of(pattern, content):
    """Return the columns by which the report lists a file: what it shows, and of which trial or camera."""
    names = [name for name in ("trial", "camera") if f"{{{name}}}" in pattern]
    return {name: f"{{{name}}}" for name in names} | {"content": content}


EXPERIMENTS = targets.default_experiments()
LAB_EXPERIMENTS = targets.names_pattern(targets.lab_experiments())
SUPPLIED, PLAYED = targets.supplied_trials(), targets.played_trials()
THROWN = targets.thrown_trials()
