"""Commands that check, preview or print before anything runs: check, schema, boards, preview."""

from pathlib import Path
from typing import Annotated

import typer

from strandcast.cli.common import ROOT, ExperimentName, TrialNumber
from strandcast.errors import StrandcastError
from strandcast.records.folders import ExperimentFolder


def check(experiment: ExperimentName) -> None:
    """Check an experiment's file and its arm's file before anything runs."""
    from strandcast.arm.link_masses import torque_gap
    from strandcast.arm.load import load_arm
    from strandcast.config.find import find_arm, find_experiment
    from strandcast.config.load import load_experiment

    path = find_experiment(experiment, ROOT)
    settings = load_experiment(path)
    arm = load_arm(find_arm(settings, path, ROOT))
    shared = {m.id for m in arm.markers} & {m.id for m in settings.camera.plane.markers}
    if shared and arm.marker_dictionary == settings.camera.plane.dictionary:
        raise StrandcastError(
            "SC-F006",
            f"the hand's markers have the ids {sorted(shared)} too",
            file=path,
            field="camera.plane.markers",
            fix="give the plane's markers other ids",
        )
    print(
        f"{path}: valid; string of {settings.string.length_m} m as {settings.string.n} points, arm {arm.name}"
    )
    gap = torque_gap(arm)
    if gap is not None:
        print(f"warning: {gap}")


def schema() -> None:
    """Print the JSON schema of experiment.yaml, for use in editors."""
    from strandcast.config.schema import json_schema

    print(json_schema(), end="")


def boards(
    experiment: ExperimentName,
    out: Annotated[
        Path | None, typer.Option(help="Output folder (default: results/EXPERIMENT/boards).")
    ] = None,
    png: Annotated[bool, typer.Option("--png", help="Write PNG with its resolution instead of PDF.")] = False,
) -> None:
    """Write an experiment's marker boards as PDF files to print at true size."""
    from strandcast.stages import boards as stage

    folder = out or ExperimentFolder(ROOT, experiment).results / "boards"
    for path in stage.run(ROOT, experiment, folder, "png" if png else "pdf"):
        print(path)


def preview(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Show within seconds what the tracker detects in a few frames of a trial."""
    from strandcast.stages import preview as stage

    for line in stage.run(ROOT, experiment, trial):
        print(line)
