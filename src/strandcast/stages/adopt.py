"""The motion that a real arm has played, taken into the results as the trial's motion."""

from __future__ import annotations

import shutil
from pathlib import Path

from strandcast.records.files import atomic_write
from strandcast.records.motion import Motion
from strandcast.stages.context import context_of


def run(root: Path, name: str, trial: int) -> None:
    """Copy motion.json from data/ to results/ after a verified read."""
    folder = context_of(root, name).folder.trial(trial)
    Motion.read(folder.data / "motion.json")
    with atomic_write(folder.results / "motion.json") as temporary:
        shutil.copyfile(folder.data / "motion.json", temporary)
