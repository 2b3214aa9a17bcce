"""A project with one small lab experiment, run through once."""

import shutil
from pathlib import Path

import pytest
from tests.faults.small import JOBS, SETTINGS

import strandcast
from strandcast.api import TrialView
from strandcast.stages.run import run_stage


@pytest.fixture(scope="session")
def project(tmp_path_factory, project_root) -> Path:
    root = tmp_path_factory.mktemp("project") / "mylab"
    shutil.copytree(project_root / "config" / "arms", root / "config" / "arms")
    (root / "config" / "experiments").mkdir()
    (root / "config" / "experiments" / "demo.yaml").write_text(SETTINGS)
    for stage, trials in JOBS[:-2]:  # without the pages
        run_stage(stage, root, "demo", sum(trials))
    return root


@pytest.fixture
def trial(project) -> TrialView:
    return strandcast.open(project)["demo"].trials[1]
