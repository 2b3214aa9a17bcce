"""One small experiment gives the same bytes through every door, after kills, and after refused file calls.

Row 95 of the fault list: also where the shell sets libraries, language and time.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from strandcast.kernels_ahead import SIGNATURES

from .small import JOBS, NAME, PROJECT, arguments, environment, hashes, make_project

pytestmark = pytest.mark.thorough

# Kernels of BLAS for an old processor, and more threads than there are cores.
HOSTILE = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "OPENBLAS_NUM_THREADS": "2",
    "MKL_NUM_THREADS": "4",
    "OMP_NUM_THREADS": "3",
}
# Decimal commas, another letter i and 8 bits; 12:45 h ahead, with summer time.
LOCALE = "tr_TR.ISO-8859-9"
CHATHAM = "CHAST-12:45CHADT,M9.5.0/2:45,M4.1.0/3:45"
IN_PYTHON = """
import sys
from pathlib import Path
from strandcast.stages.run import run_stage
for stage, trials in {jobs}:
    job = (0, trials) if stage == "summary" else trials
    run_stage(stage, Path(), "{name}", *job)
"""


def run(root: Path, line: list[str], first_core: bool = False, **variables: str) -> None:
    """Run a Python command, on one core if that is asked for."""
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
    try:
        if first_core and cores:
            os.sched_setaffinity(0, {min(cores)})  # inherited
        done = subprocess.run(
            [sys.executable, *line],
            cwd=root,
            env=environment(**variables),
            capture_output=True,
            text=True,
            errors="replace",  # a hostile locale's ± is no UTF-8
            check=False,
        )
    finally:
        if cores:
            os.sched_setaffinity(0, cores)
    assert done.returncode == 0, done.stderr[-4000:]


def hostile(folder: Path) -> dict[str, str]:
    """Return what a shell may set; the locale is made in a folder."""
    language, _, charset = LOCALE.partition(".")
    if shutil.which("localedef"):
        line = ["localedef", "-i", language, "-f", charset, str(folder / LOCALE)]
        subprocess.run(line, capture_output=True, check=False)
    return HOSTILE | {"LOCPATH": str(folder), "LC_ALL": LOCALE, "TZ": CHATHAM}


def by_commands_on_one_core(root: Path) -> None:
    variables = hostile(root.parent)
    for stage, trials in JOBS:
        run(root, ["-m", "strandcast", *arguments(stage, trials)], first_core=True, **variables)


def in_python(root: Path) -> None:
    run(root, ["-c", IN_PYTHON.format(jobs=JOBS, name=NAME)], **hostile(root.parent))


@pytest.mark.parametrize("door", [by_commands_on_one_core, in_python])
def test_every_door_gives_the_same_bytes(
    door: Callable[[Path], None], finished: Path, tmp_path: Path
) -> None:
    root = make_project(tmp_path / "project")
    door(root)
    found, expected = hashes(root), hashes(finished)
    assert {name for name in found | expected if found.get(name) != expected.get(name)} == set()
    assert len(found) == 44 + len(JOBS)  # each leaves a note


def counted(whole: Path, *line: str) -> str:
    """Return what a module of faults prints at its end: its counts."""
    line = ("-m", f"tests.faults.{line[0]}", "--whole", str(whole), *line[1:])
    done = subprocess.run(
        [sys.executable, *line], cwd=PROJECT, env=environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


def test_killed_runs_and_stages_go_on_to_the_same_bytes(finished: Path) -> None:
    said = counted(finished, "kills", "--runs", "3", "--stages", "2", "--of", "ingest,score,report")
    assert "kills of runs: " in said
    assert " 3 tried" in said


@pytest.mark.skipif(shutil.which("cc") is None or sys.platform != "linux", reason="needs cc, and Linux")
def test_a_refused_system_call_ends_in_an_error_code_and_leaves_no_part_of_a_file(finished: Path) -> None:
    said = counted(finished, "refused_calls", "--sample", "16", "--stages", "ingest,reconstruct,score,report")
    assert "refused calls: " in said
    assert "16 tried" in said


def test_the_kernels_that_stages_call_can_be_compiled_ahead(finished: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(finished, tmp_path / "project"))
    line = [sys.executable, "-m", "strandcast_studies.kernel_signatures", NAME]
    done = subprocess.run(line, cwd=root, env=environment(), capture_output=True, text=True, check=True)
    called, known = json.loads(done.stdout), json.loads(SIGNATURES.read_text())
    unknown = {name: [kinds for kinds in called[name] if kinds not in known.get(name, ())] for name in called}
    assert {name: kinds for name, kinds in unknown.items() if kinds} == {}  # else: see kernel_signatures.py
    assert "strandcast.tracking.chain.fit:fit_frame" in called
    run(root, ["-m", "strandcast.kernels_ahead"])
