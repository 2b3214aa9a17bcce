"""Twenty experiments through a real Slurm of two nodes: the same bytes as on one computer, faults or not."""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.faults.small import JOBS, NAME, REAL, environment, make_project, result_hashes, run_stages
from tests.slurm import cluster as slurm_cluster
from tests.slurm.cluster import Cluster

from strandcast.errors import StrandcastError
from strandcast.stages.files import SUPPLIED_FILES
from strandcast.workflow import slurm

pytestmark = [
    pytest.mark.skipif(slurm_cluster.missing() is not None, reason=str(slurm_cluster.missing())),
]
pytest.importorskip(slurm.PLUGIN, reason="the plugin for Slurm is not installed: make slurm")

STRINGS = [f"string-{number:02d}" for number in range(1, 19)]
PATIENCE_S = 3600.0  # for a run of some minutes on an idle machine; others may be busy
# What a user's copy of the profile may say: quick answers, and too little memory for the videos at first.
PROFILE = """
set-resources:
  lab_throw: {mem_mb: 1300}  # as the group asks for `track` otherwise: the calibration runs beside it
  ingest: {mem_mb: 150 * attempt ** 3}
  track: {mem_mb: 150 * attempt ** 3}
  reconstruct: {mem_mb: 150 * attempt ** 3}
  align: {mem_mb: 150 * attempt ** 3}
  score: {mem_mb: 150 * attempt ** 3}
"""


def chain(name: str, *stages: str) -> list[list[object]]:
    """Return the jobs of an experiment with one throw, in the order of the rules."""
    jobs: list[list[object]] = []
    for stage, trials in JOBS:
        if stage in stages:
            jobs.append([stage, name, 0, [1]] if stage == "summary" else [stage, name, *trials])
    return jobs


@pytest.fixture(scope="module")
def local(tmp_path_factory) -> Path:
    """Return a project of 20 experiments with the results of stages that ran one after the other, here."""
    root = make_project(tmp_path_factory.mktemp("local") / "project")
    run_stages(root, chain(NAME, *{stage for stage, _ in JOBS}))
    made, raw = root / "results" / NAME / "trial-01", root / "data" / NAME / "trial-01"
    for number, name in enumerate(["rig", *STRINGS]):
        folder = root / "data" / name / "trial-01"
        folder.mkdir(parents=True)
        (folder.parent / "experiment.yaml").write_text(REAL.replace("seed: 3", f"seed: {number}"))
        recording = ("video.mp4", "joints.csv", "run.json", "motion.json")
        supplied = [made / file for file in SUPPLIED_FILES.values()] + [raw / "motion.json"]
        for file in [raw / file for file in recording] if name == "rig" else supplied:
            shutil.copy(file, folder)
    shutil.copytree(root / "data" / NAME / "calibration", root / "data" / "rig" / "calibration")
    of_rig = ("calibrate", "ingest", "track", "reconstruct", "align", "score", "estimate")
    jobs = [["register_motion", "rig", 1], *chain("rig", *of_rig), ["plan", "rig", 2]]
    jobs += [["report", "rig", 1], ["summary", "rig", 0, [1]]]
    for name in STRINGS:
        jobs += [[stage, name, 1] for stage in ("register_track", "estimate")]
    run_stages(root, jobs)
    return root


@pytest.fixture(scope="module")
def cluster(tmp_path_factory) -> Iterator[Cluster]:
    with Cluster(tmp_path_factory.mktemp("slurm") / "cluster") as started:
        yield started


@pytest.fixture(scope="module")
def project(local, tmp_path_factory) -> Path:
    """Return the same project without results."""
    root = tmp_path_factory.mktemp("remote") / "project"
    shutil.copytree(local, root, ignore=shutil.ignore_patterns("results"))
    shutil.rmtree(root / "data" / NAME)
    folder = root / "workflow" / "profiles"
    shutil.copytree(folder / "slurm", folder / "test")
    text = (folder / "slurm" / "profile.yaml").read_text().replace("status-checks: 20", "status-checks: 2")
    (folder / "test" / "profile.yaml").write_text(text + PROFILE)
    return root


class Run:
    """A run of `strandcast` on the cluster, and what it has said so far."""

    def __init__(self, cluster: Cluster, root: Path, *arguments: str) -> None:
        line = [sys.executable, "-m", "strandcast", "run", *arguments, "--profile", "test"]
        kept = {name: cluster.environment[name] for name in ("PATH", "SLURM_CONF")}
        self.process = subprocess.Popen(
            line,
            cwd=root,
            env=environment(**kept),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.said = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> "Run":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        self.process.wait()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said += line

    def until(self, condition: Callable[[], object]) -> None:
        """Wait for something to happen while the run goes on."""
        began = time.monotonic()
        while not condition():
            assert self.process.poll() is None, self.said[-3000:]
            assert time.monotonic() - began < PATIENCE_S, self.said[-3000:]
            time.sleep(0.2)

    def end(self) -> int:
        code = self.process.wait(timeout=PATIENCE_S)
        self._reader.join()
        return code


def differences(local: Path, root: Path, names: list[str]) -> list[str]:
    here, there = result_hashes(local), result_hashes(root)
    mine = [place for place in here | there if place.split("/")[1] in names]
    assert len(mine) > 4 * len(names)
    return [place for place in mine if here.get(place) != there.get(place)]


def running_on(cluster: Cluster, node: str) -> int:
    return len(cluster.run("squeue", "--noheader", f"--nodelist={node}", "--states=RUNNING").splitlines())


def test_held_jobs_are_reported_and_a_node_that_dies_costs_nothing(local, project, cluster):
    (cluster.folder / "broken-n1").touch()  # its prolog fails: Slurm holds the job
    with Run(cluster, project, *STRINGS, "--until", "estimate") as run:
        run.until(lambda: "SC-W024" in run.said)
        assert run.said.count("SC-W024") == 1
        assert "launch failed requeued held" in run.said
        release = run.said.partition("scontrol release ")[2].partition(";")[0].split()
        (cluster.folder / "broken-n1").unlink()
        cluster.run("scontrol", "update", "nodename=n1", "state=resume")
        cluster.run("scontrol", "release", *release)
        made = project.glob
        run.until(lambda: running_on(cluster, "n2") and list(made("results/*/trial-01/estimate.json")))
        cluster.cut_off("n2")
        run.until(lambda: "down" in cluster.run("sinfo", "--noheader", "--nodes=n2", "--format=%T"))
        cluster.start_node("n2")
        assert run.end() == 0, run.said[-3000:]
    assert differences(local, project, STRINGS) == []


def test_a_job_out_of_memory_is_repeated_with_more_and_the_lab_throws_on_the_cluster(local, project, cluster):
    with Run(cluster, project, "rig", NAME) as run:
        assert run.end() == 0, run.said[-3000:]
    assert re.search(r"^rig trial-01: \w+ failed: out of memory; its log: .*\.log$", run.said, re.MULTILINE)
    jobs = cluster.run("squeue", "--noheader", "--states=all", "--sort=i", "--format=%T|%m|%k").splitlines()
    names = ("rule_rig.throws", "rule_rig_", f"rule_{NAME}_", "rule_report_experiment")
    of = {name: [line.split("|")[:2] for line in jobs if f"|{name}" in line] for name in names}
    *failures, (last, _) = of["rule_rig.throws"]
    assert ({state for state, _ in failures}, last) == ({"FAILED"}, "COMPLETED")
    asked_mb = [int(memory.removesuffix("M")) for _, memory in of["rule_rig.throws"]]
    assert asked_mb == sorted(set(asked_mb))  # more with each attempt
    # Nothing else was submitted twice: up to the lab's verdict, after it, and the page.
    assert [len(of[name]) for name in names[1:]] == [1, 2, 1]
    assert differences(local, project, ["rig", NAME]) == []


def test_jobs_of_a_killed_run_are_refused_until_they_are_cancelled(project, cluster, monkeypatch):
    for name in ("PATH", "SLURM_CONF"):
        monkeypatch.setenv(name, cluster.environment[name])
    with Run(cluster, project, "string-01", "--until", "plan") as run:
        run.until(lambda: slurm.jobs_in(project))
        (engine,) = slurm_cluster.children(run.process.pid)
        os.killpg(engine, signal.SIGKILL)
    left = slurm.jobs_in(project)
    assert [job.is_of("string-01") for job in left] == [True]
    assert not left[0].is_of("string-0")
    slurm.refuse_left_jobs(project, ["string-02"])
    with pytest.raises(StrandcastError, match=f"SC-W024.*{left[0].id}") as refused:
        slurm.refuse_left_jobs(project, ["string-01", "string-02"])
    assert f"scancel {left[0].id}" in refused.value.fix
    cluster.run("scancel", left[0].id)
