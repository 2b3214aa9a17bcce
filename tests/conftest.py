"""Fixtures that all tests share."""

import os
from pathlib import Path

import pytest

# Small matrices: more threads only spin, and take the other core's time (the workflow's jobs have one too).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of real measured data; the test is skipped where there is none."""
    folder = os.environ.get("STRANDCAST_REAL_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("STRANDCAST_REAL_DATA names no folder: real measured data are not on this machine")
    return Path(folder)


@pytest.fixture(scope="session")
def project_root() -> Path:
    """Return the repository's root."""
    return ROOT
