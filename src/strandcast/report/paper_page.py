"""The page of the paper's experiment: its tables and figures made anew, and what it comes to."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from strandcast.errors import StrandcastError
from strandcast.records.paper import PaperRun, PaperSummary
from strandcast.records.summary import Summary
from strandcast.report.figures.paper_budget import budget
from strandcast.report.figures.paper_cost import first_fit, times
from strandcast.report.figures.paper_counts import NAMES, misses, rates, trials_to_hit
from strandcast.report.figures.paper_masses import masses
from strandcast.report.figures.paper_parameters import parameters, transfer
from strandcast.report.figures.paper_strings import strings, targets
from strandcast.report.figures.paper_throws import first_and_last, hand, joints, tip
from strandcast.report.figures.paper_words import readings
from strandcast.report.pages import render
from strandcast.report.paper_facts import PaperFacts
from strandcast.report.paper_runs import RunResults, to_show
from strandcast.report.paper_summary import METHODS, chosen
from strandcast.report.reportlet import Reportlet, Table, attempt
from strandcast.report.text import CITATION

# The paper's figures of single throws, and the strings that they are of.
STROBES = {"Fig. 7": 1, "Fig. 9": 5, "Fig. 10": 7}
SINGLE = 1  # Figs. 8a and 8b are of string 1


def paper_page(summary: PaperSummary, folders: Mapping[str, Path], facts: PaperFacts) -> str:
    """Return the HTML page of the paper's experiment.

    Parameters
    ----------
    summary
        All runs in numbers, as `report.paper_summary.summarise_paper` makes it.
    folders
        Experiment -> its folder of results.
    facts
        What no result holds.
    """
    runs = [
        RunResults(run, folders[run.experiment]) for run in summary.experiments if run.experiment in folders
    ]
    reportlets = _reportlets(summary, runs, facts)
    return render(
        "paper.html.jinja",
        headline=_headline(summary),
        summary=summary,
        troubled=[run for run in summary.experiments if run.state != "done"],
        broken=[each for each in reportlets if each.problem is not None],
        reportlets=reportlets,
        citation=CITATION,
        provenance=_provenance(runs, facts),
        names=NAMES,
    )


def _reportlets(summary: PaperSummary, runs: list[RunResults], facts: PaperFacts) -> list[Reportlet]:
    plan: list[tuple[Any, ...]] = [
        ("trials", "Table 3: trials to hit", trials_to_hit, summary),
        ("rates", "Hit rates", rates, summary),
        ("misses", "Miss by trial", misses, summary),
        ("strings", "Fig. 5: the strings", strings, facts),
        ("targets", "Fig. 6: the targets", targets, facts, summary),
    ]
    for figure, string in STROBES.items():
        for method in _thrown(summary, string):
            title = f"{figure}: string {string} ({NAMES[method]})"
            plan.append((f"strobe-{string}-{method}", title, *_single(first_and_last, runs, string, method)))
    for method in _thrown(summary, SINGLE):
        name = NAMES[method]
        plan += [
            (f"tip-{method}", f"Fig. 8a: tip ({name})", *_single(tip, runs, SINGLE, method)),
            (f"hand-{method}", f"Fig. 8b: hand ({name})", *_single(hand, runs, SINGLE, method)),
            (f"joints-{method}", f"Joints ({name})", *_single(joints, runs, SINGLE, method)),
        ]
    plan += [
        ("masses", "Table 4: estimated masses", masses, runs, facts),
        ("parameters", "Fig. 11: one string, fitted at several targets", parameters, runs),
        ("transfer", "Section VIII: what each fit foretells", transfer, runs),
        ("warning", "First fit’s E against the next miss", first_fit, summary),
        ("budget", "Error budget: what throws miss by", budget, facts.budget, summary.hit_radius_m),
        ("readings", "What the paper leaves open", readings, facts),
        ("times", "Wall time by stage", times, facts),
    ]
    unknown = set() if facts.budget else {"budget"}
    if all(run.own_target for run in summary.experiments):
        unknown |= {"parameters", "transfer"}
    return [attempt(*each) for each in plan if each[0] not in unknown]


def _thrown(summary: PaperSummary, string: int) -> list[str]:
    """Return the methods by which a string was thrown, or tried to be, at its own target; ours first."""
    used = {run.method for run in summary.experiments if run.string == string and run.own_target}
    return [method for method in reversed(METHODS) if method in used]


def _single(build: Any, runs: list[RunResults], string: int, method: str) -> tuple[Any, ...]:
    return build, to_show(runs, string, method), f"string {string} by {NAMES[method]}"


def _headline(summary: PaperSummary) -> str:
    told = []
    for method in METHODS:
        runs = chosen(summary.experiments, method)
        if runs:
            hit = sum(run.hit_trial is not None for run in runs)
            told.append(f"{hit} of {len(runs)} runs hit by {NAMES[method]}")
    return "; ".join(told) or "nothing has been thrown yet"


def _provenance(runs: list[RunResults], facts: PaperFacts) -> list[Table]:
    rows = [[each.run.experiment, _hash(each.folder / "summary.json", each.run)] for each in runs]
    tables = [Table(["summary.json of", "content sha256"], rows)]
    if facts.software:
        tables.append(Table(["software", "version"], [list(pair) for pair in sorted(facts.software.items())]))
    return tables


def _hash(path: Path, run: PaperRun) -> str:
    try:
        return Summary.read(path).content_sha256()
    except StrandcastError:
        return f"none ({run.state})"
