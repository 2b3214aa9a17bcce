"""Row 54 of the fault list: compiled kernels read no index out of range.

numba checks no index: a wrong one reads some number, or ends the process. Here the kernels are compiled with
its checks, and the tests that use them must still pass. Loads of SIMD vectors, which are instructions of our
own, are not checked.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

KERNELS = (
    "dynamics/test_simulate.py",
    "estimation/test_evaluation.py",
    "planning/test_assessment.py",
    "planning/test_paths.py",
    "tracking/test_profiles.py",
    "tracking/test_tip.py",
)
BEYOND = """
import numpy as np
from numba import njit
assert njit(lambda a, k: a[k])(np.zeros(4), 3) == 0
njit(lambda a, k: a[k])(np.zeros(4), 10)
"""


@pytest.mark.skipif(
    "STRANDCAST_BOUNDS" not in os.environ, reason="compiles all kernels again: set STRANDCAST_BOUNDS"
)
def test_row54_no_index_is_out_of_range(tmp_path: Path, project_root: Path) -> None:
    checked = dict(os.environ, NUMBA_BOUNDSCHECK="1", NUMBA_CACHE_DIR=str(tmp_path))
    beyond = subprocess.run([sys.executable, "-c", BEYOND], env=checked, capture_output=True, check=False)
    assert b"IndexError: index is out of bounds" in beyond.stderr
    tests = [str(project_root / "tests" / file) for file in KERNELS]
    line = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:xdist", *tests]
    done = subprocess.run(line, cwd=project_root, env=checked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
