"""The lab's calibration photos."""

from __future__ import annotations

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.lab.throw import set_up
from strandcast.stages.context import context_of


def run(root: Path, name: str) -> None:
    """Write data/<experiment>/calibration/."""
    context = context_of(root, name)
    set_up(context.settings, name, load_arm(context.arm_file), context.folder.data)
