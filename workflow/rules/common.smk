"""Shared by all rules: the shell's environment, and the calls of `strandcast.workflow`."""

import gc
import inspect
import os
import shlex
import sys
from functools import partial, wraps
from pathlib import Path

from snakemake.persistence import PersistenceBase

from strandcast.errors import StrandcastError
from strandcast.records.folders import WITHIN_WORKFLOW, parted
from strandcast.stages.code_version import code_version
from strandcast.workflow import by_content, locks, shards, slurm
from strandcast.workflow import stage_server, storage, targets
from strandcast.workflow.targets import stage_outputs

# Jobs use the Python that runs Snakemake, and rely on the lease that it holds.
PYTHON_FOLDER = shlex.quote(str(Path(sys.executable).parent))


def reported(function):
    """Return a function that ends Snakemake with a user's error as one message, without a traceback."""

    @wraps(function)
    def call(*arguments, **named):
        try:
            return function(*arguments, **named)
        except StrandcastError as error:
            sys.stderr.write(f"{error}\n")
            os._exit(error.exit_code)

    # Snakemake asks for it at each call.
    call.__signature__ = inspect.signature(function)
    return call


STORAGE = reported(storage.open_storage)(workflow)  # None: all files are on disk


def use_command(strandcast):
    """Let the rules' `strandcast` be a command."""
    command = f'{strandcast} "$@"'
    if STORAGE is not None:
        command = f"(cd {shlex.quote(str(STORAGE.folder))} && exec {command})"
    shell.prefix(
        f"set -euo pipefail; export PATH={PYTHON_FOLDER}:$PATH {WITHIN_WORKFLOW}=1; "
        f"strandcast() {{{{ {command}; }}}}; "
    )


def start_server():
    """Let stages run in forks of one process, unless their rules have an environment of their own."""
    if not workflow.deployment_settings.deployment_method:
        use_command(stage_server.start(STORAGE.folder if STORAGE else Path()))


def limit_no_rate():
    """Start jobs of this computer at any rate.

    With a limit, each round of the scheduler asks for one more a second later: rounds accumulate, and after
    a thousand jobs there are a thousand rounds per second.
    """
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None


# A job of a cluster makes what Snakemake has sent it for, changed or not.
if STORAGE is None:
    by_content.decide_by_content(
        reported(by_content.changes)
        if workflow.is_main_process
        else lambda job: by_content.Changes()
    )
# Snakemake holds nearly all that it makes until it ends: to look for garbage less often (as Python does
# after 700 objects) saves a tenth of a run in which nothing is to be done, and costs no memory.
gc.set_threshold(100_000, 50, 50)
# It would import pandas, 65 MB, to look for tables among the parameters, which are text and numbers.
PersistenceBase._serialize_param_pandas = PersistenceBase._serialize_param_builtin
use_command(stage_server.DIRECTLY)
if workflow.subprocess_exec:  # a cluster's job, which does not call onstart
    start_server()


def stage_inputs(stage, trials=lambda w: ()):
    """Return the input function of a stage: its files by role. `trials` are those that a summary covers."""

    @reported
    def inputs(wildcards):
        job = stage, wildcards.experiment, trial_of(wildcards), trials(wildcards)
        return targets.stage_inputs(*job) if STORAGE is None else stored_inputs(*job)

    return inputs


def stored_inputs(*job):
    """Return the input files of a job by role, all that it reads; the settings among them are local files."""
    STORAGE.inform(workflow.iocache)
    found = targets.stage_inputs(*job, all_read=True)
    return {
        role: [local(path) if storage.is_setting(path) else path for path in paths]
        for role, paths in found.items()
    }


def stage_settings(stage):
    """Return the params function of a stage: the settings that it reads, as JSON."""
    return reported(lambda w: targets.stage_settings(stage, w.experiment, trial_of(w)))


def shard_of(stage):
    """Return the group function of a stage: the jobs that a cluster runs as one."""

    @reported
    def group(wildcards):
        name = shards.shard_of(stage, wildcards.experiment, trial_of(wildcards))
        if name is not None and name.endswith(f".{shards.THROWS}"):
            workflow.parent_groupids[name] = shards.THROWS
        return name

    return group


def memory_of(stage):
    """Return the resource function of a stage: the memory that it asks for, in MB."""
    return reported(
        lambda wildcards, attempt: shards.memory_mb(
            stage, wildcards.experiment, trial_of(wildcards), attempt
        )
    )


def runtime_of(stage):
    """Return the resource function of a stage: the time that it asks for, in minutes."""
    return reported(
        lambda wildcards, attempt: shards.runtime_min(
            stage, wildcards.experiment, trial_of(wildcards), attempt
        )
    )


def trial_of(wildcards):
    """Return the number of a job's trial; 0 for a job of the experiment."""
    return int(wildcards.get("trial", 0))


@reported
def all_trials(wildcards):
    """Return the trials of an experiment; in the lab, each verdict says whether another one follows."""
    return targets.trials_of(
        wildcards.experiment, partial(verdict_of, wildcards.experiment)
    )


def verdict_of(experiment, trial):
    """Return a trial's verdict; Snakemake makes it first, then asks again."""
    return checkpoints.score_lab.get(experiment=experiment, trial=trial).output.verdict


@reported
def take_leases():
    """Take the leases of the experiments that the jobs to come belong to, until Snakemake ends."""
    on_slurm = workflow.executor_plugin.name == slurm.SLURM
    locks.hold_until_exit(
        Path(),
        {
            parted(job.wildcards.experiment)[0]
            for job in workflow.dag.needrun_jobs()
            if "experiment" in job.wildcards.keys()
        },
        slurm.refuse_left_jobs if on_slurm else None,
    )
    if on_slurm:
        slurm.report_held_jobs(Path())


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
FILMED_IN_LAB = targets.names_pattern(targets.lab_experiments(captures=False))
CAPTURED_IN_LAB = targets.names_pattern(targets.lab_experiments(captures=True))
RECORDED_EXPERIMENTS = targets.other_names_pattern(targets.lab_experiments())
SUPPLIED, PLAYED = targets.supplied_trials(), targets.played_trials()
JOINED = targets.joined_trials()
THROWN = targets.thrown_trials()
