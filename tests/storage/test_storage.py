"""A recorded experiment from a local S3 server and back into it: the same bytes as from files on disk."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.faults.small import NAME, REAL, environment, make_project, result_hashes, run_stages

from strandcast.records.files import sha256_file

pytest.importorskip("snakemake_storage_plugin_s3", reason="the plugin for S3 is not installed: make storage")
pytest.importorskip("moto", reason="there is no local S3 server: make storage")

from tests.storage.s3 import LocalS3  # needs both

PREFIX = "projects/rope"
# What an executor without shared files passes to Snakemake on the other computer, which reads no profile.
ELSEWHERE = (
    *("--mode", "remote", "--force", "--nolock", "--no-hooks", "--ignore-incomplete"),
    *("--target-files-omit-workdir-adjustment", "--shared-fs-usage", "none"),
    *("--default-storage-provider", "s3"),
)


@pytest.fixture(scope="module")
def local(tmp_path_factory) -> Path:
    """Return a project with two recorded throws and their results, made from files on disk."""
    root = make_project(tmp_path_factory.mktemp("local") / "project")
    jobs: list[list[object]] = [["lab_calibrate", NAME], ["calibrate", NAME], ["lab_rehearse", NAME]]
    jobs += [[stage, NAME, 1] for stage in ("plan", "lab_throw", "ingest", "track", "reconstruct", "align")]
    jobs += [["estimate", NAME, 1], ["plan", NAME, 2], ["lab_throw", NAME, 2]]
    run_stages(root, jobs)
    shutil.rmtree(root / "results")
    (root / "data" / NAME).rename(root / "data" / "rig")
    shutil.rmtree(root / "data" / "rig" / "rehearsal")
    (root / "data" / "rig" / "experiment.yaml").write_text(REAL)
    (root / "config" / "experiments" / f"{NAME}.yaml").unlink()
    for file in root.glob("data/rig/trial-*/predicted.parquet"):
        file.unlink()
    line = [sys.executable, "-m", "strandcast", "run", "--cores", "2"]
    subprocess.run(line, cwd=root, env=environment(), check=True, capture_output=True)
    return root


@pytest.fixture(scope="module")
def s3(local, tmp_path_factory) -> Iterator[LocalS3]:
    """Run a server with the raw data in its bucket."""
    with LocalS3(tmp_path_factory.mktemp("s3") / "requests.log") as server:
        for file in sorted(path for path in local.glob("data/rig/*/*") if path.is_file()):
            server.upload(file, f"{PREFIX}/{file.relative_to(local).as_posix()}")
        yield server


@pytest.fixture(scope="module")
def away(local, tmp_path_factory) -> Path:
    """Return the project's settings, as they lie where Snakemake runs: no raw data, no results."""
    return settings_of(local, tmp_path_factory.mktemp("away") / "project")


def settings_of(project: Path, folder: Path) -> Path:
    left_out = shutil.ignore_patterns(".snakemake", "results", "trial-*", "calibration")
    shutil.copytree(project, folder, ignore=left_out)
    assert [path.name for path in folder.glob("data/rig/*")] == ["experiment.yaml"]
    return folder


def snakemake(s3: LocalS3, root: Path, *arguments: str, prefix: str = f"s3://lab/{PREFIX}"):
    """Run Snakemake with the profile for S3, one job at a time; return how it ended and what it asked for."""
    line = ["--workflow-profile", "workflow/profiles/s3", "--default-storage-prefix", prefix]
    before = len(s3.requests())
    run = subprocess.run(
        [sys.executable, "-m", "snakemake", *arguments, *line, "--cores", "1"],
        cwd=root,
        env=environment(**s3.environment()),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    return run, s3.requests()[before:]


def differences(s3: LocalS3, local: Path, folder: Path) -> list[str]:
    """Return the results that differ between bucket and disk; the disk alone has the notes of stages."""
    s3.download(PREFIX, folder)
    here = {name: sha256 for name, sha256 in result_hashes(local).items() if "/made/" not in name}
    there = result_hashes(folder)
    pages = [sha256_file(root / "results" / "report.html") for root in (local, folder)]
    assert len(here) > 30
    assert pages[0] == pages[1]
    return sorted(name for name in here | there if here.get(name) != there.get(name))


@pytest.mark.parametrize("prefix", ["s3://lab/elsewhere", "s3://lab", "lab/projects"])
def test_a_prefix_without_raw_data_is_refused(s3, away, prefix):
    run, _ = snakemake(s3, away, "--dry-run", prefix=prefix)
    assert run.returncode == 3
    assert "SC-W037 ERROR" in run.stdout
    assert f"no raw data are found in {prefix}/data" in run.stdout


def test_a_dry_run_lists_the_storage_once_and_retrieves_nothing(s3, away):
    run, requests = snakemake(s3, away, "--dry-run")
    assert run.returncode == 0, run.stdout[-3000:]
    assert len(requests) == 2, requests  # does the bucket exist, what is in it
    assert not list(away.rglob("video.mp4"))


def test_the_whole_chain_gives_the_same_bytes_and_raw_data_come_with_their_jobs(s3, local, away, tmp_path):
    run, requests = snakemake(s3, away)
    assert run.returncode == 0, run.stdout[-3000:]
    assert differences(s3, local, tmp_path) == []
    results = f"PUT /lab/{PREFIX}/results/rig"
    for trial in ("trial-01", "trial-02"):
        video = requests.index(f"GET /lab/{PREFIX}/data/rig/{trial}/video.mp4")
        # The next result that is stored is that of the job that the video was retrieved for.
        made = next(each for each in requests[video:] if each.startswith("PUT") and "/logs/" not in each)
        assert made == f"{results}/{trial}/manifest.json"
    kinds = (".mp4", ".csv", ".parquet", ".html")
    assert [path for path in away.rglob("*") if path.suffix in kinds] == []  # no copy is left


def test_nothing_is_made_again(s3, away):
    run, requests = snakemake(s3, away)
    assert run.returncode == 0, run.stdout[-3000:]
    assert "Nothing to be done" in run.stdout
    assert len(requests) == 2, requests


def test_a_job_runs_on_a_computer_that_has_only_the_settings(s3, local, tmp_path):
    node = settings_of(local, tmp_path / "node")
    made = [key for key in s3.keys(PREFIX) if key.endswith("results/rig/trial-02/track.json")]
    s3.bucket.Object(made[0]).delete()
    job = ("--target-jobs", "track:experiment=rig,trial=02")
    run, requests = snakemake(s3, node, *job, *ELSEWHERE)
    assert run.returncode == 0, run.stdout[-3000:]
    assert f"PUT /lab/{PREFIX}/results/rig/trial-02/track.json" in requests
    assert differences(s3, local, tmp_path / "bucket") == []
