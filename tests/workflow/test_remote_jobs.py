"""Every rule can be run by a job on another computer, which sees only that job; what jobs ask for there."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.faults.small import SETTINGS, environment

from strandcast.stages.files import SUPPLIED_FILES
from strandcast.workflow import shards, targets

# The jobs of each rule: in the lab, in space too, of a recorded throw, of a track measured elsewhere.
LAB, SPACE, RIG, MOCAP = "experiment=lab", "experiment=space", "experiment=rig", "experiment=mocap"
TWO = "experiment=two"  # cameras
SEVERAL = "string: {length_m: 0.3}\ncameras: {left: {}, right: {}}\n"
IN_SPACE = "string: {length_m: 0.4}\narm: ur5e-space\ntarget_m: [0.6, 0.7, 0.6]\nlab: {servo: pd}\n"
JOBS = {
    "lab_calibrate": [LAB],
    "lab_rehearse": [LAB, SPACE],
    "lab_throw": [f"{LAB},trial=01"],
    "lab_capture": [f"{SPACE},trial=01"],
    "calibrate": [f"{LAB},camera=main", f"{RIG},camera=main", f"{TWO}/left,camera=left"],
    "ingest": [f"{LAB},trial=01", f"{RIG},trial=01", f"{TWO}/left,trial=01"],
    "track": [f"{LAB},trial=01", f"{RIG},trial=01", f"{TWO}/left,trial=01"],
    "reconstruct": [f"{LAB},trial=01", f"{RIG},trial=01", f"{TWO}/left,trial=01"],
    "align": [f"{LAB},trial=01", f"{RIG},trial=01", f"{TWO}/left,trial=01"],
    "register_track": [f"{MOCAP},trial=01", f"{SPACE},trial=02"],
    "register_motion": [f"{RIG},trial=01", f"{MOCAP},trial=01"],
    "join_views": [f"{TWO},trial=01"],
    "score": [f"{RIG},trial=01", f"{MOCAP},trial=01"],
    "score_lab": [f"{LAB},trial=01", f"{SPACE},trial=01"],
    "estimate": [f"{LAB},trial=01", f"{RIG},trial=01", f"{MOCAP},trial=01", f"{TWO},trial=01"],
    "plan": [f"{LAB},trial=01", f"{RIG},trial=02", f"{MOCAP},trial=02"],
    "report_trial": [f"{LAB},trial=01", f"{RIG},trial=01", f"{MOCAP},trial=01", f"{TWO},trial=01"],
    "report_experiment": [RIG, MOCAP],  # the lab's waits for verdicts
}
# What executors pass to Snakemake on the other computer (snakemake/executors, `format_job_exec`).
REMOTE = """
import sys
from snakemake.cli import args_to_api, parse_args
for job in sys.argv[1:]:
    line = ["--target-jobs", job, "--mode", "remote", "--force", "--dry-run", "--cores", "1"]
    line += ["--nolock", "--no-hooks", "--ignore-incomplete", "--target-files-omit-workdir-adjustment"]
    parser, arguments = parse_args(line)
    if not args_to_api(arguments, parser):
        print("refused:", job)
print("done")
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory, project_root) -> Path:
    """Return a project with an experiment of each kind, their recordings empty."""
    root = tmp_path_factory.mktemp("remote")
    shutil.copy(project_root / "Snakefile", root)
    shutil.copytree(project_root / "workflow", root / "workflow")
    shutil.copytree(project_root / "config" / "arms", root / "config" / "arms")
    recordings = {
        "lab": (),
        "space": (),
        "rig": ("video.mp4", "joints.csv", "run.json", "motion.json"),
        "two": ("left.mp4", "right.mp4", "joints.csv", "run.json", "motion.json"),
        "mocap": (*SUPPLIED_FILES.values(), "motion.json"),
    }
    for name, files in recordings.items():
        folder = root / "data" / name / "trial-01"
        folder.mkdir(parents=True)
        texts = {"lab": SETTINGS, "space": IN_SPACE, "two": SEVERAL}
        text = texts.get(name, SETTINGS[: SETTINGS.index("lab:")])
        (folder.parent / "experiment.yaml").write_text(text)
        for file in files:
            (folder / file).touch()
    for boards in ("rig/calibration", "two/calibration/left", "two/calibration/right"):
        (root / "data" / boards).mkdir(parents=True)
        for name in ("plane.png", *(f"lens-{number:02d}.png" for number in range(1, 13))):
            (root / "data" / boards / name).touch()
    return root


@pytest.mark.thorough
def test_every_rule_is_a_job_that_another_computer_can_run(root):
    rules = "".join(path.read_text() for path in (root / "workflow" / "rules").glob("*.smk"))
    assert set(re.findall(r"^(?:rule|checkpoint) (\w+):", rules, re.MULTILINE)) == {*JOBS, "report_campaign"}
    assert "localrules:\n    all,\n    report_campaign,\n" in (root / "workflow" / "Snakefile").read_text()
    jobs = [f"{rule}:{wildcards}" for rule, found in JOBS.items() for wildcards in found]
    line = [sys.executable, "-c", REMOTE, *jobs]
    run = subprocess.run(line, cwd=root, capture_output=True, text=True, check=False, env=environment())
    said = [line for line in run.stdout.splitlines() if line.startswith(("refused", "done"))]
    assert said == ["done"], run.stderr[-3000:]


@pytest.fixture
def here(root, monkeypatch):
    monkeypatch.chdir(root)
    for cached in (targets.experiment, targets.supplied_trials):
        cached.cache_clear()
    yield root
    for cached in (targets.experiment, targets.supplied_trials):
        cached.cache_clear()


def test_recorded_throws_are_jobs_of_their_own_and_all_else_of_an_experiment_is_one(here):
    assert shards.shard_of("calibrate", "rig") is None
    assert shards.shard_of("track", "rig", 1) == "rig.throws"
    for job in [("estimate", "rig", 1), ("summary", "rig"), ("plan", "rig", 2)]:
        assert shards.shard_of(*job) == "rig"
    assert {shards.shard_of(stage, "mocap", 1) for stage in ("register_track", "score", "plan")} == {"mocap"}
    assert {shards.shard_of(stage, "lab", 1) for stage in ("calibrate", "track", "score")} == {"lab"}
    assert shards.shard_of("summary", "lab") is None  # known only after the verdicts


def test_a_job_asks_for_memory_and_time_by_the_size_of_its_video_and_more_after_each_failure(here):
    video = here / "data" / "rig" / "trial-01" / "video.mp4"
    small = [shards.memory_mb("track", "rig", 1), shards.runtime_min("track", "rig", 1)]
    assert small == [shards.TRACK_PEAK_MB, shards.TRACK_MIN]
    with video.open("wb") as file:
        file.truncate(500_000_000)
    assert shards.memory_mb("track", "rig", 1) == shards.TRACK_PEAK_MB + 1000
    assert shards.memory_mb("track", "rig", 1, attempt=3) == 4 * (shards.TRACK_PEAK_MB + 1000)
    assert shards.memory_mb("estimate", "rig", 1) == shards.PEAK_MB
    assert shards.runtime_min("track", "rig", 1, attempt=2) == 2 * (shards.TRACK_MIN + 25)
    assert shards.memory_mb("track", "lab", 1) == shards.TRACK_PEAK_MB  # its video does not exist yet
    video.write_bytes(b"")


def test_a_video_whose_storage_is_not_there_keeps_no_later_stage_from_running(here):
    video = here / "data" / "rig" / "trial-01" / "video.mp4"
    video.unlink()
    video.symlink_to(here / "no-such-storage" / "video.mp4")
    try:
        assert shards.runtime_min("score", "rig", 1) == shards.TIME_MIN
        assert shards.memory_mb("track", "rig", 1) == shards.TRACK_PEAK_MB
    finally:
        video.unlink()
        video.touch()
