"""A throw of the lab: the planned motion played, filmed and logged."""

from __future__ import annotations

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.lab import throw as lab
from strandcast.stages.context import context_of


def run(root: Path, name: str, trial: int) -> None:
    """Write data/<experiment>/trial-NN/ and, for tests and the lab's section of the report, the truth."""
    context = context_of(root, name)
    results = context.folder.trial(trial).results
    lab.throw(
        context.settings,
        name,
        load_arm(context.arm_file),
        trial,
        results / "motion.json",
        context.folder.data,
        results / "lab_truth.parquet",
    )
