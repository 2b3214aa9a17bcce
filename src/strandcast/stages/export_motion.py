"""A planned motion written for an arm that has no driver."""

from __future__ import annotations

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.experiment import find_experiment, load_experiment
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

    By default the arm's file is that of the motion's arm in config/arms, and as much hangs from the hand as
    the motion's experiment says.
    """
    planned = read_motion(motion)
    arm = load_arm(arm_file or root / "config" / "arms" / f"{planned.robot.name}.toml")
    if hanging_m is None:
        hanging_m = _hanging_m(root, motion, planned.experiment)
    handover = prepare(motion, arm, hanging_m, time_scale)
    export_motion(handover, form, out)
    return handover


def _hanging_m(root: Path, motion: Path, experiment: str) -> float:
    try:
        return load_experiment(find_experiment(experiment, root)).string.length_m
    except StrandcastError:
        raise StrandcastError(
            "SC-X009",
            f"how much hangs from the hand is not known: there is no experiment {experiment!r} here",
            file=motion,
            fix="give --hanging, the string's length with its weights [m]",
        ) from None
