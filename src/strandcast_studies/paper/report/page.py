"""The page of the paper's experiment: the paper's tables and figures with our results."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from strandcast.errors import StrandcastError
from strandcast.records.summary import ExperimentSummary, VersionGroup, group_by_versions
from strandcast.report.pages import render
from strandcast.report.panels.content import Panel, PanelContent, Table, make_sections
from strandcast.report.provenance import mixed_versions, version_tables
from strandcast.report.text import CITATION
from strandcast_studies.paper.figures.budget import budget
from strandcast_studies.paper.figures.cost import first_fit, times
from strandcast_studies.paper.figures.counts import NAMES, misses, rates, trials_to_hit
from strandcast_studies.paper.figures.masses import masses
from strandcast_studies.paper.figures.parameters import parameters, transfer
from strandcast_studies.paper.figures.strings import strings, targets
from strandcast_studies.paper.figures.throws import first_and_last, hand, joints, tip
from strandcast_studies.paper.figures.words import readings
from strandcast_studies.paper.records import PaperRun, PaperSummary
from strandcast_studies.paper.report.facts import PaperFacts
from strandcast_studies.paper.report.runs import RunResults, to_show
from strandcast_studies.paper.report.summary import METHODS, chosen

# The paper's figures of single throws, and the strings in them.
STROBES = {"Fig. 7": 1, "Fig. 9": 5, "Fig. 10": 7}
SINGLE = 1  # Figs. 8a and 8b are of string 1

# How to read each panel, by the first word of its name.
CAPTIONS = {
    "trials": "The paper’s column is for its own robot, strings and targets: it gives only the first "
    "target’s place, and no hit tolerance.",
    "rates": "Strings at their own targets. Bars: Wilson’s 95 % interval. A run stops at its first hit, but "
    "not before its second throw: from the third trial on, rates of radii below the hit radius are lower "
    "bounds. A failed run counts as no hit.",
    "misses": "Strings at their own targets; open marks: every throw; bars: medians. A run ends with its "
    "hit, so later trials are those of the harder runs; the table’s “nearest so far” includes all runs.",
    "strings": "Lengths, weights and pipes are the paper’s; their places, density, stiffness and curl are "
    "ours (Table 4’s indices cannot be matched to millimetres with certainty).",
    "targets": "Solid circle: reach of the outstretched hand; dotted: with a string of each length. The "
    "paper prints only the first target’s place; its text mentions five targets, its Fig. 5 four.",
    "strobe": "Good: the dashed string covers the solid one up to the closest approach. The defaults fit no "
    "further: everything after it is predicted.",
    "tip": "The throw that hit, or the last one. “As planned”: the string for which the motion was planned, "
    "driven by the measured joints; “fitted”: the string after this throw. Ring: hit radius.",
    "hand": "Squares: where the motion starts.",
    "joints": "As planned. The paper keeps posture and duration and changes heights by up to 0.5 rad/s; the "
    "defaults may change more, or plan from the start.",
    "masses": "Masses in plain points, from the last fit of every run at the string’s own target; median "
    "over seeds. Black bars: true weights; hatched: pipes; the table adds up the masses of a pipe’s points. "
    "Both methods are given the places but not the masses. The paper’s masses end at about 20; a weight of "
    "10 g on light cord has 28 to 111.",
    "parameters": "Large marks: the last fit at each target; small ones: its near-best strings. As the paper "
    "says, each target has its own parameters: a motion does not determine what it does not excite. k_ph, "
    "drag and masses are on the runs’ own pages.",
    "transfer": "Rows: the throw; columns: the target at which the string was fitted; E (w = 0) of the best "
    "string, and least … greatest of the ensemble. The diagonal was fitted. Good: other columns are nearly "
    "as small.",
    "warning": "Good: nothing in the upper left, where a miss follows a good fit. All targets; runs that "
    "ended with their first throw are not included.",
    "budget": "In the lab, with supplied tracks: causes are switched off one at a time, and all from the fit "
    "on is repeated. A cause’s share is computed from mean squares, which a single large miss can dominate; "
    "negative: throws happened to be worse without it.",
    "readings": "Of two values, the first is for the paper’s method, the second the default. Values that the "
    "paper does not give are settings in config/paper.yaml.",
    "times": "From the logs beside the results, for the last run of every job; no other result contains "
    "times.",
}


def paper_page(summary: PaperSummary, folders: Mapping[str, Path], facts: PaperFacts) -> str:
    """Return the HTML page of the paper's experiment; `folders` maps an experiment to its results."""
    runs = [
        RunResults(run, folders[run.experiment]) for run in summary.experiments if run.experiment in folders
    ]
    sections = make_sections(_panels(summary, runs, facts), summary)
    made_with = _made_with(runs)
    return render(
        "paper.html.jinja",
        "strandcast_studies.paper.report",
        headline=_headline(summary),
        summary=summary,
        troubled=[run for run in summary.experiments if run.state != "done"],
        broken=[each for each in sections if each.problem is not None],
        sections=sections,
        citation=CITATION,
        mixed_versions=mixed_versions(made_with),
        provenance=_provenance(runs, made_with),
        names=NAMES,
    )


def _panels(summary: PaperSummary, runs: list[RunResults], facts: PaperFacts) -> list[Panel]:
    """Return the panels of the page, in order."""
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
            plan.append((f"strobe-{string}-{method}", title, _of_run(first_and_last), runs, string, method))
    for method in _thrown(summary, SINGLE):
        for name, title, build in (
            ("tip", "Fig. 8a: tip", tip),
            ("hand", "Fig. 8b: hand", hand),
            ("joints", "Joints", joints),
        ):
            plan.append(
                (f"{name}-{method}", f"{title} ({NAMES[method]})", _of_run(build), runs, SINGLE, method)
            )
    plan += [
        ("masses", "Table 4: estimated masses", masses, runs, facts),
        ("parameters", "Fig. 11: one string, fitted at several targets", parameters, runs),
        ("transfer", "Section VIII: predictions of each fit", transfer, runs),
        ("warning", "First fit’s E against the next miss", first_fit, summary),
        ("budget", "Error budget: misses by cause", budget, facts.budget, summary.hit_radius_m),
        ("readings", "Interpretation of the paper", readings, facts),
        ("times", "Wall time by stage", times, facts),
    ]
    unknown = set() if facts.budget else {"budget"}
    if all(run.own_target for run in summary.experiments):
        unknown |= {"parameters", "transfer"}
    return [_panel(*each) for each in plan if each[0] not in unknown]


def _panel(name: str, title: str, build: Callable[..., PanelContent], *given: Any) -> Panel:
    caption = CAPTIONS.get(name.partition("-")[0], "")
    return Panel(name, title, lambda _: build(*given), caption=caption)


def _thrown(summary: PaperSummary, string: int) -> list[str]:
    """Return the methods of a string's runs at its own target, failed ones included; ours first."""
    used = {run.method for run in summary.experiments if run.string == string and run.own_target}
    return [method for method in reversed(METHODS) if method in used]


def _of_run(build: Callable[[RunResults], PanelContent]) -> Callable[..., PanelContent]:
    """Return the function of a single run's panel, from all runs, a string and a method."""
    return lambda *given: build(to_show(*given))


def _headline(summary: PaperSummary) -> str:
    parts = []
    for method in METHODS:
        runs = chosen(summary.experiments, method)
        if runs:
            hit = sum(run.hit_trial is not None for run in runs)
            parts.append(f"{hit} of {len(runs)} runs hit with {NAMES[method]}")
    return "; ".join(parts) or "nothing has been thrown yet"


def _provenance(runs: list[RunResults], made_with: list[VersionGroup]) -> list[Table]:
    rows = [[each.run.experiment, _hash(each.folder / "summary.json", each.run)] for each in runs]
    return [Table(["summary.json of", "content sha256"], rows), *version_tables(made_with)]


def _made_with(runs: list[RunResults]) -> list[VersionGroup]:
    """Return the versions that made the runs' results, from all readable summaries."""
    pairs = []
    for each in runs:
        try:
            groups = ExperimentSummary.read(each.folder / "summary.json").made_with
        except StrandcastError:
            continue
        pairs += [(each.run.experiment, group.versions) for group in groups]
    return group_by_versions(pairs)


def _hash(path: Path, run: PaperRun) -> str:
    try:
        return ExperimentSummary.read(path).content_sha256()
    except StrandcastError:
        return f"none ({run.state})"
