"""The whole way, run for real on a small lab experiment: results, re-runs, settings, exclusions, bytes."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from strandcast.records.files import sha256_file
from strandcast.records.summary import Summary

TINY = """\
title: A small throw
string: {length_m: 0.30, weights: [{place_m: 0.30}]}
target_m: [0.50, 0.50]
hit_radius_m: 0.02
max_trials: 1
seed: 3
workspace_m: {x_m: [-0.75, 1.25], y_m: [-0.32, 0.80]}
camera:
  plane:
    markers:
      - {id: 0, x_m: -0.65, y_m: 0.70}
      - {id: 2, x_m: 1.15, y_m: 0.70}
      - {id: 3, x_m: -0.65, y_m: -0.22}
      - {id: 5, x_m: 1.15, y_m: -0.22}
estimate: {evaluations: 400, ensemble: 3}
plan: {screening: 64, evaluations: 160, ensemble: 2}
lab:
  noise: 0.5
  camera: {frame_rate_hz: 250}
"""


def project(folder: Path, source: Path) -> Path:
    """Return a project's root with the tiny experiment alone."""
    shutil.copy(source / "Snakefile", folder)
    shutil.copytree(source / "workflow", folder / "workflow")
    shutil.copytree(source / "config" / "arms", folder / "config" / "arms")
    (folder / "config" / "experiments").mkdir()
    (folder / "config" / "experiments" / "tiny.yaml").write_text(TINY)
    return folder


def snakemake(root: Path, *arguments: str, cores: int = 2) -> subprocess.CompletedProcess:
    line = [sys.executable, "-m", "snakemake", *arguments, "--cores", str(cores)]
    line += ["--workflow-profile", "workflow/profiles/default"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SNAKEMAKE")}
    return subprocess.run(line, cwd=root, capture_output=True, text=True, check=False, env=environment)


def jobs(run: subprocess.CompletedProcess) -> set[str]:
    """Return the names of the rules that a dry run would run, from its table of counts."""
    rows = [line.split() for line in (run.stdout + run.stderr).splitlines()]
    return {row[0] for row in rows if len(row) == 2 and row[1].isdigit() and row[0] != "total"}


def dry(root: Path, edit: tuple[str, str] = ("", "")) -> set[str]:
    """Return what would run again after an edit of the experiment's file; the edit is undone."""
    path = root / "config" / "experiments" / "tiny.yaml"
    assert edit[0] in TINY
    path.write_text(TINY.replace(*edit) if edit[0] else TINY)
    run = snakemake(root, "results/tiny/report.html", "--dry-run")
    path.write_text(TINY)
    assert run.returncode == 0, run.stderr
    return jobs(run)


@pytest.fixture(scope="module")
def thrown(tmp_path_factory, project_root) -> Path:
    root = project(tmp_path_factory.mktemp("thrown"), project_root)
    run = snakemake(root, "results/tiny/report.html")
    assert run.returncode == 0, run.stderr[-4000:]
    return root


def test_every_stage_left_its_files(thrown):
    trial = thrown / "results" / "tiny" / "trial-01"
    wanted = ["motion.json", "manifest.json", "track.parquet", "markers.parquet", "track.json", "strobe.webp"]
    wanted += ["alignment.json", "hand.parquet", "verdict.json", "estimate.json", "ensemble.parquet"]
    wanted += ["simulated.parquet", "lab_truth.parquet", "report.html"]
    assert [name for name in wanted if not (trial / name).stat().st_size] == []
    assert (thrown / "results/tiny/trial-02/motion.json").is_file()


def test_the_summary_holds_the_figures(thrown):
    summary = Summary.read(thrown / "results" / "tiny" / "summary.json")
    assert summary.target_m == [0.5, 0.5]
    assert summary.hit_radius_m == 0.02
    (trial,) = summary.trials
    truth = json.loads((thrown / "results/tiny/trial-01/alignment.json").read_text())
    assert trial.alignment_offset_s == truth["offset_s"]
    assert trial.tracked_fraction > 0.5
    assert 0 < trial.E_m < 0.03


def test_nothing_runs_again_without_a_change(thrown):
    assert dry(thrown) == set()


def test_a_changed_setting_runs_only_what_depends_on_it(thrown):
    search = dry(thrown, ("evaluations: 400", "evaluations: 500"))
    assert search == {"estimate", "plan", "report_trial", "report_experiment"}
    clocks = dry(thrown, ("plan:", "align: {drift_prior: 1.0e-4}\nplan:"))
    assert {"align", "judge"} <= clocks
    assert not clocks & {"setup", "calibrate", "ingest", "track", "throw"}
    title = dry(thrown, ("A small throw", "Another title"))
    assert title == {"report_trial", "report_experiment"}


def test_one_stage_of_one_trial_can_be_asked_for(thrown):
    verdict = thrown / "results" / "tiny" / "trial-01" / "verdict.json"
    before = verdict.read_bytes()
    verdict.unlink()
    run = snakemake(thrown, "results/tiny/trial-01/verdict.json")
    assert run.returncode == 0, run.stderr
    assert verdict.read_bytes() == before


def test_an_excluded_trial_shows_its_reason(thrown):
    path = thrown / "config" / "experiments" / "tiny.yaml"
    path.write_text(TINY + "excluded: [{trial: 1, reason: the string <slipped>}]\n")
    run = snakemake(thrown, "results/tiny/report.html")
    path.write_text(TINY)
    assert run.returncode == 0, run.stderr
    assert "the string &lt;slipped&gt;" in (thrown / "results/tiny/report.html").read_text()
    assert "the string &lt;slipped&gt;" in (thrown / "results/tiny/trial-01/report.html").read_text()
    summary = Summary.read(thrown / "results" / "tiny" / "summary.json")
    assert summary.trials[0].excluded == "the string <slipped>"
    assert summary.hit_trial is None


def test_recordings_of_a_real_rig_give_a_report_and_the_next_motion(thrown):
    shutil.copytree(thrown / "data" / "tiny", thrown / "data" / "rig")
    (thrown / "data" / "rig" / "experiment.yaml").write_text(TINY[: TINY.index("lab:")])
    run = snakemake(thrown, "results/rig/report.html")
    assert run.returncode == 0, run.stderr[-3000:]
    results = thrown / "results" / "rig"
    assert len(Summary.read(results / "summary.json").trials) == 1
    assert (results / "trial-02" / "motion.json").is_file()
    # What was played is never planned again.
    played = (thrown / "data" / "rig" / "trial-01" / "motion.json").read_bytes()
    assert (results / "trial-01" / "motion.json").read_bytes() == played
    shutil.rmtree(thrown / "data" / "rig")
    shutil.rmtree(results)


def test_a_bad_setting_is_told_before_any_job_starts(tmp_path, project_root):
    root = project(tmp_path, project_root)
    path = root / "config" / "experiments" / "tiny.yaml"
    path.write_text(TINY.replace("length_m: 0.30,", "length_m: 300,").replace("seed:", "sede:"))
    run = snakemake(root, "results/tiny/report.html")
    assert run.returncode == 2
    assert "tiny.yaml:2: string.length_m" in run.stderr
    assert "did you mean 'seed'?" in run.stderr
    assert "Traceback" not in run.stderr
    assert not (root / "results").exists() or not list((root / "results").rglob("*.json"))


def test_a_failed_stage_names_stage_file_and_fix(thrown):
    video = thrown / "data" / "tiny" / "trial-01" / "video.mp4"
    whole = video.read_bytes()
    video.write_bytes(whole[: len(whole) // 2])
    run = snakemake(thrown, "results/tiny/trial-01/manifest.json", "--forcerun", "ingest")
    video.write_bytes(whole)
    assert run.returncode == 1
    assert "video.mp4" in run.stderr
    assert "Fix:" in run.stderr
    assert "Error in rule ingest" in run.stderr
    assert snakemake(thrown, "results/tiny/report.html").returncode == 0


def contents(root: Path) -> dict[str, str]:
    """Return the hash of every raw file and result, but the logs."""
    files = [path for top in ("data", "results") for path in (root / top).rglob("*") if path.is_file()]
    return {str(path.relative_to(root)): sha256_file(path) for path in files if "logs" not in path.parts}


def test_the_same_seeds_give_the_same_bytes_on_one_core_and_on_two(thrown, tmp_path, project_root):
    again = project(tmp_path, project_root)
    run = snakemake(again, "results/tiny/report.html", cores=1)
    assert run.returncode == 0, run.stderr[-4000:]
    first, second = contents(thrown), contents(again)
    assert {name for name in first | second if first.get(name) != second.get(name)} == set()
    assert len(first) > 25
    assert hashlib.sha256(b"").hexdigest() not in first.values()
