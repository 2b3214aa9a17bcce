"""One small lab experiment, cheap enough to be made hundreds of times: its jobs, its files, their hashes."""

import importlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.forked import run_and_exit

from strandcast.records.files import sha256_file
from strandcast.stages.run import files_of
from strandcast.workflow.verify import verify

PROJECT = Path(__file__).resolve().parents[2]
NAME = "small"
SETTINGS = """\
title: A small throw
string: {length_m: 0.30, weights: [{place_m: 0.30}]}
target_m: [0.50, 0.50]
hit_radius_m: 0.02
max_trials: 1
seed: 3
workspace_m: {x_m: [-0.75, 1.25], y_m: [-0.32, 0.80]}
camera:
  plane:
    markers:
      - {id: 0, x_m: -0.65, y_m: 0.70}
      - {id: 2, x_m: 1.15, y_m: 0.70}
      - {id: 3, x_m: -0.65, y_m: -0.22}
      - {id: 5, x_m: 1.15, y_m: -0.22}
estimate: {evaluations: 100, profiles: false}
plan: {evaluations: 16}
lab:
  noise: 0.5
  camera: {size_px: [640, 360], frame_rate_hz: 100}
"""
WATCH = PROJECT / "tests" / "workflow" / "watch"  # notes the files that stages open in a list
OPENED = "opened.txt"
REAL = SETTINGS[: SETTINGS.index("lab:")]  # of an experiment with recordings of the small one
PUBLIC = ("track", "estimate", "plan", "report")  # stages that are commands of their own
# Runs stages one after the other in one process: [stage, experiment, trial, trials of a summary].
STAGES = """
import json, sys
from pathlib import Path
from strandcast.stages.run import run_stage
for stage, *arguments in json.loads(sys.argv[1]):
    run_stage(stage, Path(), *arguments)
"""
Job = tuple[str, tuple[int, ...]]  # stage and trials
# All jobs of the workflow, in an order that the rules allow.
JOBS: tuple[Job, ...] = (
    ("lab_calibrate", ()),
    ("calibrate", ()),
    ("lab_rehearse", ()),
    ("plan", (1,)),
    ("lab_throw", (1,)),
    ("ingest", (1,)),
    ("track", (1,)),
    ("reconstruct", (1,)),
    ("align", (1,)),
    ("score", (1,)),
    ("estimate", (1,)),
    ("plan", (2,)),
    ("report", (1,)),
    ("summary", (1,)),
)


def make_project(folder: Path) -> Path:
    """Make a project's root with the small experiment alone, and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(PROJECT / "Snakefile", folder)
    shutil.copytree(PROJECT / "workflow", folder / "workflow")
    shutil.copytree(PROJECT / "config" / "arms", folder / "config" / "arms")
    (folder / "config" / "experiments").mkdir()
    (folder / "config" / "experiments" / f"{NAME}.yaml").write_text(SETTINGS)
    return folder


def arguments(stage: str, trials: tuple[int, ...]) -> list[str]:
    """Return the arguments of `strandcast` that run a job."""
    inner = () if stage in PUBLIC else ("stage",)
    return [*inner, stage.replace("_", "-"), NAME, *map(str, trials)]


def environment(**variables: str) -> dict[str, str]:
    """Return the environment of a command that runs this checkout, without its settings of libraries."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("SNAKEMAKE", "STRANDCAST", "OPENBLAS", "OMP", "MKL"))
    }
    return kept | {"PYTHONPATH": str(PROJECT / "src")} | variables


def run_stages(root: Path, jobs: list[list[object]]) -> None:
    """Run stages: each job is a stage, an experiment, and perhaps its trial and the trials of a summary."""
    line = [sys.executable, "-c", STAGES, json.dumps(jobs)]
    subprocess.run(line, cwd=root, env=environment(), check=True, capture_output=True)


def result_hashes(root: Path) -> dict[str, str]:
    """Return the hashes of all results by their places, but not of logs, kept motions and hidden files."""
    files = [path.relative_to(root) for path in (root / "results").rglob("*") if path.is_file()]
    wanted = [path for path in files if not {"logs", "motions"} & {*path.parts} and path.name[0] != "."]
    return {path.as_posix(): sha256_file(root / path) for path in wanted if path.parent.name != "results"}


def make_whole(root: Path) -> None:
    """Make a project and run its experiment to the end; the files that its stages open are listed."""
    make_project(root)
    line = [sys.executable, "-m", "strandcast", "run", NAME, "--cores", "2"]
    watched = f"{WATCH}{os.pathsep}{PROJECT / 'src'}"
    variables = environment(PYTHONPATH=watched, STRANDCAST_OPENED_FILES=str(root / OPENED))
    done = subprocess.run(line, cwd=root, env=variables, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]


def outputs(root: Path, stage: str, trials: tuple[int, ...]) -> list[Path]:
    """Return the files that a job writes."""
    of_all = stage == "summary"
    files = files_of(stage, root, NAME, 0 if of_all else sum(trials), trials if of_all else ())
    return files.all_outputs()


def fork_job(
    root: Path, stage: str, trials: tuple[int, ...], output: Path, first: Callable[[], None] = lambda: None
) -> int:
    """Run a job as `strandcast` does, in a fork of this process; return its process id.

    A fork has the libraries loaded, so that a job takes no longer than its work. This process must not have
    run compiled kernels: their threads do not survive a fork. `first` is called in the fork.
    """
    from strandcast.cli.main import main

    importlib.import_module(f"strandcast.stages.{stage}")
    if pid := os.fork():
        return pid

    def job() -> None:
        os.setsid()
        os.chdir(root)
        sys.argv = ["strandcast", *arguments(stage, trials)]
        with output.open("wb") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        first()
        main()

    run_and_exit(job)


def hashes(root: Path) -> dict[str, str]:
    """Return the hash of each of the experiment's files by its place, but not of logs and hidden files."""
    files = (path for top in ("data", "results") for path in (root / top / NAME).rglob("*") if path.is_file())
    wanted = (path for path in files if "logs" not in path.parts and not path.name.startswith("."))
    return {path.relative_to(root).as_posix(): sha256_file(path) for path in wanted}


def differences(root: Path, expected: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Yield each file that is there with other bytes than expected: "wrong" or "unreadable", and its name."""
    changed = {name for name, sha in hashes(root).items() if expected.get(name) != sha}
    if changed:
        damaged = {
            found.file.relative_to(root).as_posix()
            for found in verify(root, NAME)
            if found.state == "damaged"
        }
        yield from (("unreadable" if name in damaged else "wrong", name) for name in sorted(changed))


def hidden_files(root: Path) -> list[str]:
    """Return the places of the hidden files among raw files and results."""
    files = (path for top in ("data", "results") for path in (root / top).rglob(".*") if path.is_file())
    return sorted(path.relative_to(root).as_posix() for path in files)
