"""A planned motion played on an arm, by the driver that the arm's file names."""

from __future__ import annotations

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.player.drivers import driver_named
from strandcast.player.play import play, read_motion
from strandcast.records.joint_log import Run


def run(motion: Path, arm_file: Path, out: Path, move_to_start: bool) -> Run:
    """Play a motion and leave motion.json, joints.csv and run.json in `out`."""
    arm = load_arm(arm_file)
    driver = driver_named(arm.driver, arm, read_motion(motion))
    return play(motion, arm, driver, out, move_to_start)
