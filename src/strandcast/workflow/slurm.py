"""Slurm's queue: jobs that it holds, which would wait for ever, and jobs that an ended run left behind."""

import importlib.util
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from threading import Thread
from typing import NamedTuple

from strandcast.errors import ENVIRONMENT, StrandcastError
from strandcast.stages.declarations import STAGES
from strandcast.workflow.shards import THROWS

SLURM = "slurm"  # the executor's name
PLUGIN = "snakemake_executor_plugin_slurm"
POLL_S = 30.0  # chosen: as often as the executor asks for the state of its jobs
PATIENCE_S = 60.0  # chosen: a busy controller answers late; then the next poll counts
FORMAT = "%i|%T|%Z|%k|%r"  # job, state, working directory, comment, reason: a reason may hold any character
# Reasons for which a job waits until somebody acts; `squeue` gives the others to jobs that will start.
NEVER_STARTS = re.compile(
    r"held|BadConstraints|Invalid|PartitionTimeLimit|PartitionNodeLimit|PartitionConfig|NodeNotAvail.*DOWN"
    r"|(?:Assoc|QOS)Max\w+PerJob\w*",
    re.IGNORECASE,
)


class SlurmJob(NamedTuple):
    """A job in Slurm's queue; the executor writes rules and wildcards into its comment."""

    id: str
    state: str
    folder: str
    comment: str
    reason: str

    def is_of(self, experiment: str) -> bool:
        """Return whether a job is of an experiment, by the comment that the executor gives it."""
        name, stages = re.escape(experiment), "|".join(STAGES)
        group = rf"rule_{name}(?:\.{THROWS})?_(?:{stages})"
        single = rf"rule_(?:{stages})\w*_wildcards_{name}(?:_|$)"
        return re.match(f"{group}|{single}", self.comment) is not None


def jobs_in(root: Path) -> list[SlurmJob]:
    """Return this user's jobs that wait or run in a folder; none if Slurm does not answer."""
    line = ["squeue", "--me", "--noheader", f"--format={FORMAT}"]
    try:
        answer = subprocess.run(
            line, capture_output=True, text=True, errors="replace", timeout=PATIENCE_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return []
    rows = (row.split("|", 4) for row in answer.stdout.splitlines())
    jobs = [SlurmJob(*row) for row in rows if len(row) == len(SlurmJob._fields)]
    return [job for job in jobs if Path(job.folder).resolve() == root.resolve()]


def held_jobs(jobs: Iterable[SlurmJob]) -> list[SlurmJob]:
    """Return the jobs that wait and that Slurm will not start by itself."""
    return [job for job in jobs if job.state == "PENDING" and NEVER_STARTS.search(job.reason)]


def held_message(jobs: list[SlurmJob]) -> StrandcastError:
    """Return the message about jobs that Slurm holds."""
    ids = " ".join(job.id for job in jobs)
    reasons = "; ".join(sorted({job.reason for job in jobs}))
    return StrandcastError(
        "SC-W024",
        f"Slurm will not start {_counted(jobs)} by itself: {reasons} (Slurm's job {ids.replace(' ', ', ')})",
        cost="the run waits for them without end; the other jobs go on",
        fix=f"`sinfo --list-reasons` and `scontrol show job {jobs[0].id}` say why; then start them: "
        f"scontrol release {' '.join(job.id for job in jobs)}; or give them up: scancel {ids}",
    )


def report_held_jobs(root: Path) -> None:
    """Report jobs that Slurm holds, each once, while this process lives."""
    Thread(target=_report_held_jobs, args=(root,), daemon=True).start()


def _report_held_jobs(root: Path) -> None:
    known: set[tuple[str, str]] = set()
    while True:
        held = [job for job in held_jobs(jobs_in(root)) if (job.id, job.reason) not in known]
        if held:
            known |= {(job.id, job.reason) for job in held}
            print(held_message(held).message("WARNING"), file=sys.stderr, flush=True)
        time.sleep(POLL_S)


def refuse_left_jobs(root: Path, experiments: Iterable[str]) -> None:
    """Refuse experiments on which jobs of an ended run still work or will.

    The run that calls this has the experiments' leases and no jobs yet: a job of theirs was left by a run
    that was killed, and would write over the files of this one.

    Raises
    ------
    StrandcastError
        SC-W024 there are such jobs.
    """
    names = sorted(set(experiments))
    left = [job for job in jobs_in(root) if any(job.is_of(name) for name in names)]
    if left:
        ids = [job.id for job in left]
        raise StrandcastError(
            "SC-W024",
            f"Slurm still has {_counted(left)} of a run that has ended: {', '.join(ids)}",
            file=root.resolve(),
            cost="two jobs at once would overwrite each other's files",
            fix=f"end them: scancel {' '.join(ids)}; or wait until `squeue --me` no longer lists them",
        )


def require_slurm(*, submits: bool = True) -> None:
    """Refuse to run on Slurm where Snakemake's plugin for it, or if it submits jobs, `sbatch` is not found.

    Raises
    ------
    StrandcastError
        SC-W026 there is no sbatch. SC-W012 there is no plugin.
    """
    if importlib.util.find_spec(PLUGIN) is None:
        what = f"Slurm needs the package {PLUGIN.replace('_', '-')}, which is not installed"
        fix = "in a clone: make slurm; otherwise: pip install 'strandcast[slurm]'"
        raise StrandcastError("SC-W012", what, fix=fix, exit_code=ENVIRONMENT)
    if submits and shutil.which("sbatch") is None:
        raise StrandcastError(
            "SC-W026",
            "no `sbatch` is found: this computer submits no jobs to Slurm",
            exit_code=ENVIRONMENT,
        )


def status_options() -> list[str]:
    """Return the options of Snakemake for a cluster without accounting: `squeue` gives its jobs' states."""
    line = ["sacct", "--noheader", "--allocations"]
    try:
        answer = subprocess.run(line, capture_output=True, timeout=PATIENCE_S, check=False)
        has_accounting = answer.returncode == 0
    except OSError:  # there is no sacct, or it may not be run
        has_accounting = False
    except subprocess.TimeoutExpired:  # it is there, and busy
        has_accounting = True
    return [] if has_accounting else ["--slurm-status-command", "squeue", "--slurm-no-account"]


def _counted(jobs: list[SlurmJob]) -> str:
    return "a job" if len(jobs) == 1 else f"{len(jobs)} jobs"
