"""The state of every run, from its files alone."""

from pathlib import Path

import pytest

from strandcast.core.trial_names import trial_name
from strandcast.records.folders import ExperimentFolder
from strandcast.records.summary import ExperimentSummary, TrialSummary
from strandcast.records.verdict import Verdict
from strandcast_studies.paper.cases import case_of
from strandcast_studies.paper.gather import (
    FAILED,
    finished,
    first_error,
    found,
    last_of,
    same_string,
    state,
    states,
    summaries,
    transfers,
)

ONE, TWO, OTHER = (
    "paper-string1-target1-seed101-default",
    "paper-string1-target2-seed101-default",
    "paper-string5-target3-seed101-default",
)


def line(trial: int, miss_m: float, excluded: str | None = None) -> TrialSummary:
    return TrialSummary(
        trial=trial,
        miss_m=miss_m,
        miss_sigma_m=None,
        hit=miss_m < 0.02,
        E_planned_m=None,
        E_m=0.002,
        tracked_fraction=1.0,
        alignment_offset_s=None,
        alignment_offset_se_s=None,
        excluded=excluded,
    )


def make(root: Path, name: str, lines: list[TrialSummary]) -> Path:
    """Write a run with its summary and the pieces of its counted trials."""
    (root / "data" / name).mkdir(parents=True)
    (root / "data" / name / "experiment.yaml").write_text("")
    results = root / "results" / name
    hits = [each.trial for each in lines if each.hit and each.excluded is None]
    for each in lines:
        if each.excluded is None:
            trial = results / trial_name(each.trial)
            trial.mkdir(parents=True, exist_ok=True)
            (trial / "estimate.json").write_text("{}")
            Verdict(
                experiment=name,
                trial=each.trial,
                target_m=[0.5, 0.5],
                hit_radius_m=0.02,
                hit=each.hit,
                miss_m=each.miss_m,
                miss_sigma_m=None,
                closest_frame=None,
                closest_robot_time_s=None,
                closest_m=None,
                reason=None,
            ).write(trial / "verdict.json")
    ExperimentSummary(
        experiment=name,
        string_length_m=0.3,
        target_m=[0.5, 0.5],
        hit_radius_m=0.02,
        verdict="hit" if hits else "no hit",
        hit_trial=hits[0] if hits else None,
        trials=lines,
        next_motion_sha256=None,
    ).write(results / "summary.json")
    return results


@pytest.fixture
def root(tmp_path):
    make(tmp_path, ONE, [line(1, 0.05), line(2, 0.004)])
    make(tmp_path, TWO, [line(1, 0.09), line(2, 0.03), line(3, 0.01, "slipped"), line(4, 0.04)])
    make(tmp_path, OTHER, [line(1, 0.01)])
    make(tmp_path, "paper-quick-string1-target1-seed101-default", [line(1, 0.01)])
    make(tmp_path, "demo", [line(1, 0.01)])
    return tmp_path


def test_only_the_papers_runs_are_found(root):
    assert found(root, "paper") == [case_of(ONE), case_of(TWO), case_of(OTHER)]
    assert finished(root, "paper") == [ONE, TWO, OTHER]
    assert [case.form for case in found(root, "paper-quick")] == ["paper-quick"]
    assert summaries(root, "paper")[0] == f"results/{ONE}/summary.json"


def test_the_last_trial_is_the_hit_or_the_last_that_counts(root):
    assert last_of(root, [ONE, TWO], "a.json") == [
        f"results/{ONE}/trial-02/a.json",
        f"results/{TWO}/trial-04/a.json",
    ]


def test_the_same_string_at_several_targets(root):
    assert same_string(root, ONE) == [ONE, TWO]
    assert same_string(root, OTHER) == []
    assert transfers(root, "paper") == [f"results/{ONE}/transfer.json", f"results/{TWO}/transfer.json"]
    (root / "results" / TWO / "summary.json").unlink()
    assert same_string(root, ONE) == same_string(root, TWO) == []


def test_a_run_without_one_of_its_pieces_is_not_done(root):
    results = root / "results" / ONE
    (results / "trial-02" / "estimate.json").unlink()
    assert states(root, "paper")[0] == f"{ONE} unfinished"
    log = results / "trial-02" / "logs" / "estimate.log"
    log.parent.mkdir()
    log.write_text("estimate 3/4\nSC-E003 ERROR  none of 9 strings\n        Fix: look\n")
    assert states(root, "paper")[0] == f"{ONE} failed"
    assert first_error(results) == "trial-02 estimate: SC-E003 ERROR  none of 9 strings"
    assert ONE not in finished(root, "paper")


def test_a_run_with_a_damaged_verdict_is_not_counted(root):
    folder = ExperimentFolder(root, ONE)
    verdict = folder.results / "trial-02" / "verdict.json"
    verdict.write_text(verdict.read_text().replace("0.004", "0.005"))
    found, reason = state(folder)
    assert found == FAILED
    assert reason.startswith("SC-R001")
    assert ONE not in finished(root, "paper")


def test_a_failure_without_an_error_code_gives_its_last_line(root):
    results = root / "results" / ONE
    (results / "logs").mkdir()
    log = results / "logs" / "calibrate.log"
    log.write_text("Traceback (most recent call last):\n  x\nMemoryError: 8 GB\n\n")
    assert first_error(results) == "calibrate: MemoryError: 8 GB"
    log.write_text("boards 12/12\n")
    assert first_error(results) is None
