"""A robot's own log brought into a trial's folder: joints.csv and run.json."""

from __future__ import annotations

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.imports.joints import IMPORTED, Played, Reading, import_joints
from strandcast.records.joint_log import Run
from strandcast.records.motion import Motion
from strandcast.stages.context import context_of, refuse_replacing


def run(
    root: Path,
    name: str,
    trial: int,
    log: Path,
    reading: Reading,
    joints: list[str],
    replace: bool = False,
) -> Run:
    """Import a log; a motion.json that lies in the trial's folder is what was played."""
    context = context_of(root, name)
    folder = context.folder.trial(trial)
    arm = load_arm(context.arm_file)
    motion = folder.played_motion
    _refuse_played(folder.data / "run.json")
    refuse_replacing(folder.data / "run.json", replace)
    return import_joints(
        log,
        folder.data,
        reading,
        namings=[joints] if joints else [list(arm.joints), list(arm.all_joints)],
        played=None if motion is None else Played(Motion.read(motion), arm),
    )


def _refuse_played(path: Path) -> None:
    """Refuse to write over a run that `strandcast play` has logged: there is no other copy of it."""
    if path.is_file() and not Run.read(path).driver.startswith(IMPORTED):
        raise StrandcastError(
            "SC-I023",
            "this trial was played and logged by `strandcast play`",
            file=path,
            fix="import as another trial, or move joints.csv and run.json away first",
        )
