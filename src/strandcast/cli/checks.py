"""Commands that set up and check: new, doctor, check, boards, preview, verify."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, Experiments, TrialNumber, show
from strandcast.errors import ENVIRONMENT, INTEGRITY, REFUSED, StrandcastError, single
from strandcast.records.folders import ExperimentFolder

SHAPES = {"ok": "✓", "note": "·", "problem": "✕"}  # of what `doctor` finds


def new(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="The project's folder, to be made.")],
    as_json: AsJson = False,
) -> None:
    """Make a project: a folder with an example arm, the demo experiment and a Snakefile."""
    from strandcast.workflow.project import make_project

    files = make_project(folder)
    lines = [
        f"{folder}: {len(files)} files",
        "next:",
        f"  cd {shlex.quote(str(folder))}",
        "  strandcast run demo",
    ]
    show(as_json, {"folder": folder, "files": files}, lines)


def doctor(as_json: AsJson = False) -> None:
    """Examine this computer: packages, codecs, cores, memory, disk, clock, compiled kernels, drivers.

    Ends with 3 if a problem would stop a run, else with 0; each problem comes with its fix.
    """
    from strandcast.workflow.doctor import diagnose

    found = diagnose(ROOT)
    problems = sum(each.state == "problem" for each in found)
    lines = []
    for each in found:
        lines.append(f"{SHAPES[each.state]} {each.name:22} {each.found}")
        lines += [f"  {'':22} Fix: {each.fix}"] if each.fix and each.state == "problem" else []
        lines += [f"  {'':22} {each.fix}"] if each.fix and each.state == "note" else []
    counted = "1 problem" if problems == 1 else f"{problems} problems"
    lines.append(counted if problems else "strandcast can run here")
    show(as_json, {"problems": problems, "checks": [each._asdict() for each in found]}, lines)
    raise typer.Exit(ENVIRONMENT if problems else 0)


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


def verify(experiments: Experiments = None, as_json: AsJson = False) -> None:
    """Check that raw files and results are as they were recorded and made, and lie where they belong.

    Lists what differs and ends with 4, else with 0. Other versions of libraries are no fault.
    """
    from strandcast.config.find import find_experiment
    from strandcast.workflow.targets import default_experiments
    from strandcast.workflow.verify import verify as verify_experiment

    names = experiments or default_experiments(ROOT)
    for name in names:
        find_experiment(name, ROOT)
    findings = [finding for name in names for finding in verify_experiment(ROOT, name)]
    faults = sum(finding.state != "versions" for finding in findings)
    lines = [
        f"{each.state:9}  {each.file}: {each.what}" + (f"\n{'':11}Fix: {each.fix}" if each.fix else "")
        for each in findings
    ]
    files = "1 file differs" if faults == 1 else f"{faults} files differ"
    lines.append(f"{', '.join(names)}: {files if faults else 'all files are as made'}")
    found = [each._asdict() for each in findings]
    show(as_json, {"experiments": names, "faults": faults, "findings": found}, lines)
    raise typer.Exit(INTEGRITY if faults else 0)
