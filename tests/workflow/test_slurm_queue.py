"""What is read from Slurm's queue: held jobs, and their experiments. tests/slurm asks a real one."""

import os
from pathlib import Path

import pytest

from strandcast.errors import StrandcastError
from strandcast.workflow import slurm
from strandcast.workflow.project import executor_of, make_project, profile
from strandcast.workflow.runner import RunOptions, command, run_experiments

QUEUE = """\
7|PENDING|{root}|rule_rope_estimate_plan_report_trial|launch failed requeued held
8|PENDING|{root}|rule_rope.throws_align_ingest_track|Priority
9|PENDING|{root}|rule_rope_2_estimate|JobHeldUser
10|RUNNING|{root}|rule_calibrate_wildcards_silk_main|None
11|PENDING|/elsewhere|rule_rope_estimate|JobHeldAdmin
12|PENDING|{root}|rule_silk_estimate|BeginTime
13|PENDING|{root}|rule_silk_plan|(Nodes a|b) PartitionTimeLimit
"""


@pytest.fixture
def queue(tmp_path, monkeypatch) -> Path:
    """Put a `squeue` with a few jobs first on PATH; return the folder that they are of."""
    program = tmp_path / "bin" / "squeue"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\ncat {tmp_path}/queue\n")
    program.chmod(0o755)
    (tmp_path / "queue").write_text(QUEUE.format(root=tmp_path))
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


def test_jobs_that_will_not_start_are_one_message_with_the_way_on(queue):
    held = slurm.held_jobs(slurm.jobs_in(queue))
    assert [job.id for job in held] == ["7", "9", "13"]
    problem = slurm.held_message(held)
    assert "SC-W024 WARNING  Slurm will not start 3 jobs by itself" in problem.message("WARNING")
    assert "launch failed requeued held" in problem.what
    assert "scontrol release 7 9 13" in problem.fix
    assert "scancel 7 9 13" in problem.fix


def test_jobs_left_by_a_killed_run_are_refused_by_experiment(queue):
    slurm.refuse_left_jobs(queue, ["rop", "new"])
    for name, ids in (("rope", "7 8"), ("rope_2", "9"), ("silk", "10 12 13")):
        with pytest.raises(StrandcastError, match="SC-W024") as refused:
            slurm.refuse_left_jobs(queue, [name])
        assert f"scancel {ids};" in refused.value.fix


def test_a_queue_that_does_not_answer_holds_nothing_up(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert slurm.jobs_in(tmp_path) == []


def test_without_the_plugin_or_without_slurm_a_run_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(slurm, "PLUGIN", "no_such_plugin")
    with pytest.raises(StrandcastError, match="SC-W012.*no-such-plugin"):
        slurm.require_slurm()
    with pytest.raises(StrandcastError, match="SC-W012"):  # Snakemake lists no jobs without it either
        run_experiments(project(tmp_path), ["demo"], RunOptions(profile="slurm", dry_run=True))
    monkeypatch.setattr(slurm, "PLUGIN", "json")
    monkeypatch.setenv("PATH", str(tmp_path))
    slurm.require_slurm(submits=False)
    with pytest.raises(StrandcastError, match="SC-W026"):
        slurm.require_slurm()


def project(folder: Path) -> Path:
    make_project(folder / "lab")
    return folder / "lab"


def words_after(line: list[str], option: str) -> str | None:
    return line[line.index(option) + 1] if option in line else None


@pytest.mark.parametrize(("answer", "status"), [("exit 0", None), ("exit 1", "squeue")])
def test_a_run_on_slurm_asks_the_cluster_for_jobs_and_not_this_computer_for_cores(queue, answer, status):
    sacct = queue / "bin" / "sacct"
    sacct.write_text(f"#!/bin/sh\n{answer}\n")
    sacct.chmod(0o755)
    line = command(queue, ["demo"], RunOptions(jobs=40, profile="slurm"))
    assert words_after(line, "--jobs") == "40"
    assert words_after(line, "--cores") is None  # the profile says how many a job has
    assert words_after(line, "--slurm-status-command") == status
    here = command(queue, ["demo"], RunOptions(jobs=3))
    assert (words_after(here, "--cores"), words_after(here, "--jobs")) == ("3", None)


def test_a_profile_is_the_projects_own_or_one_that_ships_or_a_path(tmp_path):
    assert executor_of(tmp_path / profile(tmp_path, "slurm")) == slurm.SLURM
    assert executor_of(tmp_path / profile(tmp_path)) is None
    own = tmp_path / "workflow" / "profiles" / "slurm"
    own.mkdir(parents=True)
    (own / "profile.yaml").write_text("executor: lsf\n")
    assert executor_of(tmp_path / profile(tmp_path, "slurm")) == "lsf"
    assert profile(tmp_path, str(own)) == own
    (own / "profile.yaml").write_text("executor: [lsf\n")
    with pytest.raises(StrandcastError, match="SC-F002.*cannot be read"):
        executor_of(own)
    with pytest.raises(StrandcastError, match="SC-W021.*'slrum'") as refused:
        profile(tmp_path, "slrum")
    assert refused.value.fix.startswith("one of default, s3, slurm")


def test_a_profile_with_object_storage_is_for_snakemake_itself(tmp_path):
    folder = profile(tmp_path, "s3")
    with pytest.raises(StrandcastError, match="SC-W037") as refused:
        executor_of(tmp_path / folder)
    assert f"snakemake --workflow-profile {folder} " in refused.value.fix


@pytest.mark.parametrize("name", ["", "..", "/", "/no/such/folder"])
def test_a_folder_without_settings_is_no_profile(tmp_path, name):
    (tmp_path / "workflow" / "profiles" / "empty").mkdir(parents=True)
    with pytest.raises(StrandcastError, match="SC-W021") as refused:
        profile(tmp_path, name)
    assert refused.value.fix.startswith("one of default, s3, slurm, or")


def test_the_settings_of_a_profile_may_be_for_a_version_of_snakemake(tmp_path):
    own = tmp_path / "workflow" / "profiles" / "ours"
    own.mkdir(parents=True)
    (own / "config.yaml").write_text("cores: 2\n")
    (own / "config.v8+.yaml").write_text("executor: slurm\n")
    assert executor_of(tmp_path / profile(tmp_path, "ours")) == slurm.SLURM
