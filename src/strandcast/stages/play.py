"""Play a planned motion on an arm, with the driver named in the arm's file."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.config.find import find_experiment, named_arm
from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastError
from strandcast.executor.drivers.protocol import Driver
from strandcast.executor.drivers.registry import driver_of_arm
from strandcast.executor.dry_run_report import dry_run_report
from strandcast.executor.play import play
from strandcast.executor.preflight import PlayOptions, Preflight, read_motion, run_preflight
from strandcast.records.folders import project_root
from strandcast.records.joint_log import Run
from strandcast.records.motion import Motion


def run(
    motion_path: Path,
    arm_file: Path,
    out: Path,
    options: PlayOptions,
    hanging_m: float | None,
    live: bool,
    confirm: str | None,
    say: Callable[[str], None] = print,
) -> Run | None:
    """Check a motion; if it is `live` and confirmed, play it.

    Parameters
    ----------
    motion_path, arm_file, out
        The motion, the arm's file, the trial's raw folder.
    options, hanging_m
        How to play it; the length hanging from the hand [m], None: the experiment's string.
    live, confirm
        Whether to play; the motion's short hash, None: ask for it.
    say
        Prints one line for the user.

    Returns
    -------
    The run, or None after a dry run.
    """
    arm = load_arm(named_arm(arm_file, project_root()))
    motion = read_motion(motion_path)
    driver = driver_of_arm(arm, motion)
    if hanging_m is None:
        hanging_m = _hanging_m(motion_path, motion, driver)
    preflight = run_preflight(motion_path, arm, driver, out, replace(options, hanging_m=hanging_m))
    for line in dry_run_report(preflight):
        say(line)
    if not live and confirm is None:
        say(f"dry run: nothing was sent. To play it: --live, or --confirm {preflight.short_hash}")
        return None
    done = play(preflight, driver, confirm if confirm is not None else _typed(preflight))
    for warning in done.warnings:
        say(f"warning: {warning}")
    return done


def _hanging_m(path: Path, motion: Motion, driver: Driver) -> float:
    if driver.address is None:
        return 0.0  # a virtual arm's string can hit nothing
    try:
        return load_experiment(find_experiment(motion.experiment, project_root())).string.length_m
    except StrandcastError:
        raise StrandcastError(
            "SC-W020",
            f"the length hanging from the hand is unknown: there is no experiment {motion.experiment!r} here",
            file=path,
            cost="nothing was sent to the arm",
            fix="give --hanging, the string's length with its weights [m]",
        ) from None


def _typed(preflight: Preflight) -> str:
    if preflight.refused_live is not None:  # before anybody is asked for anything
        raise preflight.refused_live
    if not sys.stdin.isatty():
        raise StrandcastError(
            "SC-X012",
            "a live run must be confirmed, but there is no keyboard",
            file=preflight.motion_path,
            cost="nothing was sent to the arm",
            fix=f"--confirm {preflight.short_hash}",
        )
    try:
        return input("the arm will move; type the motion's short hash to play it: ").strip()
    except EOFError:  # Ctrl-D: nothing was typed
        return ""
