"""What is made again depends on contents, not on times and hidden files."""

import json
import os
import random
import shutil
import time
from pathlib import Path

import pytest
from tests.faults.small import NAME
from tests.forked import run_module

from strandcast.records.content_hash import result_sha256
from strandcast.records.files import sha256_file
from strandcast.records.known_hashes import FILE, content_sha256_of, remembered
from strandcast.workflow.runner import RunOptions, run_experiments

VIDEO, LENS, LOG = (
    f"data/{NAME}/{name}" for name in ("trial-01/video.mp4", "calibration/lens-01.png", "trial-01/joints.csv")
)


def stale(root: Path) -> dict[str, list[str]]:
    """Return the stages that `status` says a run makes again for reasons of their own, with the reasons."""
    run = run_module(root, "strandcast", "status", NAME, "--json")
    assert run.returncode == 0, run.stderr
    trials = json.loads(run.stdout)["experiments"][0]["trials"]
    return {stage["stage"]: stage["why"] for each in trials for stage in each["stages"] if stage["why"]}


def would_run(root: Path) -> set[str]:
    """Return the stages that a run would make again, as Snakemake plans it."""
    run = run_module(root, "strandcast", "run", NAME, "--dry-run", "--json", "--until", "summary")
    assert run.returncode == 0, run.stderr
    return {job["stage"] for job in json.loads(run.stdout)["jobs"]}


def flip(path: Path) -> None:
    """Change one byte of a file; its size, its inode and its time of modification stay as they are."""
    facts = path.stat()
    with path.open("r+b") as file:
        file.seek(facts.st_size // 2)
        byte = file.read(1)[0]
        file.seek(facts.st_size // 2)
        file.write(bytes([byte ^ 1]))
    os.utime(path, ns=(facts.st_atime_ns, facts.st_mtime_ns))


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Path:
    """Return a copy of the finished project without hidden files, with times of two weeks around now."""
    root = Path(shutil.copytree(finished, tmp_path / "copy", ignore=shutil.ignore_patterns(".snakemake")))
    draw = random.Random(7)
    for path in root.rglob("*"):
        if path.is_file():
            moment_s = time.time() + draw.uniform(-600_000, 600_000)
            os.utime(path, (moment_s, moment_s))
    return root


def test_a_copy_of_any_time_is_as_fresh_as_the_original(copy: Path) -> None:
    assert (stale(copy), would_run(copy)) == ({}, set())


@pytest.mark.thorough
def test_a_result_is_made_again_from_files_of_the_future(copy: Path) -> None:
    (copy / f"results/{NAME}/trial-01/verdict.json").unlink()
    run = run_module(copy, "strandcast", "run", NAME)
    assert run.returncode == 0, run.stderr[-2000:]
    assert (stale(copy), would_run(copy)) == ({}, set())


def test_a_run_with_nothing_to_do_starts_no_engine_and_draws_no_page(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = copy / "results" / "report.html"
    written = page.stat().st_mtime_ns
    monkeypatch.setattr("strandcast.workflow.runner.run_snakemake", lambda *_: pytest.fail("was started"))
    again = run_experiments(copy, [NAME], RunOptions())
    assert (again.exit_code, again.jobs) == (0, [])
    assert [each.experiment for each in again.summaries] == [NAME]
    assert again.campaign is not None
    assert page.stat().st_mtime_ns == written
    page.write_text(page.read_text().replace("<title>", "<title>Another: "))
    run_experiments(copy, [NAME], RunOptions())
    assert "Another:" not in page.read_text()


@pytest.mark.parametrize("name", ["summary.json", "trial-01/observations.parquet"])
def test_a_result_that_contradicts_its_own_hash_is_another(finished: Path, tmp_path: Path, name: str) -> None:
    """A run would find nothing to do, and no stage could read it."""
    path = Path(shutil.copy(finished / "results" / NAME / name, tmp_path))
    sound, data = result_sha256(path), path.read_bytes()
    at = data.rindex(b"content_sha256") + 40
    path.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
    assert result_sha256(path) not in (sound, sha256_file(finished / "results" / NAME / name))


@pytest.mark.parametrize(
    ("name", "stage"),
    [
        (VIDEO, "ingest"),
        pytest.param(LENS, "calibrate", marks=pytest.mark.thorough),
        pytest.param(LOG, "ingest", marks=pytest.mark.thorough),
    ],
)
def test_a_byte_changed_under_the_same_size_and_time_is_found(copy: Path, name: str, stage: str) -> None:
    (copy / FILE).parent.mkdir()
    assert stale(copy) == {}  # all is hashed, and remembered
    flip(copy / name)
    found = stale(copy)
    assert found[stage] == [f"{name} changed"]
    assert not found.keys() & {"lab_throw", "lab_calibrate", "lab_rehearse"}
    assert stage in would_run(copy)
    flip(copy / name)
    assert stale(copy) == {}


def test_a_hash_is_remembered_only_of_a_file_that_was_left_alone(tmp_path: Path) -> None:
    file, kept = tmp_path / "joints.csv", tmp_path / FILE
    kept.parent.mkdir()
    file.write_text("0.1")
    with remembered(tmp_path):
        content_sha256_of(file)
    assert not kept.exists()  # it could change again within the step of the clock
    kept.write_bytes(b'1\n{"joints.csv":["0",3,0,0,0]}')  # its check sum is wrong
    with remembered(tmp_path):
        assert content_sha256_of(file) != "0"
