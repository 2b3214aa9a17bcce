"""`make paper` end to end: a failed run is reported with its reason, and the page is written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from strandcast_studies.paper.cases import FILE
from strandcast_studies.paper.records import PaperSummary

REACHED, FAR = "target_m: [0.75, 0.30]", "target_m: [1.15, 0.70]"
NAME = "paper-quick-string3-target2-seed101-default"


def strandcast(root: Path, *words: str) -> subprocess.CompletedProcess:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SNAKEMAKE")}
    line = [sys.executable, "-m", "strandcast_studies.paper", *words]
    return subprocess.run(line, cwd=root, capture_output=True, text=True, check=False, env=environment)


@pytest.mark.thorough
def test_a_failed_run_is_shown_with_its_reason(tmp_path, project_root):
    shutil.copy(project_root / "Snakefile", tmp_path)
    shutil.copytree(project_root / "workflow", tmp_path / "workflow")
    shutil.copytree(project_root / "config" / "arms", tmp_path / "config" / "arms")
    text = (project_root / FILE).read_text()
    assert REACHED in text
    (tmp_path / FILE).write_text(text.replace(REACHED, FAR))
    done = strandcast(tmp_path, "run", "--quick", "--strings", "3", "--methods", "default", "--cores", "2")
    assert done.returncode == 1, done.stderr[-3000:]
    assert f"{NAME}: no hit" in done.stdout
    folder = tmp_path / "results" / "paper-quick"
    (run,) = PaperSummary.read(folder / "summary.json").experiments
    assert (run.experiment, run.state, run.hit_trial, run.trials) == (NAME, "failed", None, [])
    assert run.reason.startswith("trial-01 plan: SC-P002 ERROR")
    assert "SC-P002" in (folder / "report.html").read_text()
