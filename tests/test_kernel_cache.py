"""Compiled kernels are cached by the code that they depend on, so that no update runs old machine code."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import strandcast

SETTINGS = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")


def cache_of(root, **environment: str) -> str:
    clean = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    line = [sys.executable, "-c", "import strandcast, os; print(os.environ['NUMBA_CACHE_DIR'])"]
    run = subprocess.run(line, cwd=root, env=clean | environment, capture_output=True, text=True, check=True)
    return run.stdout.strip()


def test_a_job_on_a_node_without_the_folder_of_the_login_node_has_one_of_its_own(tmp_path):
    home, node = tmp_path / "home", tmp_path / "node"
    for folder in (home, node):
        folder.mkdir()
    unmounted = tmp_path / "unmounted"
    unmounted.write_text("")  # no folder can be made in it, for root either
    inherited = {"HOME": str(home), "NUMBA_CACHE_DIR": str(unmounted / "kernels")}
    assert cache_of(tmp_path, **inherited).startswith(str(home))
    assert cache_of(tmp_path, **inherited, XDG_CACHE_HOME=str(node)).startswith(str(node))
    shared = {"HOME": str(home), "NUMBA_CACHE_DIR": str(tmp_path / "shared" / "kernels")}
    assert cache_of(tmp_path, **shared) == shared["NUMBA_CACHE_DIR"]


def test_an_edited_kernel_has_another_cache(tmp_path, project_root):
    shutil.copytree(project_root / "src" / "strandcast", tmp_path / "strandcast")
    home = {"HOME": str(tmp_path)}
    before = cache_of(tmp_path, **home)
    assert before.startswith(str(tmp_path))
    (tmp_path / "strandcast" / "cli" / "main.py").open("a").write(
        "\n_CHANGED = 1\n"
    )  # no kernel in this file
    assert cache_of(tmp_path, **home) == before
    (tmp_path / "strandcast" / "dynamics" / "elements.py").open("a").write("\n_CHANGED = 1\n")
    assert cache_of(tmp_path, **home) != before


def test_comments_and_docstrings_do_not_count(tmp_path, project_root):
    shutil.copytree(project_root / "src" / "strandcast", tmp_path / "strandcast")
    home = {"HOME": str(tmp_path)}
    before = cache_of(tmp_path, **home)
    kernel = tmp_path / "strandcast" / "dynamics" / "elements.py"
    kernel.write_text(kernel.read_text().replace('"""', '"""Another docstring. ', 1) + "\n# a comment\n")
    assert cache_of(tmp_path, **home) == before


def test_a_constant_that_a_kernel_imports_counts(tmp_path):
    package = tmp_path / "strandcast"
    package.mkdir()
    for name in ("__init__", "kernel_cache", "kernel_seed", "source_code", "user_cache"):
        shutil.copy(Path(strandcast.__file__).with_name(f"{name}.py"), package)
    (package / "kernel.py").write_text("from numba import njit\nfrom strandcast.numbers import WIDTH\n")
    (package / "numbers.py").write_text("WIDTH = 1\n")
    home = {"HOME": str(tmp_path)}
    before = cache_of(tmp_path, **home)
    (package / "numbers.py").write_text("WIDTH = 2\n")
    assert cache_of(tmp_path, **home) != before


def test_sources_are_read_only_after_one_was_written(tmp_path: Path, project_root: Path) -> None:
    shutil.copytree(project_root / "src" / "strandcast", tmp_path / "strandcast")
    clean = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    line = [sys.executable, "-c", "import sys, strandcast; print('strandcast.source_code' in sys.modules)"]

    def are_read() -> bool:
        environment = clean | {"HOME": str(tmp_path)}
        run = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        return run.stdout == "True\n"

    assert [are_read(), are_read()] == [True, False]
    kernel = tmp_path / "strandcast" / "planning" / "approach.py"
    kernel.write_text(kernel.read_text().replace("np.inf", "np.nan"))  # of the same size
    assert [are_read(), are_read()] == [True, False]


def test_a_damaged_cache_of_parsed_files_is_ignored(tmp_path, project_root):
    shutil.copytree(project_root / "src" / "strandcast", tmp_path / "strandcast")
    home = {"HOME": str(tmp_path)}
    before = cache_of(tmp_path, **home)
    (cache,) = (tmp_path / ".cache" / "strandcast").glob("source-code-*.json")
    (kept,) = (tmp_path / ".cache" / "strandcast").glob("kernels-of-*.txt")
    for file in (cache, kept):
        file.write_text("{")
    assert cache_of(tmp_path, **home) == before


def test_the_users_own_cache_is_respected(tmp_path):
    elsewhere = str(tmp_path / "elsewhere")
    assert cache_of(tmp_path, NUMBA_CACHE_DIR=elsewhere) == elsewhere


def test_without_a_home_one_folder_of_this_users_own_is_used(tmp_path):
    """With a folder per process, every process would compile again, and its folder would stay."""
    nowhere = {"HOME": "/dev/null/home", "TMPDIR": str(tmp_path)}
    first, second = cache_of(tmp_path, **nowhere), cache_of(tmp_path, **nowhere)
    assert first == second
    (own,) = tmp_path.iterdir()
    assert first.startswith(f"{own}/")
    assert own.stat().st_mode & 0o777 == 0o700
    own.chmod(0o777)  # anyone could put code there
    assert not cache_of(tmp_path, **nowhere).startswith(f"{own}/")


USE = """
import numpy as np
from strandcast.planning.approach import _closest_approaches as kernel, closest_approaches
closest_approaches(np.zeros((1, 3, 2)), np.array([2]), np.ones(2))
print(sum(kernel.stats.cache_hits.values()), sum(kernel.stats.cache_misses.values()))
"""


@pytest.mark.parametrize(
    "own", [{}, pytest.param({"NUMBA_CACHE_DIR": "kernels"}, marks=pytest.mark.thorough)]
)
def test_a_clone_elsewhere_with_other_comments_runs_the_same_machine_code(tmp_path, project_root, own):
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CACHE")}
    clean = {name: value for name, value in kept.items() if name not in SETTINGS} | own

    def hits_and_misses(folder: str) -> str:
        line = [sys.executable, "-c", USE]
        environment = clean | {"HOME": str(tmp_path), "PYTHONPATH": str(tmp_path / folder)}
        done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    shutil.copytree(project_root / "src" / "strandcast", tmp_path / "first" / "strandcast")
    assert hits_and_misses("first") == "0 1"
    (tmp_path / "first").rename(tmp_path / "second")
    kernel = tmp_path / "second" / "strandcast" / "planning" / "approach.py"
    kernel.write_text("# A comment that moves every line.\n" + kernel.read_text())
    assert hits_and_misses("second") == "1 0"
    kernel.write_text(kernel.read_text().replace("min(1.0, max(0.0, along", "min(0.5, max(0.0, along"))
    assert hits_and_misses("second") == "0 1"
