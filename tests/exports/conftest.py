"""A project with one small lab experiment, run through once."""

import shutil
from pathlib import Path

import pytest

import strandcast
from strandcast.api import TrialView


@pytest.fixture(scope="session")
def project(finished, tmp_path_factory) -> Path:
    return Path(shutil.copytree(finished, tmp_path_factory.mktemp("project") / "mylab"))


@pytest.fixture
def trial(project) -> TrialView:
    return strandcast.open(project)["small"].trials[1]
