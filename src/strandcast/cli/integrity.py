"""Commands on the state of files: verify, unlock."""

import typer

from strandcast.cli.common import ROOT, AsJson, Experiments, show
from strandcast.errors import INTEGRITY


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


def remove_leases(experiments: list[str], as_json: bool) -> None:
    """Remove the leases of runs that were killed; refused while such a run lives."""
    from strandcast.config.find import find_experiment
    from strandcast.workflow.locks import unlock

    for name in experiments:
        find_experiment(name, ROOT)
    found = {name: unlock(ROOT, name) for name in experiments}
    show(as_json, {"experiments": found}, found.values())
