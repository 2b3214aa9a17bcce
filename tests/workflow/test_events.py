"""The state of a run from Snakemake's events, and Snakemake's reasons in plain words."""

import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from strandcast.workflow.event_log import EVENTS
from strandcast.workflow.events import RunState, in_words, past_durations


def begins(number: int, rule: str, trial: str | None = "01") -> dict:
    wildcards = {"experiment": "rope"} | ({} if trial is None else {"trial": trial})
    return {"event": "job_info", "id": number, "rule": rule, "wildcards": wildcards, "reason": ""}


def write_benchmark(root: Path, place: str, seconds: str) -> None:
    path = root / "results" / place
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(seconds)


def test_jobs_run_finish_and_fail():
    state = RunState()
    state.take({"event": "run_info", "counts": {"track": 1, "report_experiment": 1, "total": 2}})
    job = state.take(begins(4, "track"))
    state.take(begins(5, "report_experiment", None))
    assert [each.subject for each in state.running.values()] == ["rope trial-01", "rope"]
    assert [each.stage for each in state.running.values()] == ["track", "summary"]
    assert state.take({"event": "job_error", "id": 4, "log": ["results/rope/track.log"]}) is job
    state.take({"event": "job_finished", "id": 5})
    state.take({"event": "progress", "done": 1, "total": 2})
    assert (state.running, state.failed, state.done, state.total) == ({}, [job], 1, 2)
    assert job.to_json() == {
        "experiment": "rope",
        "trial": 1,
        "stage": "track",
        "log": "results/rope/track.log",
    }


def test_of_a_group_on_a_cluster_one_job_fails_and_none_once_it_was_repeated():
    state = RunState()
    track, _ = [state.take(begins(number, rule)) for number, rule in ((4, "track"), (5, "align"))]
    group = {"event": "group_error", "failed": [4], "stopped": [5], "log": ["slurm/7.log"]}
    assert state.take(group) is track
    assert (state.running, state.failed, track.log) == ({}, [track], "slurm/7.log")
    for number, rule in ((4, "track"), (5, "align")):
        state.take(begins(number, rule))
        state.take({"event": "job_finished", "id": number})
    assert (state.running, state.failed) == ({}, [])


def test_the_log_of_a_group_says_which_of_its_jobs_failed(tmp_path):
    log = tmp_path / "7.log"
    members = [
        {"jobid": number, "rule_name": rule} for number, rule in ((4, "ingest"), (5, "track"), (6, "align"))
    ]
    record = SimpleNamespace(job_error_info=members, aux_logs=[str(log)])
    killed = "error: StepId=7.0 exceeded memory limit (2 > 1), being killed\n"
    for text, failed, stopped, cause in (
        ("Error in rule track:\n", [5], [4, 6], ""),
        (killed, [4], [5, 6], ": out of memory"),
    ):
        log.write_text(text)
        known = {"failed": failed, "stopped": stopped, "cause": cause, "log": [str(log)]}
        assert EVENTS["group_error"](record) == known


def test_expected_times_come_from_earlier_runs(tmp_path):
    write_benchmark(tmp_path, "rope/trial-01/logs/track.jsonl", '{"s": 10.0}\n')
    write_benchmark(tmp_path, "rope/trial-02/logs/track.jsonl", '{"s": 20.0}\n')
    write_benchmark(tmp_path, "rope/trial-03/logs/track.jsonl", '{"s": 60.0}\n')
    write_benchmark(tmp_path, "rope/trial-04/logs/track.jsonl", '{"s": ')  # killed while it was written
    write_benchmark(tmp_path, "rope/logs/summary.jsonl", '{"s": 5.0}\n')
    state = RunState(past_durations(tmp_path, ["rope", "new"]))
    assert state.take(begins(0, "track", "03")).expected_s == 60.0
    assert state.take(begins(1, "track", "07")).expected_s == 20.0  # the median
    assert state.take(begins(2, "estimate")).expected_s is None
    assert state.take(begins(3, "report_experiment", None)).expected_s == 5.0


def test_the_time_left_counts_running_and_waiting_jobs(tmp_path):
    write_benchmark(tmp_path, "rope/trial-01/logs/track.jsonl", '{"s": 100.0}\n')
    write_benchmark(tmp_path, "rope/logs/summary.jsonl", '{"s": 7.0}\n')
    state = RunState(past_durations(tmp_path, ["rope"]))
    state.take({"event": "run_info", "counts": {"track": 2, "report_experiment": 1, "total": 3}})
    job = state.take(begins(0, "track"))
    job.began_s = time.monotonic() - 40.0
    assert state.left_s() == pytest.approx(60.0 + 100.0 + 7.0, abs=1.0)
    state.take({"event": "job_finished", "id": 0})
    assert state.left_s() == pytest.approx(107.0, abs=1.0)
    state.take(begins(1, "report_experiment", None))
    assert state.left_s() == pytest.approx(107.0, abs=1.0)
    state.take({"event": "run_info", "counts": {"track": 1, "estimate": 1, "total": 2}})
    assert state.left_s() is None  # no estimate has been timed


@pytest.mark.parametrize(
    ("reason", "words"),
    [
        ("Missing output files: results/rope/b.json, results/rope/a.json", "missing: a.json, b.json"),
        ("Missing output files: d/4, d/3, d/2, d/1", "missing: 1, 2, 3 and 1 more"),
        ("Missing output files: a.json; Code has changed since last execution", "missing: a.json"),
        ("Input files updated by another job: results/x/track.json", "is made again: track.json"),
        (
            "Params have changed since last execution: a.csv changed; dt_s: 1 → 2",
            "a.csv changed; dt_s: 1 → 2",
        ),
        ("Forced execution", "an input has changed since"),
        ("A reason of a later Snakemake", "A reason of a later Snakemake"),
    ],
)
def test_reasons_are_plain_words(reason, words):
    assert in_words(reason).startswith(words)
