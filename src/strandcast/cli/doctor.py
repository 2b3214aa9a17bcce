"""The command that examines the computer: doctor."""

import typer

from strandcast.cli.common import ROOT, AsJson, show
from strandcast.errors import ENVIRONMENT

SHAPES = {"ok": "✓", "note": "·", "problem": "✕"}


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
