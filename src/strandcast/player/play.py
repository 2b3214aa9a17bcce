"""Play one motion: check everything, move, log; run.json, written last, says that the log is complete."""

from __future__ import annotations

import shutil
from pathlib import Path

from strandcast.arm.load import Arm
from strandcast.errors import ABORTED, REFUSED, STOPPED_BY_CONTROLLER, StrandcastError
from strandcast.player.checks import check_motion, check_start, sample
from strandcast.player.protocol import Driver, Recording
from strandcast.records.files import atomic_write
from strandcast.records.joint_log import Run, timing_of, write_joint_log
from strandcast.records.motion import Motion

TAIL_S = 0.5
NOTHING_SENT = "nothing was sent to the arm"


def play(
    motion_path: str | Path, arm: Arm, driver: Driver, out_dir: str | Path, move_to_start: bool = False
) -> Run:
    """Play a motion and leave motion.json (what was played), joints.csv and, last, run.json in `out_dir`.

    Parameters
    ----------
    motion_path
        The planned motion; its content hash is verified.
    arm
        The arm that it is for, from its own file: its limits are checked, not the motion's words.
    driver
        Plays it.
    out_dir
        The trial's raw folder; a run that is already there is never written over.
    move_to_start
        Move slowly to the start first, instead of refusing when the arm stands elsewhere.

    Raises
    ------
    StrandcastError
        Refused (exit code 2): nothing was sent. Aborted or stopped by the controller (5, 6): the log is
        kept, and run.json says that it is not complete.
    """
    motion_path, out_dir = Path(motion_path), Path(out_dir)
    if (out_dir / "run.json").exists():
        raise StrandcastError(
            "SC-X010", "this trial has been played already", file=out_dir / "run.json",
            cost="nothing was sent to the arm", fix="play it as the next trial")  # fmt: skip
    motion = read_motion(motion_path)
    check_motion(motion_path, motion, arm)
    driver.connect()
    try:
        if move_to_start:
            driver.move_to_start(motion.joints()[0][0])
        check_start(motion_path, motion, arm, driver.state())
        out_dir.mkdir(parents=True, exist_ok=True)
        recording = driver.play(sample(motion, 1.0 / driver.rate_hz), out_dir)
    finally:
        driver.stop()
    with atomic_write(out_dir / "motion.json") as temporary:
        shutil.copyfile(motion_path, temporary)
    run = _run(motion, arm, driver, recording, write_joint_log(out_dir / "joints.csv", recording.log))
    run.write(out_dir / "run.json")
    if recording.status != "ok":
        raise StrandcastError(
            "SC-X011", f"the throw was not played to its end ({recording.reason})", file=out_dir / "run.json",
            cost="the trial cannot be used", fix="mend the reason, move the folder away, and play it again",
            exit_code=ABORTED if recording.status == "aborted" else STOPPED_BY_CONTROLLER)  # fmt: skip
    return run


def read_motion(path: str | Path) -> Motion:
    """Read a motion to be played; whatever is wrong with it is a refusal."""
    try:
        return Motion.read(path)
    except StrandcastError as error:
        error.cost, error.exit_code = NOTHING_SENT, REFUSED
        raise


def _run(motion: Motion, arm: Arm, driver: Driver, recording: Recording, joints_sha256: str) -> Run:
    log = recording.log
    timing = timing_of(log.time_s, driver.rate_hz)
    warnings = []
    if timing.gaps or timing.duplicates:
        warnings.append(f"{len(timing.gaps)} gaps and {timing.duplicates} duplicates in the joint log")
    if log.time_s[-1] < recording.motion_end_s + TAIL_S - 1e-6:
        warnings.append(f"the joint log ends less than {TAIL_S} s after the motion")
    return Run(
        complete=recording.status == "ok",
        status=recording.status,
        reason=recording.reason,
        joints_sha256=joints_sha256,
        rows=len(log.time_s),
        motion_sha256=motion.content_sha256(),
        arm_sha256=arm.sha256,
        driver=driver.name,
        controller=recording.controller,
        joint_names=log.joint_names,
        clock=recording.clock,
        motion_start_s=recording.motion_start_s,
        motion_end_s=recording.motion_end_s,
        sync_events=recording.sync_events,
        timing=timing,
        video=recording.video,
        warnings=warnings,
    )
