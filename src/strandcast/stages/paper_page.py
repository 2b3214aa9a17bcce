"""The paper's experiment as a whole: summary.json and page, from whatever of it is there."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from strandcast import __version__
from strandcast.arm.load import load_arm
from strandcast.experiment import Experiment
from strandcast.lab.strings import PAPER_STRINGS
from strandcast.layout import ExperimentFolder
from strandcast.paper.cases import FILE, Case, Plan, cases, load_plan, settings_of
from strandcast.paper.gather import found, state
from strandcast.records.budget import ErrorBudget
from strandcast.records.files import write_text
from strandcast.records.paper import PaperRun
from strandcast.records.summary import Summary
from strandcast.report.facts import Facts
from strandcast.report.paper_facts import Hung, PaperFacts, Pipe, StageTime, StringFacts, TargetFacts
from strandcast.report.paper_page import paper_page
from strandcast.report.paper_summary import METHODS, summarise_paper
from strandcast.report.summary import summarise
from strandcast.stages.pages import SOFTWARE

BUDGET = "error-budget.json"  # under results; `make error-budget` measures it


def run(root: Path, form: str) -> None:
    """Write {summary.json, report.html} of results/paper or results/paper-quick."""
    plan = load_plan(root / FILE)
    there = found(root, form)
    summary = summarise_paper([_run(root, plan, case) for case in there], _common(plan).hit_radius_m)
    folders = {case.name: ExperimentFolder(root, case.name).results for case in there}
    page = paper_page(summary, folders, _facts(root, plan, form, there))
    results = root / "results" / form
    summary.write(results / "summary.json")
    write_text(results / "report.html", page)


def _run(root: Path, plan: Plan, case: Case) -> PaperRun:
    """Return one run: its summary if it is done, else what its trials that are there say."""
    folder = ExperimentFolder(root, case.name)
    how, reason = state(folder)
    target_m = list(plan.target(case.target).target_m)
    if how == "done":
        summary = Summary.read(folder.results / "summary.json")
    else:
        judged = sorted(folder.results.glob("trial-[0-9][0-9]/verdict.json"))
        numbers = [int(path.parent.name.removeprefix("trial-")) for path in judged]
        summary = summarise(
            case.name,
            {number: folder.trial(number).results for number in numbers},
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


def _facts(root: Path, plan: Plan, form: str, there: list[Case]) -> PaperFacts:
    common = _common(plan)
    arm = load_arm(root / "config" / "arms" / f"{common.arm}.toml")
    box = common.workspace_m
    budget = root / "results" / BUDGET
    return PaperFacts(
        strings={one.number: _string(plan, one.number) for one in plan.strings},
        targets={t.number: TargetFacts(t.number, t.target_m, t.source == "paper") for t in plan.targets},
        reach_m=float(arm.chain.lengths_m.sum() + np.hypot(*arm.clamp.offset_m)),
        workspace_m=None if box is None else (*box.x_m, *box.y_m),
        times=[time for case in there for time in _times(ExperimentFolder(root, case.name).results, case)],
        settings={method: _settings(plan, form, method) for method in METHODS if method in plan.methods},
        software={"strandcast": __version__} | {name: version(name) for name in SOFTWARE},
        budget=ErrorBudget.read(budget) if budget.exists() else None,
    )


def _string(plan: Plan, number: int) -> StringFacts:
    """Return a string of the lab with what hangs on it, in plain points of the model."""
    known, thread = plan.string(number).string, PAPER_STRINGS[f"paper-{number}"]
    plain_kg = thread.linear_density_kg_m * thread.length_m / known.n
    return StringFacts(
        number,
        thread.length_m,
        known.n,
        tuple(Hung(place_m, mass_kg / plain_kg) for place_m, mass_kg in thread.weights),
        tuple(Pipe(from_m, to_m, mass_kg / plain_kg) for from_m, to_m, mass_kg in thread.pipes),
    )


def _common(plan: Plan) -> Experiment:
    """Return any one experiment: all share arm, workspace and hit radius."""
    return _experiment(plan, cases(plan)[0])


def _experiment(plan: Plan, case: Case) -> Experiment:
    return Experiment.model_validate_json(json.dumps(settings_of(plan, case)), strict=True)


def _settings(plan: Plan, form: str, method: str) -> dict[str, str]:
    case = cases(plan, quick=form != cases(plan)[0].form, methods=[method])[0]
    return dict(Facts(settings=_experiment(plan, case).model_dump(mode="json")).flat_settings())


def _times(results: Path, case: Case) -> list[StageTime]:
    """Return what the logs say that the jobs took: lines of JSON that Snakemake's `benchmark` wrote."""
    times = []
    for path in sorted(results.glob("**/logs/*.jsonl")):
        lines = path.read_text(encoding="utf-8").splitlines()
        line: dict[str, Any] = json.loads(lines[-1]) if lines else {}
        wall, processor = line.get("s"), line.get("cpu_time")
        if isinstance(wall, int | float):
            known = float(processor) if isinstance(processor, int | float) else None
            times.append(StageTime(case.method, path.stem, float(wall), known))
    return times
