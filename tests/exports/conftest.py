"""A project with one small lab experiment, run through once."""

from pathlib import Path

import pytest

import strandcast
from strandcast.api import TrialView


@pytest.fixture(scope="session")
def project(finished) -> Path:
    return finished


@pytest.fixture
def trial(project) -> TrialView:
    return strandcast.open(project)["small"].trials[1]
