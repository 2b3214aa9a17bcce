"""A stage's fingerprint moves with its own code and settings, and with nothing else."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest

from strandcast.experiment import load_experiment
from strandcast.stages import depends


@pytest.fixture
def version_of(tmp_path, project_root):
    """Return a function: the code version of a stage after an edit in a copy of the package."""
    shutil.copytree(project_root / "src" / "strandcast", tmp_path / "strandcast")

    def version(stage: str, file: str | None = None, old: str = "", new: str = "") -> str:
        if file:
            path = tmp_path / "strandcast" / file
            text = path.read_text()
            assert old in text
            path.write_text(text.replace(old, new, 1))
        line = f"from strandcast.stages.depends import code_version as v; print(v({stage!r}))"
        out = subprocess.run(
            [sys.executable, "-c", line], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return out.stdout.strip()

    return version


def test_an_edit_in_an_imported_room_counts_and_a_comment_does_not(version_of):
    before = version_of("judge")
    assert version_of("judge", "verdict/judge.py", '"""', '"""A different docstring. ') == before
    assert version_of("judge", "verdict/judge.py", "\nimport", "\n# a comment\nimport") == before
    assert version_of("judge", "verdict/judge.py", "def ", "_CHANGED = 1\n\n\ndef ") != before


def test_an_edit_in_another_room_does_not_count(version_of):
    before = version_of("judge")
    after = version_of("judge", "camera/mapping.py", "def ", "_CHANGED = 1\n\n\ndef ")
    assert after == before
    assert version_of("calibrate") != before


def test_every_stage_lists_settings_that_exist(project_root):
    experiment = load_experiment(project_root / "config/experiments/demo.yaml")
    for stage in depends.SETTINGS:
        assert depends.settings(experiment, stage).startswith("{")
        assert len(depends.code_version(stage)) == 16


def test_settings_move_only_what_reads_them(project_root):
    experiment = load_experiment(project_root / "config/experiments/demo.yaml")
    other = experiment.model_copy(update={"hit_radius_m": 0.01})
    moved = {s for s in depends.SETTINGS if depends.settings(experiment, s) != depends.settings(other, s)}
    assert moved == {"judge", "plan", "report", "summary"}
