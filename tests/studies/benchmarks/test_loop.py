"""The loop with supplied tracks: one small run through all stages, and the summaries of many."""

import shutil
from pathlib import Path

import pytest

from strandcast_studies.benchmarks.loop import distance as loop_distance
from strandcast_studies.benchmarks.loop import error_budget as loop_budget
from strandcast_studies.benchmarks.loop import oracle as loop_oracle
from strandcast_studies.benchmarks.loop import run as loop
from strandcast_studies.paper.cases import PaperCase
from strandcast_studies.paper.records import BudgetThrow

CASE = PaperCase("paper", 11, 1, 1, "default")
SMALL = {"plan": {"evaluations": 240}, "estimate": {"evaluations": 800}}


@pytest.fixture(scope="module")
def thrown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[loop.LoopTrial]]:
    root = tmp_path_factory.mktemp("loop")
    shutil.copytree(loop.PROJECT / "config" / "arms", root / "config" / "arms")
    before = loop.VARIANTS["default"]
    loop.VARIANTS["default"] = SMALL
    try:
        return root, loop.run_case(root, CASE, 2)
    finally:
        loop.VARIANTS["default"] = before


@pytest.mark.thorough
def test_a_run_throws_fits_and_improves(thrown: tuple[Path, list[loop.LoopTrial]]) -> None:
    first, second = thrown[1]
    assert (first.kind, first.trial, second.trial) == ("first", 1, 2)
    assert first.E_m is not None
    assert first.E_m < 0.006
    # The track gives the true miss, up to its noise.
    assert first.miss_m == pytest.approx(first.true_miss_m, abs=0.003)
    assert second.true_miss_m < 0.02


@pytest.mark.thorough
def test_oracle_and_distance_follow_a_run(
    thrown: tuple[Path, list[loop.LoopTrial]], monkeypatch: pytest.MonkeyPatch
) -> None:
    root = thrown[0]
    monkeypatch.setattr(loop_oracle, "ROUNDS", 2)
    monkeypatch.setattr(loop_oracle, "DRAWS", 1)
    (row,) = loop_oracle.rows_of(root, CASE.name)
    assert row["oracle_m"] <= row["planned_m"] + 1e-9
    assert row["oracle_m"] < 0.004
    monkeypatch.setattr(loop_distance, "DISTANCES_RAD_S", (0.05, 1.0))
    near, *_, far = loop_distance.rows_of(root, CASE.name)
    assert near["carried_m"] < 0.01
    assert far["distance_rad_s"] == 1.0


@pytest.mark.thorough
def test_the_budget_reuses_the_first_motion_and_switches_causes_off(
    thrown: tuple[Path, list[loop.LoopTrial]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    root, (first, _) = thrown
    shutil.copytree(loop.PROJECT / "config" / "arms", tmp_path / "config" / "arms")
    monkeypatch.setattr(loop_budget, "TRIALS", (1,))
    usual, nominal = (
        loop_budget.throws_without(tmp_path, root, CASE, cause)[0] for cause in ("none", "all but the model")
    )
    assert usual == pytest.approx(first.true_miss_m)
    assert nominal != pytest.approx(usual, abs=1e-5)


def test_a_cause_adds_in_squares() -> None:
    def one(usual_m: float, without_m: float) -> BudgetThrow:
        miss_m = dict.fromkeys(loop_budget.CAUSES, without_m) | {"none": usual_m}
        return BudgetThrow(experiment="x", string=1, target=1, seed=1, trial=2, miss_m=miss_m)

    budget = loop_budget.summary_of([one(0.005, 0.003), one(0.005, 0.003)])
    added = {line.cause: line.cause_rms_m for line in budget.without if line.trial == 2}
    assert added["none"] == 0.0
    assert added["servo"] == pytest.approx(0.004)
    assert loop_budget.summary_of([one(0.003, 0.005)]).without[-1].cause_rms_m == pytest.approx(-0.004)


def test_a_list_of_numbers_may_have_ranges() -> None:
    assert loop.numbers("1,3,7-9") == [1, 3, 7, 8, 9]


def test_a_summary_counts_failed_runs_and_unknown_misses() -> None:
    def run(misses: list[float | None], error: str | None = None) -> dict:
        return {"error": error, "trials": [{"miss_m": miss} for miss in misses]}

    summary = loop.summary_of([run([0.030, 0.004]), run([0.010, None]), run([], "it broke")])
    assert summary["failed"] == 1
    by = {(rate["radius_m"], rate["trial"]): rate["share"] for rate in summary["rates"]}
    assert by[(0.020, 1)] == pytest.approx(1 / 3)
    assert by[(0.020, 2)] == pytest.approx(2 / 3)
    assert summary["misses"][1]["known"] == 1
