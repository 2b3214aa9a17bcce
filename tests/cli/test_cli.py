"""The command line: one clear message and the right exit code; each command imports only what it needs."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from strandcast.cli.stages import stage_commands
from strandcast.stages.declarations import STAGES

pytestmark = pytest.mark.slow


@pytest.fixture
def root(tmp_path, project_root) -> Path:
    shutil.copytree(project_root / "config", tmp_path / "config")
    return tmp_path


def strandcast(root: Path, *arguments: str) -> subprocess.CompletedProcess:
    line = [sys.executable, "-m", "strandcast", *arguments]
    return subprocess.run(line, cwd=root, capture_output=True, text=True, check=False, env=dict(os.environ))


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["check", "dmeo"], 2, "did you mean 'demo'?"),
        (["estimate", "demo", "1"], 4, "track.parquet"),
        (["ingest", "demo", "1"], 2, "expected one video.* file"),
        (["lab-throw", "demo", "1"], 2, "motion.json"),
        (["check", "../x"], 2, "is not a valid name of an experiment"),
        (["run", "demo"], 3, "there is no workflow/Snakefile here"),
        (["play", "nothing.json", "--arm", "config/arms/planar3.toml", "--out", "x"], 2, "nothing.json"),
        (["import", "joints", "demo", "1", "nothing.csv"], 4, "nothing.csv"),
        (["estimate", "demo", "0"], 2, "TRIAL"),
    ],
)
def test_a_users_error_is_one_message(root, arguments, code, words):
    run = strandcast(root, *arguments)
    assert run.returncode == code, run.stderr
    assert words in run.stderr
    assert "Traceback" not in run.stderr
    assert "Fix:" in run.stderr or "Usage:" in run.stderr


def test_check_and_schema(root):
    assert "arm planar3" in strandcast(root, "check", "demo").stdout
    assert strandcast(root, "schema").stdout == (root / "config" / "experiment.schema.json").read_text()


def test_every_declared_stage_has_a_command():
    assert {name.replace("-", "_") for name in stage_commands()} | {"summary"} == set(STAGES)


def test_a_renamed_setting_is_one_warning(root):
    path = root / "config" / "experiments" / "demo.yaml"
    path.write_text(path.read_text() + "track: {hand: marker}\n")
    run = strandcast(root, "check", "demo")
    assert run.returncode == 0
    assert run.stderr.startswith("warning: config/experiments/demo.yaml:")
    assert "track.hand is now called track.tracker" in run.stderr
    assert len(run.stderr.splitlines()) == 1


def test_boards_are_printed_at_true_size(root):
    run = strandcast(root, "boards", "demo")
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == [
        "results/demo/boards/lens-board.pdf",
        "results/demo/boards/plane-markers.pdf",
        "results/demo/boards/hand-markers-50mm.pdf",
    ]
    assert all((root / file).read_bytes().startswith(b"%PDF") for file in run.stdout.split())


@pytest.mark.parametrize(
    ("stage", "forbidden"),
    [
        ("score", {"cv2", "numba", "scipy", "pandas", "matplotlib", "mujoco", "av", "skimage"}),
        ("register_track", {"cv2", "numba", "scipy", "pandas", "matplotlib", "mujoco", "av", "skimage"}),
        ("ingest", {"cv2", "numba", "scipy", "pandas", "matplotlib", "mujoco", "skimage"}),
        ("track", {"pandas", "matplotlib"}),
        ("align", {"cv2", "pandas", "matplotlib", "av"}),
        ("estimate", {"cv2", "pandas", "av", "skimage"}),
        ("plan", {"cv2", "pandas", "av", "skimage"}),
        ("report", {"pandas", "av", "cma", "skimage"}),
    ],
)
def test_a_stage_imports_only_what_it_needs(stage, forbidden):
    code = f"import sys, strandcast.stages.{stage}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) & forbidden == set()
