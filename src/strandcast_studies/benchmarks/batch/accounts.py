"""CPU time of a command and of all processes that it starts, by what it was spent on."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

from strandcast.workflow import stage_server

HOOK = Path(__file__).with_name("hook")
ENGINE = "snakemake"  # the module that Python runs
SERVER = stage_server.SERVER  # likewise; all its own time is overhead, and stages run in its forks


class Spent(NamedTuple):
    """CPU time of a command [s], and the engine's peak memory [MB].

    Attributes
    ----------
    stages_s, imports_s
        Python in the jobs: their own work, with that of processes that they start, and imports. Of a process
        that is killed when it is no longer needed, as one that decodes a video, all counts as work.
    starts_s
        The rest of the jobs: shells, the clients of the stage server, the start and the end of Python.
    engine_s
        Snakemake itself, with its imports and its end.
    """

    stages_s: float
    imports_s: float
    starts_s: float
    engine_s: float
    engine_mb: float

    @property
    def total_s(self) -> float:
        """Return the CPU time of all."""
        return self.stages_s + self.overhead_s

    @property
    def overhead_s(self) -> float:
        """Return the CPU time of all but the stages' own work."""
        return self.imports_s + self.starts_s + self.engine_s


class Accounts(NamedTuple):
    """What a command spent: its own process with all that it waited for, and each Python among them.

    ``processes`` are the lines that `hook.sitecustomize` writes.
    """

    cpu_s: float
    peak_mb: float  # of the largest process
    processes: list[dict[str, Any]]


def accounts_of(line: list[str], root: Path, file: Path, **environment: str) -> Accounts:
    """Run a command in a folder and return what it spent; `file` is overwritten.

    Raises
    ------
    subprocess.CalledProcessError
        The command failed.
    """
    file.unlink(missing_ok=True)
    path = os.pathsep.join([str(HOOK), *filter(None, [os.environ.get("PYTHONPATH")])])
    given = os.environ | {"PYTHONPATH": path, "STRANDCAST_ACCOUNTS": str(file)} | environment
    with subprocess.Popen(
        line, cwd=root, env=given, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    ) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, line)
    processes = [json.loads(text) for text in file.read_text(encoding="utf-8").splitlines()]
    # Not `usage.ru_maxrss`: it counts the memory of this process, from which the command was forked.
    peak_mb = max(one["peak_mb"] for one in processes)
    return Accounts(usage.ru_utime + usage.ru_stime, peak_mb, processes)


def spent_by(line: list[str], root: Path, file: Path) -> Spent:
    """Run Snakemake by a command in a folder and return what it spent; `file` is overwritten.

    Raises
    ------
    subprocess.CalledProcessError
        The command failed.
    """
    cpu_s, _, processes = accounts_of(line, root, file)
    engines = [one for one in processes if ENGINE in one["line"]]
    jobs = [one for one in processes if one not in engines]
    all_jobs_s = sum(one["children_s"] for one in engines)
    imports_s = sum(one["imports_s"] for one in jobs)
    stages = [one for one in jobs if SERVER not in one["line"]]
    whole_s = sum(one["cpu_s"] + one["children_s"] for one in stages if not one["nested"])
    stages_s = whole_s - sum(one["imports_s"] + one["start_s"] for one in stages)
    return Spent(
        stages_s,
        imports_s,
        all_jobs_s - stages_s - imports_s,
        cpu_s - all_jobs_s,
        max(one["peak_mb"] for one in engines),
    )
