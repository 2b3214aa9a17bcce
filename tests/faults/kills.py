"""Kill runs and single stages (SIGKILL) at random moments, go on, compare every file with an undisturbed run.

    python -m tests.faults.kills --runs 100 --stages 20

`make faults-nightly` calls this module; the exit code is 1 if a file was wrong or unreadable, or a process
ended in a traceback.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import psutil

from strandcast.workflow.locks import owner_of

from .small import (
    JOBS,
    NAME,
    Job,
    differences,
    environment,
    fork_job,
    hashes,
    hidden_files,
    make_project,
    make_whole,
    outputs,
)

LINE = [sys.executable, "-m", "strandcast", "run", NAME, "--cores", "2"]
MOST_TRIES = 10  # per kill: a stage may end before it is killed
LONGEST_S = 600.0  # of any process; a busy machine takes 90 s for a run
# Who is killed: all processes, as by a power cut, or one alone, as by the system when memory runs out.
VICTIMS = ("all", "all", "all", "all", "front", "engine", "job")
BAD = ("wrong", "unreadable", "traceback", "failed", "left over")


class Tally(Counter[str]):
    """The counts of a series of kills; whatever is bad is printed when it is counted."""

    def bad(self, kind: str, what: str) -> None:
        self[kind] += 1
        print(f"{kind}: {what}", flush=True)

    def check(self, root: Path, expected: dict[str, str], said: str, subject: str) -> None:
        """Count files with other bytes, and a traceback in what a process said."""
        for kind, name in differences(root, expected):
            self.bad(kind, f"{name} after {subject}")
        if "Traceback" in said:
            self.bad("traceback", f"{subject}\n{said[-3000:]}")

    def finished(self, root: Path, expected: dict[str, str], code: int, said: str, subject: str) -> None:
        """Count a run that was not killed: all files must be there, and nothing else."""
        self.check(root, expected, said, subject)
        if code:
            self.bad("failed", f"{subject}: exit code {code}\n{said[-3000:]}")
        elif hashes(root) == expected:
            self["identical"] += 1
        for name in hidden_files(root):
            self.bad("left over", f"{name} after {subject}")


def start_run(root: Path, log: Path) -> subprocess.Popen[bytes]:
    """Start `strandcast run`; what it says goes to a file."""
    with log.open("wb") as file:
        return subprocess.Popen(LINE, cwd=root, env=environment(), stdout=file, stderr=file)


def wait(run: subprocess.Popen[bytes], seconds: float) -> int | None:
    """Wait for a process; return its exit code, None if it still runs."""
    with suppress(subprocess.TimeoutExpired):
        return run.wait(seconds)
    return None


def kill(run: subprocess.Popen[bytes], victim: str) -> list[psutil.Process]:
    """Kill a run's processes, or one of them; return those that live on without it."""
    tree: list[psutil.Process] = []
    front = psutil.Process(run.pid)
    while new := [process for process in [front, *front.children(recursive=True)] if process not in tree]:
        tree += new
        for process in new:  # a stopped process starts no others
            with suppress(psutil.NoSuchProcess):
                process.suspend()
    chosen = {"all": tree, "front": tree[:1], "engine": tree[1:2], "job": tree[-1:]}[victim] or tree
    for process in tree:
        with suppress(psutil.NoSuchProcess):
            process.kill() if process in chosen else process.resume()
    run.wait(LONGEST_S)  # without a job, or without its engine, it ends by itself
    return [process for process in tree if process not in chosen]


def kill_runs(
    folder: Path, expected: dict[str, str], kills: int, longest_s: float, rng: random.Random
) -> Tally:
    """Kill a run, start it again, and so on; after a run that reached its end, start from nothing."""
    tally, root, log = Tally(), folder / "runs", folder / "run.log"
    living: list[psutil.Process] = []
    while tally["tried"] < kills or root.exists():
        if not root.exists():
            make_project(root)
        run = start_run(root, log)
        code = wait(run, rng.uniform(0.0, longest_s) if tally["tried"] < kills else LONGEST_S)
        if code is None:
            tally["tried"] += 1
            victim = rng.choice(VICTIMS)
            living += kill(run, victim)
            said = log.read_text(errors="replace")
            tally.check(root, expected, said, f"kill {tally['tried']} of a run ({victim})")
            print(f"runs: {dict(tally)}", flush=True)
        elif "SC-W010" in log.read_text(errors="replace"):
            tally["refused while the engine of a killed run went on"] += 1
            end_owner(root)
        else:
            wait_for(living)
            tally.finished(root, expected, code, log.read_text(errors="replace"), "a run to its end")
            shutil.rmtree(root)
    return tally


def wait_for(processes: list[psutil.Process]) -> None:
    """Wait for processes of others: here, one that has ended may stay a zombie."""
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            while process.status() != psutil.STATUS_ZOMBIE:
                time.sleep(0.1)
    processes.clear()


def end_owner(root: Path) -> None:
    """Stop the process that holds the experiment, as the refusal advises."""
    owner = owner_of(root, NAME)
    if owner is None:  # the engine has ended by itself meanwhile
        return
    with suppress(psutil.NoSuchProcess):
        process = psutil.Process(owner.pid)
        process.terminate()
        wait_for([process])


def kill_stages(
    root: Path, jobs: list[Job], expected: dict[str, str], kills: int, rng: random.Random
) -> Tally:
    """Kill every stage, with its results of before and without, and run it again to its end."""
    tally, log = Tally(), root / "stage.log"
    for stage, trials in jobs:

        def run_again(stage: str = stage, trials: tuple[int, ...] = trials) -> None:
            code = os.waitstatus_to_exitcode(os.waitpid(fork_job(root, stage, trials, log), 0)[1])
            tally.finished(root, expected, code, log.read_text(errors="replace"), f"{stage} to its end")

        began_s = time.monotonic()
        run_again()
        duration_s = time.monotonic() - began_s
        killed = 0
        for number in range(MOST_TRIES * kills):
            if killed == kills:
                break
            for path in outputs(root, stage, trials) if number % 2 else []:
                path.unlink()
            process = fork_job(root, stage, trials, log)
            time.sleep(rng.uniform(0.0, duration_s))
            with suppress(ProcessLookupError):
                os.killpg(process, signal.SIGKILL)
            ended = os.waitpid(process, 0)[1]
            killed += os.WIFSIGNALED(ended)
            tally["tried"] += os.WIFSIGNALED(ended)
            tally["had ended"] += not os.WIFSIGNALED(ended)
            tally.check(root, expected, log.read_text(errors="replace"), f"a kill of {stage}")
            run_again()
        print(f"{stage}: {dict(tally)}", flush=True)
    return tally


def main() -> None:
    """Kill runs and stages, print the counts, and end with 1 if anything was bad."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=100, help="kills of runs")
    parser.add_argument("--stages", type=int, default=20, help="kills of each stage")
    parser.add_argument(
        "--longest", type=float, default=12.0, help="time from a start to its kill, at most [s]"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--whole", type=Path, help="a project that has been run to its end")
    parser.add_argument("--of", help="of these stages only, e.g. ingest,score")
    chosen = parser.parse_args()
    rng = random.Random(chosen.seed)
    with tempfile.TemporaryDirectory(prefix="strandcast-kills-") as name:
        whole = Path(name) / "whole"
        if chosen.whole:
            shutil.copytree(chosen.whole, whole)
        else:
            make_whole(whole)
        expected = hashes(whole)
        jobs = [job for job in JOBS if chosen.stages and (not chosen.of or job[0] in chosen.of.split(","))]
        tallies = {
            "stages": kill_stages(whole, jobs, expected, chosen.stages, rng),
            "runs": kill_runs(Path(name), expected, chosen.runs, chosen.longest, rng),
        }
    for subject, tally in tallies.items():
        print(f"kills of {subject}: " + ", ".join(f"{count} {kind}" for kind, count in sorted(tally.items())))
    sys.exit(any(tally[kind] for tally in tallies.values() for kind in BAD))


if __name__ == "__main__":
    main()
