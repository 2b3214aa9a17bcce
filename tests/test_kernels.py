"""Compiled kernels are kept by the content of all kernels, so that no update runs old machine code."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys


def cache_of(root, **environment: str) -> str:
    clean = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    line = [sys.executable, "-c", "import strandcast, os; print(os.environ['NUMBA_CACHE_DIR'])"]
    run = subprocess.run(line, cwd=root, env=clean | environment, capture_output=True, text=True, check=True)
    return run.stdout.strip()


def test_an_edited_kernel_has_another_cache(tmp_path, project_root):
    shutil.copytree(project_root / "src" / "strandcast", tmp_path / "strandcast")
    home = {"HOME": str(tmp_path)}
    before = cache_of(tmp_path, **home)
    assert before.startswith(str(tmp_path))
    (tmp_path / "strandcast" / "cli.py").open("a").write("\n# no kernel in here\n")
    assert cache_of(tmp_path, **home) == before
    (tmp_path / "strandcast" / "string" / "elements.py").open("a").write("\n# a kernel's file\n")
    assert cache_of(tmp_path, **home) != before


def test_the_users_own_cache_is_respected(tmp_path):
    assert cache_of(tmp_path, NUMBA_CACHE_DIR="/elsewhere") == "/elsewhere"
