"""A planned motion played on an arm, by the driver that the arm's file names."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.experiment import find_experiment, load_experiment
from strandcast.player.drivers import driver_named
from strandcast.player.play import play
from strandcast.player.protocol import Driver
from strandcast.player.rehearsal import Rehearsal, Terms, read_motion, rehearse
from strandcast.player.words import lines_of
from strandcast.records.joint_log import Run
from strandcast.records.motion import Motion


def run(
    motion_path: Path,
    arm_file: Path,
    out: Path,
    terms: Terms,
    hanging_m: float | None,
    live: bool,
    confirm: str | None,
    say: Callable[[str], None] = print,
) -> Run | None:
    """Rehearse a motion, and if it is to be `live` and is confirmed, play it.

    Parameters
    ----------
    motion_path, arm_file, out
        The motion, the arm's file, the trial's raw folder.
    terms, hanging_m
        How to play it; what hangs from the hand [m], None: as the motion's experiment says.
    live, confirm
        Whether to play, and the motion's short hash, None: it is asked for.
    say
        Takes each line that the user is to read.

    Returns
    -------
    The run, or None after a dry run.
    """
    arm = load_arm(arm_file)
    motion = read_motion(motion_path)
    driver = driver_named(arm.driver, arm, motion)
    if hanging_m is None:
        hanging_m = _hanging_m(motion_path, motion, driver)
    rehearsal = rehearse(motion_path, arm, driver, out, replace(terms, hanging_m=hanging_m))
    for line in lines_of(rehearsal):
        say(line)
    if not live and confirm is None:
        say(f"dry run: nothing was sent. To play it: --live, or --confirm {rehearsal.short_hash}")
        return None
    done = play(rehearsal, driver, confirm if confirm is not None else _typed(rehearsal))
    for warning in done.warnings:
        say(f"warning: {warning}")
    return done


def _hanging_m(path: Path, motion: Motion, driver: Driver) -> float:
    if driver.address is None:
        return 0.0  # a virtual arm's string hits nothing
    try:
        return load_experiment(find_experiment(motion.experiment, Path())).string.length_m
    except StrandcastError:
        raise StrandcastError(
            "SC-X009", f"how much hangs from the hand is not known: no experiment {motion.experiment!r} here",
            file=path, cost="nothing was sent to the arm",
            fix="give --hanging, the string's length with its weights [m]") from None  # fmt: skip


def _typed(rehearsal: Rehearsal) -> str:
    if not sys.stdin.isatty():
        raise StrandcastError(
            "SC-X012", "a live run must be confirmed, and nobody is at the keyboard",
            file=rehearsal.motion_path, cost="nothing was sent to the arm",
            fix=f"--confirm {rehearsal.short_hash}")  # fmt: skip
    try:
        return input("the arm will move; type the motion's short hash to play it: ").strip()
    except EOFError:  # Ctrl-D: nothing was typed
        return ""
