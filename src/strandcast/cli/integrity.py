"""Commands on the state of files: verify, unlock."""

from pathlib import Path
from typing import Annotated

import typer

from strandcast.cli.common import ROOT, AsJson, Experiments, show
from strandcast.errors import INTEGRITY


def verify(
    experiments: Experiments = None,
    crate: Annotated[
        Path | None, typer.Option(help="Check an RO-Crate instead, a folder or a .zip of `export crate`.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check that raw files and results are as they were recorded and made, and lie where they belong.

    Lists what differs and ends with 4, else with 0. Other versions of libraries are no fault.
    """
    from strandcast.config.find import find_experiment
    from strandcast.workflow.targets import default_experiments
    from strandcast.workflow.verify import verify as verify_experiment
    from strandcast.workflow.verify_crate import verify_crate

    if crate is not None and experiments:
        raise typer.BadParameter("give experiments or --crate, not both")
    names = [] if crate is not None else experiments or default_experiments(ROOT)
    for name in names:
        find_experiment(name, ROOT)
    findings = [finding for name in names for finding in verify_experiment(ROOT, name)]
    if crate is not None:
        names, findings = [str(crate)], verify_crate(crate)
    faults = sum(finding.state != "versions" for finding in findings)
    lines = [
        f"{each.state:9}  {each.file}: {each.what}" + (f"\n{'':11}Fix: {each.fix}" if each.fix else "")
        for each in findings
    ]
    files = "1 file differs" if faults == 1 else f"{faults} files differ"
    lines.append(f"{', '.join(names)}: {files if faults else 'all files are as made'}")
    found = {
        "experiments" if crate is None else "crate": names if crate is None else str(crate),
        "faults": faults,
        "findings": [each._asdict() for each in findings],
    }
    show(as_json, found, lines)
    raise typer.Exit(INTEGRITY if faults else 0)


def remove_leases(experiments: list[str], as_json: bool) -> None:
    """Remove the leases of runs that were killed; refused while such a run lives."""
    from strandcast.config.find import find_experiment
    from strandcast.workflow.locks import unlock

    for name in experiments:
        find_experiment(name, ROOT)
    found = {name: unlock(ROOT, name) for name in experiments}
    show(as_json, {"experiments": found}, found.values())
