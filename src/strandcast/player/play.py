"""Play one motion on an arm. This is all that moves it; read it before you trust it.

`rehearse` (rehearsal.py) has checked everything that needs no arm. Then, in this order: the motion's short
hash must have been typed; the arm is locked, connected, looked at; moved slowly to the start if that was
wished; looked at again until it has stood still there; and only then is the driver told to play. Whatever
happens then, the driver brings the arm to rest (stream.py: one soft stop for every fault) and hands back
the log. run.json is written last: without it, and without its `complete`, there is no run.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress

import numpy as np

from strandcast.arm.limits import violations
from strandcast.arm.reach import reach_of
from strandcast.errors import ENVIRONMENT, LOG_INCOMPLETE, StrandcastError
from strandcast.player.approach import slow_path
from strandcast.player.checks import (
    CHECK_STEP_S,
    await_start,
    check_reach,
    check_state,
    refuse_limits,
    sample,
)
from strandcast.player.clock import Clock, HostClock
from strandcast.player.interrupts import held_off
from strandcast.player.outcome import EXIT_CODES, run_of
from strandcast.player.protocol import Driver, Recording
from strandcast.player.rehearsal import Rehearsal
from strandcast.player.surroundings import NOTHING_SENT, check_folder, one_run
from strandcast.records.joint_log import Run, write_joint_log


def play(rehearsal: Rehearsal, driver: Driver, confirmed: str, clock: Clock | None = None) -> Run:
    """Play a rehearsed motion; leave motion.json (what was played), joints.csv and, last, run.json.

    Parameters
    ----------
    rehearsal
        The motion, checked, and how it is to be played.
    driver
        Plays it; the one that it was rehearsed for.
    confirmed
        The motion's short hash, as a person has typed it.
    clock
        The host's; the tests bring one that does not sleep.

    Raises
    ------
    StrandcastError
        Refused (exit code 2): nothing was sent, or only the slow move to the start. Aborted softly (5),
        stopped by the controller (6) or the log not whole (7): what there is of the log is kept, and run.json
        says that it is not complete.
    """
    if confirmed != rehearsal.short_hash:
        raise StrandcastError(
            "SC-X012", f"{confirmed!r} is not the motion's short hash", file=rehearsal.motion_path,
            cost=NOTHING_SENT, fix=f"read the dry run, and confirm with {rehearsal.short_hash}")  # fmt: skip
    check_folder(rehearsal.out_dir)
    clock = clock or HostClock()
    with one_run(driver.address), _ended(driver):
        with _guarded(driver, "before the throw", "the motion was not played", ENVIRONMENT):
            driver.connect()
            _bring_to_start(rehearsal, driver, clock)
        rehearsal.out_dir.mkdir(parents=True, exist_ok=True)
        # `stream` hears Ctrl-C and its like; pressed again, it must not cost the log of what happened.
        with held_off() if driver.streams else nullcontext():
            with _guarded(driver, "and left no log", "the trial cannot be used", LOG_INCOMPLETE):
                recording = driver.play(sample(rehearsal.motion, 1.0 / driver.rate_hz), rehearsal.out_dir)
            run = _keep(rehearsal, driver, recording)
    if not run.complete:
        raise StrandcastError(
            "SC-X011", f"the throw was not played to its end, or not logged whole ({run.reason})",
            file=rehearsal.out_dir / "run.json", cost="the trial cannot be used",
            fix="mend the reason, move the folder away, and play it again",
            exit_code=EXIT_CODES[run.status])  # fmt: skip
    return run


def _bring_to_start(rehearsal: Rehearsal, driver: Driver, clock: Clock) -> None:
    path, motion, arm = rehearsal.motion_path, rehearsal.motion, rehearsal.arm
    state = driver.state()
    check_state(path, arm, state)
    if rehearsal.terms.move_to_start:
        start = np.array(motion.points[0].positions)
        way = slow_path(state.q_rad, start, 1.0 / CHECK_STEP_S)
        moves = (way.time_s, way.q_rad, way.qd_rad_s, way.qdd_rad_s2)
        refuse_limits(path, "the move to the start", violations(arm, *moves))
        check_reach(path, arm, reach_of(arm, *moves, rehearsal.terms.hanging_m), rehearsal.terms.hanging_m)
        driver.move_to_start(start)
    clock.sleep_until(clock.now_ns() + round(1e9 * rehearsal.terms.settle_s))
    await_start(path, motion, arm, driver, clock)


@contextmanager
def _ended(driver: Driver) -> Iterator[None]:
    """End the driver in every case; that it cannot be ended hides no error that was before."""
    try:
        yield
    except BaseException:
        with held_off(), suppress(Exception):
            driver.stop()
        raise
    with (
        held_off(),
        _guarded(driver, "at its end", "what was played is kept, but the arm may not be let go", ENVIRONMENT),
    ):
        driver.stop()


@contextmanager
def _guarded(driver: Driver, when: str, cost: str, exit_code: int) -> Iterator[None]:
    """Tell of whatever a driver fails by in our own form."""
    try:
        yield
    except StrandcastError:
        raise
    except Exception as error:
        raise StrandcastError(
            "SC-X013", f"the driver {driver.name} failed {when} ({type(error).__name__}: {error})",
            cost=cost, fix="look at the arm, then play again", exit_code=exit_code) from error  # fmt: skip


def _keep(rehearsal: Rehearsal, driver: Driver, recording: Recording) -> Run:
    folder = rehearsal.out_dir
    try:
        rehearsal.motion.write(folder / "motion.json")
        run = run_of(rehearsal, driver, recording, write_joint_log(folder / "joints.csv", recording.log))
        run.write(folder / "run.json")
    except OSError as error:
        raise StrandcastError(
            "SC-X014", f"the log could not be written ({error.strerror})", file=folder,
            cost="the throw happened, but the trial cannot be used", fix="mend the disk, and play it again",
            exit_code=LOG_INCOMPLETE) from error  # fmt: skip
    return run
