"""A planned motion written for an arm that has no driver."""

from __future__ import annotations

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.experiment import Experiment, find_arm, find_experiment, load_experiment
from strandcast.exports.export import Form, export_motion
from strandcast.exports.handover import HandOver, prepare
from strandcast.player.rehearsal import read_motion


def run(
    root: Path,
    motion: Path,
    out: Path,
    form: Form,
    arm_file: Path | None,
    hanging_m: float | None,
    time_scale: float,
) -> HandOver:
    """Export a motion.

    By default the arm is that of the motion's experiment, and as much hangs from the hand as it says.
    """
    planned = read_motion(motion)
    if arm_file is None or hanging_m is None:
        settings, file = _experiment(root, motion, planned.experiment)
        arm_file = arm_file or find_arm(settings, file, root)
        hanging_m = settings.string.length_m if hanging_m is None else hanging_m
    arm = load_arm(arm_file)
    handover = prepare(motion, arm, hanging_m, time_scale)
    export_motion(handover, form, out)
    return handover


def _experiment(root: Path, motion: Path, name: str) -> tuple[Experiment, Path]:
    """Return the motion's experiment and its file, or say what to give instead."""
    try:
        file = find_experiment(name, root)
    except StrandcastError:
        raise StrandcastError(
            "SC-X009",
            f"there is no experiment {name!r} here to tell the arm and how much hangs from its hand",
            file=motion,
            fix="give both: --arm, the arm's file, and --hanging, the string's length with its weights [m]",
        ) from None
    return load_experiment(file), file
