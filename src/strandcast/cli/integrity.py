"""Commands on the state of files: verify, unlock."""

import json
from typing import Annotated

import typer

from strandcast.cli.common import ROOT
from strandcast.errors import INTEGRITY

Experiments = Annotated[list[str] | None, typer.Argument(metavar="[EXPERIMENT]...")]


def verify(
    experiments: Experiments = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object per finding.")] = False,
) -> None:
    """Check that all raw files and results are as they were recorded and made, and belong where they lie.

    Lists what differs and ends with 4, else with 0. Other versions of libraries are listed, but no fault.
    """
    from strandcast.config.find import find_experiment
    from strandcast.workflow.targets import default_experiments
    from strandcast.workflow.verify import verify as verify_experiment

    names = experiments or default_experiments(ROOT)
    for name in names:
        find_experiment(name, ROOT)
    findings = [finding for name in names for finding in verify_experiment(ROOT, name)]
    for finding in findings:
        file = finding.file.as_posix()
        if as_json:
            print(json.dumps(finding._asdict() | {"file": file}))
        else:
            print(
                f"{finding.state:9}  {file}: {finding.what}"
                + (f"\n{'':11}Fix: {finding.fix}" if finding.fix else "")
            )
    faults = sum(finding.state != "versions" for finding in findings)
    if not as_json:
        print(
            f"{', '.join(names)}: {faults} files differ"
            if faults
            else f"{', '.join(names)}: all files are as made"
        )
    raise typer.Exit(INTEGRITY if faults else 0)


def unlock(experiments: Annotated[list[str], typer.Argument(metavar="EXPERIMENT...")]) -> None:
    """Remove the lease of a run that was killed; refused while that run lives."""
    from strandcast.workflow.locks import unlock as unlock_experiment

    for name in experiments:
        print(unlock_experiment(ROOT, name))
