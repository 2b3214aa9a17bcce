"""Projects: made anywhere, found from their sub-folders, run by the workflow that is installed."""

import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from tests.forked import run_module

from strandcast.errors import StrandcastError
from strandcast.records.folders import WITHIN_WORKFLOW, project_root
from strandcast.workflow.project import make_project, shipped

FOREIGN = """\
from strandcast.workflow.project import shipped


module strandcast:
    snakefile:
        str(shipped() / "workflow" / "Snakefile")


use rule * from strandcast as strandcast_*


rule mine:
    default_target: True
    input:
        "results/demo/report.html",
    output:
        "mine.txt",
    shell:
        "cp {input} {output}"
"""


def run(folder: Path, *line: str) -> subprocess.CompletedProcess:
    outside = {name: value for name, value in os.environ.items() if name != WITHIN_WORKFLOW}
    return run_module(folder, *line, environment=outside)


@pytest.fixture
def lab(tmp_path) -> Path:
    make_project(tmp_path / "my lab")
    return tmp_path / "my lab"


@pytest.mark.parametrize("place", ["x", "x/deep/er", "café & co"])
def test_a_project_is_made_in_a_new_or_empty_folder(tmp_path, place):
    (tmp_path / "x").mkdir()
    files = make_project(tmp_path / place)
    assert len(files) == 18
    assert all(path.is_file() for path in files)
    assert (tmp_path / place / "data").is_dir()


def test_a_folder_with_files_and_a_file_are_left_alone(lab, tmp_path):
    before = {path: path.stat().st_mtime_ns for path in lab.rglob("*")}
    for place, what in ((lab, "is not empty"), (lab / "Snakefile", "is a file")):
        with pytest.raises(StrandcastError, match=what) as refused:
            make_project(place)
        assert refused.value.code == "SC-E005"
    assert {path: path.stat().st_mtime_ns for path in lab.rglob("*")} == before


def test_the_nearest_project_above_is_the_root(lab, monkeypatch):
    inner = lab / "results" / "inner"
    make_project(inner)
    for folder, root in (
        (lab, "."),
        (lab / "data", ".."),
        (inner, "."),
        (inner / "config" / "arms", "../.."),
    ):
        monkeypatch.chdir(folder)
        assert project_root() == Path(root)
    monkeypatch.setenv(WITHIN_WORKFLOW, "1")  # a job's folder is its root
    assert project_root() == Path()
    monkeypatch.delenv(WITHIN_WORKFLOW)
    monkeypatch.chdir(lab.parent)
    assert project_root() == Path()


def test_a_foreign_workflow_is_a_project_too(tmp_path, monkeypatch):
    for folder in ("workflow", "config", "data/string"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "workflow" / "Snakefile").touch()
    monkeypatch.chdir(tmp_path / "data" / "string")
    assert project_root() == Path("../..")


def test_commands_work_in_sub_folders_where_the_users_paths_count(lab):
    done = run(lab / "data", "strandcast", "boards", "demo", "--out", "boards")
    assert done.returncode == 0, done.stderr
    assert "boards/lens-board.pdf" in done.stdout
    assert (lab / "data" / "boards" / "lens-board.pdf").is_file()
    done = run(lab / "data", "strandcast", "boards", "demo")
    assert done.returncode == 0, done.stderr
    assert (lab / "results" / "demo" / "boards" / "lens-board.pdf").is_file()


def test_the_projects_snakefile_is_the_installed_workflow(lab):
    done = run(lab, "snakemake", "--dry-run", "--cores", "1")
    assert done.returncode == 0, done.stderr
    assert "report_experiment" in done.stderr + done.stdout


@pytest.mark.thorough
def test_another_workflow_takes_ours_as_a_module(lab):
    (lab / "Snakefile").write_text(FOREIGN)
    plan = run(lab, "snakemake", "--dry-run", "--cores", "1")
    assert plan.returncode == 0, plan.stderr
    assert "strandcast_report_experiment" in plan.stderr + plan.stdout
    done = run(lab, "snakemake", "--cores", "1", "--until", "strandcast_lab_calibrate")
    assert done.returncode == 0, done.stderr
    assert (lab / "data" / "demo" / "calibration" / "plane.png").is_file()


def test_the_wheel_holds_the_workflow_and_the_configuration(tmp_path, project_root):
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(tmp_path)]
    built = run(project_root, "pip", "wheel", *options, ".")
    assert built.returncode == 0, built.stderr
    (wheel,) = tmp_path.glob("*.whl")
    held = {name for name in zipfile.ZipFile(wheel).namelist() if not name.endswith(".pyc")}
    for folder in ("workflow", "config", "docs"):
        files = [path for path in (shipped() / folder).rglob("*") if path.is_file() and path.suffix != ".pyc"]
        assert {f"strandcast/shipped/{path.relative_to(shipped())}" for path in files} <= held
    assert "strandcast/workflow/template/Snakefile" in held
    assert not any("studies" in name for name in held)


def test_a_dry_run_that_fails_does_not_say_that_all_is_done(lab):
    trial = lab / "data" / "lost" / "trial-01"
    trial.mkdir(parents=True)
    shutil.copyfile(lab / "config" / "examples" / "ur5e.yaml", trial.parent / "experiment.yaml")
    (trial / "video.mp4").symlink_to(lab / "nowhere.mp4")
    listed = run(lab, "strandcast", "run", "lost", "--dry-run")
    assert listed.returncode != 0
    assert "video.mp4" in listed.stderr
    assert listed.stdout == ""
