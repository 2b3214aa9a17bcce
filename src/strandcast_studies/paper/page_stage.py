"""The summary and the page of the paper's experiment, from its existing runs."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.config.experiment import Experiment
from strandcast.errors import StrandcastError
from strandcast.lab.strings import PAPER_STRINGS
from strandcast.records.files import write_text
from strandcast.records.folders import ExperimentFolder, trial_folders
from strandcast.records.summary import ExperimentSummary
from strandcast.report.facts import Facts
from strandcast.report.summary import summarise
from strandcast_studies.paper.cases import (
    FILE,
    QUICK,
    WHOLE,
    PaperCase,
    PaperPlan,
    cases,
    load_plan,
    settings_of,
)
from strandcast_studies.paper.gather import found, state
from strandcast_studies.paper.records import ErrorBudget, PaperRun
from strandcast_studies.paper.report.facts import (
    AttachedPipe,
    AttachedWeight,
    PaperFacts,
    StageTime,
    StringFacts,
)
from strandcast_studies.paper.report.page import paper_page
from strandcast_studies.paper.report.summary import METHODS, summarise_paper

BUDGET = "error-budget.json"  # under results; `make error-budget` measures it


def run(root: Path, form: str) -> None:
    """Write {summary.json, report.html} of results/paper or results/paper-quick."""
    if form not in (WHOLE, QUICK):
        what, fix = f"there is no form {form!r} of the paper's page", f"give {WHOLE} or {QUICK}"
        raise StrandcastError("SC-Z006", what, field="form", fix=fix)
    plan = load_plan(root / FILE)
    there = found(root, form)
    summary = summarise_paper([_run(root, plan, case) for case in there], _common(plan).hit_radius_m)
    folders = {case.name: ExperimentFolder(root, case.name).results for case in there}
    page = paper_page(summary, folders, _facts(root, plan, form, there))
    results = root / "results" / form
    summary.write(results / "summary.json")
    write_text(results / "report.html", page)


def _run(root: Path, plan: PaperPlan, case: PaperCase) -> PaperRun:
    """Return one run from its summary; if it is not done, from its existing trials."""
    folder = ExperimentFolder(root, case.name)
    how, reason = state(folder)
    target_m = list(plan.target(case.target).target_m)
    if how == "done":
        summary = ExperimentSummary.read(folder.results / "summary.json")
    else:
        trials = trial_folders(folder.results)
        scored = {number: each for number, each in trials.items() if (each / "verdict.json").exists()}
        summary = summarise(
            case.name,
            scored,
            string_length_m=plan.string(case.string).string.length_m,
            target_m=target_m,
            hit_radius_m=_common(plan).hit_radius_m,
        )
    return PaperRun(
        experiment=case.name,
        string=case.string,
        target=case.target,
        own_target=case.target == plan.string(case.string).target,
        target_m=target_m,
        seed=case.seed,
        method=case.method,
        state=how,
        reason=reason,
        hit_trial=summary.hit_trial,
        trials=summary.trials,
    )


def _facts(root: Path, plan: PaperPlan, form: str, there: list[PaperCase]) -> PaperFacts:
    common = _common(plan)
    arm = load_arm(root / "config" / "arms" / f"{common.arm}.toml").planar()
    budget = root / "results" / BUDGET
    return PaperFacts(
        strings={one.number: _string(plan, one.number) for one in plan.strings},
        targets=plan.targets,
        reach_m=float(arm.chain.lengths_m.sum() + np.hypot(*arm.clamp.offset_m)),
        workspace_m=common.workspace_m,
        times=[time for case in there for time in _times(ExperimentFolder(root, case.name).results, case)],
        settings={method: _settings(plan, form, method) for method in METHODS if method in plan.methods},
        budget=ErrorBudget.read(budget) if budget.exists() else None,
    )


def _string(plan: PaperPlan, number: int) -> StringFacts:
    """Return a string of the lab with its weights and pipes, in units of the model's plain points."""
    known, thread = plan.string(number).string, PAPER_STRINGS[f"paper-{number}"]
    plain_kg = thread.linear_density_kg_m * thread.length_m / known.n
    return StringFacts(
        number,
        thread.length_m,
        known.n,
        tuple(AttachedWeight(place_m, mass_kg / plain_kg) for place_m, mass_kg in thread.weights),
        tuple(AttachedPipe(from_m, to_m, mass_kg / plain_kg) for from_m, to_m, mass_kg in thread.pipes),
    )


def _common(plan: PaperPlan) -> Experiment:
    """Return an example experiment: all share arm, workspace and hit radius."""
    return _experiment(plan, cases(plan)[0])


def _experiment(plan: PaperPlan, case: PaperCase) -> Experiment:
    return Experiment.model_validate_json(json.dumps(settings_of(plan, case)), strict=True)


def _settings(plan: PaperPlan, form: str, method: str) -> dict[str, str]:
    case = cases(plan, quick=form != cases(plan)[0].form, methods=[method])[0]
    return dict(Facts(settings=_experiment(plan, case).model_dump(mode="json")).flat_settings())


def _times(results: Path, case: PaperCase) -> list[StageTime]:
    """Return the jobs' times from the JSON lines that Snakemake's `benchmark` wrote."""
    times = []
    for path in sorted(results.glob("**/logs/*.jsonl")):
        lines = path.read_text(encoding="utf-8").splitlines()
        line: dict[str, Any] = json.loads(lines[-1]) if lines else {}
        wall, processor = line.get("s"), line.get("cpu_time")
        if isinstance(wall, int | float):
            known = float(processor) if isinstance(processor, int | float) else None
            times.append(StageTime(case.method, path.stem, float(wall), known))
    return times
