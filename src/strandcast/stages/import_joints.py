"""A robot's own log brought into a trial's folder: joints.csv and run.json."""

from __future__ import annotations

from pathlib import Path

import mujoco

from strandcast.arm.load import Arm, load_arm
from strandcast.imports.joints import Played, import_joints
from strandcast.imports.mapping import JointMapping, load_mapping
from strandcast.records.joint_log import Run
from strandcast.records.motion import Motion
from strandcast.stages.context import context_of, make_room


def run(
    root: Path,
    name: str,
    trial: int,
    log: Path,
    dialect: str,
    columns: Path | None,
    joints: list[str],
    replace: bool = False,
) -> Run:
    """Import a log; a motion.json that lies in the trial's folder is what was played."""
    context = context_of(root, name)
    folder = context.folder.trial(trial)
    arm = load_arm(context.arm_file)
    motion = folder.played_motion
    make_room(folder.data / "run.json", replace)
    return import_joints(
        log,
        folder.data,
        dialect=dialect,
        mapping=None if columns is None else load_mapping(columns, JointMapping),
        namings=[joints] if joints else [list(arm.joints), all_joints(arm)],
        played=None if motion is None else Played(Motion.read(motion), arm),
    )


def all_joints(arm: Arm) -> list[str]:
    """Return the names of all of an arm's joints, from the base on."""
    model = arm.model()
    return [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k) for k in range(model.njnt)]
