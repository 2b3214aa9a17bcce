"""Commands that check, preview or print before anything runs: check, boards, preview."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, Experiments, TrialNumber, show
from strandcast.errors import REFUSED, StrandcastError, single
from strandcast.records.folders import ExperimentFolder


def check(
    experiments: Experiments = None,
    fix: Annotated[
        bool, typer.Option("--fix", help="Write settings that were renamed or dropped as they are now.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check settings, arm, reach of the target, markers, photos, raw files and names before anything runs."""
    from strandcast.config.find import find_experiment, overlooked_experiments
    from strandcast.config.fix import fix_names
    from strandcast.workflow.check import check_experiment
    from strandcast.workflow.targets import default_experiments

    names = experiments or default_experiments(ROOT)
    lines, not_fixed = [], {}
    for name in names if experiments or fix else []:
        file = find_experiment(name, ROOT)
        try:
            if fix and (count := fix_names(file)):
                lines.append(f"{file}: {count} former settings written as they are now")
        except StrandcastError as error:  # it stops only itself
            not_fixed[name] = single(error)
    found = {name: check_experiment(ROOT, name) for name in names}
    for name, problems in not_fixed.items():
        found[name].errors = found[name].errors or problems
    elsewhere = [] if experiments else overlooked_experiments(ROOT)
    for name, each in found.items():
        counts = ("error", len(each.errors)), ("warning", len(each.warnings))
        wrong = ", ".join(f"{count} {word}{'s' * (count > 1)}" for word, count in counts if count)
        lines += [f"{name}: {wrong or 'nothing is wrong'}", *(f"  {fact}" for fact in each.facts)]
        lines += [error.message() for error in each.errors]
        lines += [warning.message("WARNING") for warning in each.warnings]
        following = "check {}" if each.errors else each.after
        lines += [f"next: strandcast {following.format(shlex.quote(name))}"]
    data = {
        "experiments": {
            name: {
                "errors": [error.to_json() for error in each.errors],
                "warnings": [warning.to_json() for warning in each.warnings],
                "facts": each.facts,
            }
            for name, each in found.items()
        },
        "overlooked": [error.to_json() for error in elsewhere],
    }
    show(as_json, data, [*lines, *(error.message("WARNING") for error in elsewhere)])
    raise typer.Exit(REFUSED if any(each.errors for each in found.values()) else 0)


def boards(
    experiment: ExperimentName,
    out: Annotated[
        Path | None, typer.Option(help="Output folder (default: results/EXPERIMENT/boards).")
    ] = None,
    png: Annotated[bool, typer.Option("--png", help="Write PNG with its resolution instead of PDF.")] = False,
    as_json: AsJson = False,
) -> None:
    """Write an experiment's marker boards as PDF files to print at true size."""
    from strandcast.stages import boards as stage

    folder = out or ExperimentFolder(ROOT, experiment).results / "boards"
    written = stage.run(ROOT, experiment, folder, "png" if png else "pdf")
    show(as_json, {"experiment": experiment, "files": written}, map(str, written))


def preview(experiment: ExperimentName, trial: TrialNumber, as_json: AsJson = False) -> None:
    """Show within seconds what the tracker detects in a few frames of a trial."""
    from strandcast.stages import preview as stage

    lines = stage.run(ROOT, experiment, trial)
    found = {"experiment": experiment, "trial": trial, "findings": lines[1:-1], "picture": lines[-1]}
    show(as_json, found, lines)
