"""Every door gives the same bytes: the rules, the commands and Python, whatever the shell sets for libraries,
language and time (row 95 of the fault list)."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from .small import JOBS, NAME, arguments, environment, hashes, make_project

pytestmark = pytest.mark.slow

# Kernels of BLAS for an old processor, and more threads than there are cores.
HOSTILE = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "OPENBLAS_NUM_THREADS": "2",
    "MKL_NUM_THREADS": "4",
    "OMP_NUM_THREADS": "3",
}
# Decimal commas, another letter i and 8 bits; 12:45 h ahead, with summer time.
LOCALE = "tr_TR.ISO-8859-9"
CHATHAM = "XXX-12:45YYY,M9.5.0/2:45,M4.1.0/3:45"
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


def by_rules(root: Path) -> None:
    run(root, ["-m", "strandcast", "run", NAME, "--cores", "2"])


def by_commands_on_one_core(root: Path) -> None:
    variables = hostile(root.parent)
    for stage, trials in JOBS:
        run(root, ["-m", "strandcast", *arguments(stage, trials)], first_core=True, **variables)


def in_python(root: Path) -> None:
    run(root, ["-c", IN_PYTHON.format(jobs=JOBS, name=NAME)], **hostile(root.parent))


@pytest.fixture(scope="module")
def expected(tmp_path_factory) -> dict[str, str]:
    root = make_project(tmp_path_factory.mktemp("rules"))
    by_rules(root)
    return hashes(root)


@pytest.mark.parametrize("door", [by_commands_on_one_core, in_python])
def test_every_door_gives_the_same_bytes(
    door: Callable[[Path], None], expected: dict[str, str], tmp_path: Path
) -> None:
    root = make_project(tmp_path / "project")
    door(root)
    found = hashes(root)
    assert {name for name in found | expected if found.get(name) != expected.get(name)} == set()
    assert len(found) == 37
