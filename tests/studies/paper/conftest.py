"""The paper's experiment in records: runs that are done, failed and unfinished."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from strandcast.core.box import Box
from strandcast.core.strings import PARAMETERS
from strandcast.core.trial_names import trial_name
from strandcast.records.estimate import ENSEMBLE
from strandcast.records.tables import write_table
from strandcast.report.summary import summarise
from strandcast_studies.paper.cases import PaperTarget
from strandcast_studies.paper.records import (
    BudgetThrow,
    ErrorBudget,
    MissWithout,
    PaperRun,
    PaperSummary,
    Transfer,
    TransferPrediction,
)
from strandcast_studies.paper.report.facts import (
    AttachedPipe,
    AttachedWeight,
    PaperFacts,
    StageTime,
    StringFacts,
)
from strandcast_studies.paper.report.summary import summarise_paper

from ...report.conftest import LENGTH_M, TARGET_M, N
from ...report.conftest import results as results


@pytest.fixture(scope="session")
def paper(
    results: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[PaperSummary, dict[str, Path], PaperFacts]:
    """Return the paper's experiment: three done runs, one that failed and one that is not finished."""
    root = tmp_path_factory.mktemp("paper") / "results"
    said = "trial-01 track: SC-V005 ERROR  the string <slipped>"
    runs = [
        paper_run(root, results, 1, 1, "paper", 2),
        paper_run(root, results, 1, 1, "default", 3),
        paper_run(root, results, 1, 2, "default", 2),
        paper_run(root, results, 5, 3, "default", 0, "failed", said),
        paper_run(root, results, 7, 4, "default", 1, "unfinished", "not all of it has been run"),
    ]
    own, other = runs[1].experiment, runs[2].experiment
    for name, values in ((own, (0.002, 0.006)), (other, (0.007, 0.003))):
        Transfer(
            experiment=name,
            trial=3,
            target_m=TARGET_M,
            fits=[
                TransferPrediction(
                    experiment=fit, target_m=TARGET_M, trial=3, E_m=E_m, ensemble_E_m=[E_m, E_m + 0.001, None]
                )
                for fit, E_m in zip((own, other), values, strict=True)
            ],
            planned_from={},
        ).write(root / name / "transfer.json")
    facts = PaperFacts(
        strings={
            1: StringFacts(1, 0.3, N, (AttachedWeight(0.3, 111.0),), ()),
            5: StringFacts(5, 0.51, 17, (AttachedWeight(0.17, 66.7),), (AttachedPipe(0.37, 0.44, 10.0),)),
        },
        targets=[
            PaperTarget(number=1, target_m=(0.5, 0.5), source="paper"),
            PaperTarget(number=2, target_m=(0.75, 0.3), source="ours"),
        ],
        reach_m=0.7,
        workspace_m=Box(x_m=(-0.75, 1.25), y_m=(-0.32, 0.8)),
        times=[StageTime("default", "track", 20.0, 14.0), StageTime("default", "track", 30.0, None)],
        settings={"paper": {"estimate.w": "0.1", "method": "paper"}, "default": {"estimate.w": "0.2"}},
        budget=error_budget(),
    )
    folders = {run.experiment: root / run.experiment for run in runs}
    return summarise_paper(runs, 0.02), folders, facts


def error_budget() -> ErrorBudget:
    """Return the budget of two throws; the servo made the first one miss."""
    throws = [
        BudgetThrow(experiment="x", string=1, target=1, seed=seed, trial=2, miss_m=miss)
        for seed, miss in enumerate(
            [
                {"none": 0.012, "servo": 0.003, "tracking": 0.0119, "all but the model": 0.002},
                {"none": 0.003, "servo": 0.0028, "tracking": 0.0031, "all but the model": 0.002},
            ]
        )
    ]
    lines = [
        MissWithout(cause=c, trial=2, throws=2, median_m=0.005, p90_m=0.01, rms_m=0.008, cause_rms_m=-0.001)
        for c in throws[0].miss_m
    ]
    return ErrorBudget(without=lines, throws=throws)


def paper_run(
    root: Path,
    results: Path,
    string: int,
    target: int,
    method: str,
    trials: int,
    state: str = "done",
    reason: str | None = None,
) -> PaperRun:
    """Write a run with the first trials of the swing; the third hits."""
    name = f"paper-string{string}-target{target}-seed101-{method}"
    folders = {trial: root / name / trial_name(trial) for trial in range(1, trials + 1)}
    rng = np.random.default_rng(target)
    for trial, folder in folders.items():
        shutil.copytree(results / trial_name(trial), folder)
        draws = {name: 10.0 ** rng.uniform(-3, 0, 4) for name in PARAMETERS}
        write_table(
            folder / "ensemble.parquet",
            ENSEMBLE,
            {"member": np.arange(4), "E_m": np.full(4, 0.003)} | draws,
        )
    summary = summarise(
        name, folders, string_length_m=LENGTH_M, target_m=TARGET_M, hit_radius_m=0.02, next_motion=None
    )
    if state == "done":
        summary.write(root / name / "summary.json")
    return PaperRun(
        experiment=name,
        string=string,
        target=target,
        own_target=(string, target) != (1, 2),
        target_m=TARGET_M,
        seed=101,
        method=method,
        state=state,
        reason=reason,
        hit_trial=summary.hit_trial,
        trials=summary.trials,
    )
