"""The benchmark of a batch: where CPU time went, stages that do nothing, a thousand trials extrapolated."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from strandcast.camera.flat import flat_camera
from strandcast.camera.mapping import metre_to_pixel
from strandcast.core.trial_names import trial_name
from strandcast.workflow.project import make_project
from strandcast_studies.benchmarks.batch.accounts import spent_by
from strandcast_studies.benchmarks.batch.growth import scaled
from strandcast_studies.benchmarks.batch.project import python_without_stages, record, record_empty
from strandcast_studies.benchmarks.batch.run import Size, against_targets, extrapolated, measure, size, sizes
from strandcast_studies.benchmarks.batch.trial import MeasuredCost, stages_s, table

BURN = "import time\nend = time.process_time() + {seconds}\nwhile time.process_time() < end: pass\n"


@pytest.mark.thorough
def test_cpu_time_is_split_into_work_imports_and_the_engine(tmp_path: Path) -> None:
    (tmp_path / "heavy.py").write_text(BURN.format(seconds=0.6))
    (tmp_path / "part.py").write_text(
        BURN.format(seconds=0.2) + "import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n"
    )
    part = "import subprocess, sys\nsubprocess.run([sys.executable, 'part.py'])\n"
    (tmp_path / "stage.py").write_text("import heavy\n" + BURN.format(seconds=0.3) + part)
    (tmp_path / "Snakefile").write_text(f"rule all:\n    shell: '{sys.executable} stage.py'\n")
    line = [sys.executable, "-m", "snakemake", "--cores", "1", "--quiet", "all"]
    spent = spent_by(line, tmp_path, tmp_path / "accounts.jsonl")
    assert 0.5 <= spent.stages_s < 0.8
    assert 0.6 <= spent.imports_s < 0.9
    assert 0.0 < spent.starts_s < 0.5
    assert spent.engine_s > 0.3
    assert spent.engine_mb > 30.0
    assert spent.total_s == pytest.approx(spent.stages_s + spent.imports_s + spent.starts_s + spent.engine_s)


@pytest.mark.thorough
def test_a_batch_of_stages_that_do_nothing_is_made_to_its_reports_once(tmp_path: Path) -> None:
    make_project(tmp_path / "project")
    record_empty(tmp_path / "project", 2, 1)
    row = measure(Size(2, 1), tmp_path / "project", str(python_without_stages(tmp_path / "python")))
    results = tmp_path / "project" / "results"
    made = [
        "report.html",
        "batch-001/report.html",
        "batch-002/trial-01/report.html",
        "batch-002/trial-02/motion.json",
    ]
    assert [name for name in made if not (results / name).is_file()] == []
    assert row["first"]["stages_s"] == 0.0
    assert row["first"]["starts_s"] > 0.0 == row["no_op"]["starts_s"]
    assert row["overhead_share"] is None
    look = [sys.executable, "-X", "importtime", "-m", "snakemake", "--dry-run", "--quiet"]
    again = subprocess.run(look, cwd=tmp_path / "project", capture_output=True, text=True, check=True)
    imported = {line.rpartition("|")[2].strip() for line in again.stderr.splitlines()}
    assert "snakemake.dag" in imported
    assert imported.isdisjoint({"pandas", "pyarrow", "scipy", "numba", "cv2"})


def test_a_stage_costs_what_it_and_its_processes_spend_without_imports() -> None:
    def process(cpu_s: float, *line: str, nested: bool = False) -> dict:
        spent = {"cpu_s": cpu_s, "children_s": 1.0, "start_s": 0.1, "imports_s": 0.4}
        return {"line": list(line), "nested": nested, **spent}

    found = stages_s(
        [
            process(2.0, "-m", "strandcast", "stage", "align", "lace", "1"),
            process(5.0, "-m", "strandcast", "track", "lace", "1"),
            process(5.0, "-m", "strandcast", "track", "lace", "2"),
            process(1.0, "-m", "strandcast.video.decoding_process", nested=True),
            process(9.0, "-m", "strandcast.cli.serve_stages", "8"),
        ]
    )
    assert list(found.items()) == [("track", pytest.approx(11.0)), ("align", pytest.approx(2.5))]


def test_a_figure_stands_beside_its_peer() -> None:
    rows = [
        MeasuredCost("track, per frame", 4.5, "CPU ms", "the decoder alone", 2.25),
        MeasuredCost("demo", 80.0, "CPU s"),
    ]
    assert table(rows).splitlines() == [
        "track, per frame      4.50 CPU ms   the decoder alone: 2.25",
        "demo                 80.00 CPU s",
    ]


def test_the_camera_of_a_larger_film_shows_the_same_places() -> None:
    camera, places_m = flat_camera(640, 480, 1e-3, (320.0, 240.0)), np.array([[0.0, 0.0], [0.2, -0.1]])
    px, larger_px = (metre_to_pixel(each, places_m, 0.0) for each in (camera, scaled(camera, 2.0)))
    np.testing.assert_allclose(larger_px + 0.5, 2.0 * (px + 0.5))


def test_every_trial_has_a_video_of_its_own(tmp_path: Path) -> None:
    donor = tmp_path / "donor"
    for name in ("calibration", trial_name(1)):
        (donor / name).mkdir(parents=True)
    (tmp_path / "config" / "experiments").mkdir(parents=True)
    (tmp_path / "config" / "experiments" / "demo.yaml").write_text("string: {length_m: 0.3}\nlab: {}\n")
    (donor / trial_name(1) / "video.mp4").write_bytes(b"film")
    record(tmp_path, donor, 2, 2)
    folder = tmp_path / "data" / "batch-002"
    assert "lab" not in (folder / "experiment.yaml").read_text()
    videos = [(folder / trial_name(trial) / "video.mp4").read_bytes() for trial in (1, 2)]
    assert videos[0] != videos[1]
    assert all(video.startswith(b"film") and video[4:12] == b"\0\0\0\x0cfree" for video in videos)


def test_a_thousand_trials_are_extrapolated_and_compared_with_the_targets() -> None:
    def row(trials: int, seconds: float) -> dict:
        spent = {"engine_s": seconds, "engine_mb": 100 * seconds, "starts_s": 0.0, "total_s": seconds}
        asked = {"cpu_s": 0.5 * seconds, "peak_mb": 10 * seconds}
        return {"experiments": 1, "trials": trials, "first": spent, "no_op": spent, "asked": asked}

    rows = [row(10, 2.0), row(20, 3.0)]
    line = extrapolated(rows, 1000)
    assert (line["no_op_s"], line["asked_s"], line["engine_mb"]) == pytest.approx((101.0, 50.5, 10_100.0))
    found = against_targets({"stubbed": rows, "extrapolated": line})
    assert {name: one["met"] for name, one in found.items()} == {
        "engine_mb": False,
        "asked_large_s": False,
        "no_op_ten_s": True,
    }
    assert (size("50x20").all_trials, sizes("1x10,2x3")) == (1000, [(1, 10), (2, 3)])
