from pathlib import Path

import pytest

from strandcast.core.trial_names import trial_name
from strandcast.records.motion import Motion
from strandcast.records.summary import ExperimentSummary
from strandcast.records.verdict import Verdict
from strandcast.report.summary import summarise

GIVEN = {"string_length_m": 0.3, "target_m": [0.606, 0.674], "hit_radius_m": 0.02}


def test_the_summary_holds_the_values_of_the_records(results: Path, tmp_path: Path) -> None:
    trials = {k: results / trial_name(k) for k in (1, 2, 3)}
    next_motion = results / "trial-04" / "motion.json"
    summary = summarise("swing", trials, **GIVEN, excluded={2: "slipped"}, next_motion=next_motion)
    assert summary.hit_trial == 3
    assert summary.next_motion_sha256 == Motion.read(next_motion).content_sha256()
    assert [line.excluded for line in summary.trials] == [None, "slipped", None]
    assert [line.E_planned_m for line in summary.trials] == [0.0262, 0.0054, 0.0054]
    assert [line.E_m for line in summary.trials] == [0.0031, 0.0024, 0.0024]
    assert summary.trials[0].tracked_fraction == 0.994
    assert summary.trials[0].alignment_offset_s == pytest.approx(0.7314)
    assert summary.trials[2].miss_m == Verdict.read(trials[3] / "verdict.json").miss_m
    summary.write(tmp_path / "summary.json")
    assert ExperimentSummary.read(tmp_path / "summary.json") == summary


def test_an_excluded_trial_does_not_hit(results: Path) -> None:
    summary = summarise(
        "swing", {3: results / "trial-03"}, **GIVEN, excluded={3: "the string was held twice"}
    )
    assert summary.hit_trial is None
    assert summary.trials[0].hit


def test_missing_values_are_null(tmp_path: Path) -> None:
    (tmp_path / "trial-01").mkdir()
    line = summarise("swing", {1: tmp_path / "trial-01"}, **GIVEN).trials[0]
    assert not line.hit
    assert {line.miss_m, line.E_m, line.tracked_fraction, line.alignment_offset_s} == {None}
