"""The code version and the settings of a stage change with its own code and settings only."""

import shutil
import subprocess
import sys
from dataclasses import replace
from typing import Any

import pytest

from strandcast.records.folders import ExperimentFolder
from strandcast.stages.code_version import code_version, settings
from strandcast.stages.context import Context, context_of
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Job


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
        line = f"from strandcast.stages.code_version import code_version as v; print(v({stage!r}))"
        out = subprocess.run(
            [sys.executable, "-c", line], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return out.stdout.strip()

    return version


def test_an_edit_in_an_imported_room_counts_and_a_comment_does_not(version_of):
    before = version_of("score")
    assert version_of("score", "scoring/score.py", '"""', '"""A different docstring. ') == before
    assert version_of("score", "scoring/score.py", "\nimport", "\n# a comment\nimport") == before
    assert version_of("score", "scoring/score.py", "def ", "_CHANGED = 1\n\n\ndef ") != before


def test_the_description_of_a_setting_does_not_count_and_its_default_does(version_of):
    before = version_of("score")
    assert version_of("score", "config/experiment.py", "Title of the report.", "The page's title.") == before
    assert version_of("score", "config/experiment.py", "    0.02,", "    0.03,") != before


def test_an_edit_in_another_room_does_not_count_and_one_of_a_pages_template_does(version_of):
    before = version_of("score")
    after = version_of("score", "camera/tilt.py", "def ", "_CHANGED = 1\n\n\ndef ")
    assert after == before
    report = version_of("report")
    assert report != before
    assert version_of("report", "report/templates/trial.html.jinja", "<", "\n<") != report


def test_every_stage_lists_settings_that_exist(project_root):
    job = Job(context_of(project_root, "demo"))
    for stage in STAGES:
        assert settings(job, stage).startswith("{")
        assert len(code_version(stage)) == 16


def test_a_changed_setting_changes_only_the_stages_that_read_it(project_root):
    assert changed_by(context_of(project_root, "demo"), hit_radius_m=0.01) == SCORED


SCORED = {"score", "lab_rehearse", "plan", "report", "summary"}


def changed_by(context: Context, **changes: Any) -> set[str]:
    """Return the stages that read one of the changed settings, for trial 1."""
    other = replace(context, settings=context.settings.model_copy(update=changes))
    jobs = Job(context, 1), Job(other, 1)
    return {stage for stage in STAGES if len({settings(job, stage) for job in jobs}) == 2}


def test_a_new_target_reads_no_film_again_of_a_throw_whose_motion_is_known(project_root, tmp_path):
    demo = context_of(project_root, "demo")
    mine = demo.settings.model_copy(update={"lab": None})
    context = replace(demo, settings=mine, folder=ExperimentFolder(tmp_path, "demo"))
    aimed = {"lab_calibrate", "lab_rehearse", "lab_throw", "lab_capture", "estimate"} | SCORED
    assert changed_by(context, target_m=(0.4, 0.6)) == {"track"} | aimed
    motion = context.folder.trial(1).data / "motion.json"
    motion.parent.mkdir(parents=True)
    motion.touch()
    assert changed_by(context, target_m=(0.4, 0.6)) == aimed
