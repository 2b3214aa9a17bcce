"""Play one motion on an arm. All motion starts here: read this file before you trust it.

`run_preflight` (preflight.py) has made every check that needs no arm. Then, in this order: the motion's short
hash must have been typed; the arm is locked, connected and its state checked; it moves slowly to the start if
requested; it is checked again until it has been at rest there; only then does the driver play. Whatever
happens next, the driver brings the arm to rest (streaming/loop.py: one soft stop for every fault) and returns
the log. run.json is written last: without it, and without its `complete`, there is no run.
"""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress

import numpy as np

from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import ENVIRONMENT, LOG_INCOMPLETE, StrandcastError
from strandcast.executor.checks import CHECK_STEP_S, await_start, check_limits, check_reach, check_state
from strandcast.executor.drivers.protocol import Driver, Recording
from strandcast.executor.locks import NOTHING_SENT, check_folder, one_run, reserve_space
from strandcast.executor.move_to_start import slow_trajectory
from strandcast.executor.preflight import Preflight
from strandcast.executor.run_record import EXIT_CODES, run_record
from strandcast.executor.streaming.clock import Clock, HostClock
from strandcast.executor.streaming.interrupts import held_off
from strandcast.records.files import write_bytes
from strandcast.records.joint_log import Run, write_joint_log

AROUND_S = 10.0  # more than any driver logs before and after the motion, or while it stops
CELL_BYTES = 25  # a number and its comma
CELLS, CELLS_PER_JOINT = 5, 4  # of joints.csv
JOINT_TABLES = 2  # joints.csv, and the states that a driver may keep beside it
RECORD_BYTES = 1 << 20  # run.json: 2 kB, more with many gaps in the log


def play(preflight: Preflight, driver: Driver, confirmed: str, clock: Clock | None = None) -> Run:
    """Play a checked motion; write motion.json (as played), joints.csv and, last, run.json.

    The planner's predicted throws are kept too, if they lie beside the motion.

    Parameters
    ----------
    driver
        The driver that the preflight was made with.
    confirmed
        The motion's short hash, as typed by a person.

    Raises
    ------
    StrandcastError
        Refused (exit code 2): nothing was sent, or only the slow move to the start. Aborted by the soft
        stop (5), stopped by the controller (6) or an incomplete log (7): the log so far is kept, and run.json
        is marked as not complete.
    """
    if confirmed != preflight.short_hash:
        raise StrandcastError(
            "SC-X012",
            f"{confirmed!r} is not the motion's short hash",
            file=preflight.motion_path,
            cost=NOTHING_SENT,
            fix=f"read the dry run's report, then confirm with {preflight.short_hash}",
        )
    if preflight.refused_live is not None:
        raise preflight.refused_live
    check_folder(preflight.out_dir)
    clock = clock or HostClock()
    size_bytes = _log_bytes(preflight, driver.rate_hz)
    with reserve_space(preflight.out_dir, size_bytes) as reserve, one_run(driver.address), _ended(driver):
        with _guarded(driver, "before the throw", "the motion was not played", ENVIRONMENT):
            driver.connect()
            _bring_to_start(preflight, driver, clock)
        preflight.out_dir.mkdir(parents=True, exist_ok=True)
        # `stream` handles the first Ctrl-C; a second one must not lose the log.
        with held_off() if driver.streams else nullcontext():
            with _guarded(driver, "and returned no log", "the trial cannot be used", LOG_INCOMPLETE):
                recording = driver.play(preflight.command, preflight.out_dir)
            reserve.close()  # its space is free for the log
            run = _keep(preflight, driver, recording)
    if not run.complete:
        raise StrandcastError(
            "SC-X011",
            f"the throw was not played to its end, or its log is incomplete ({run.reason})",
            file=preflight.out_dir / "run.json",
            cost="the trial cannot be used",
            fix="remove the cause, move the folder away, and play it again",
            exit_code=EXIT_CODES[run.status],
        )
    return run


def _log_bytes(preflight: Preflight, rate_hz: float) -> int:
    """Return the most that the files of a run take [bytes]."""
    motion = preflight.motion
    rows = rate_hz * (motion.trajectory().end_s + AROUND_S)
    row_bytes = CELL_BYTES * (CELLS + CELLS_PER_JOINT * len(motion.joint_names))
    return round(rows * row_bytes * JOINT_TABLES) + preflight.motion_path.stat().st_size + RECORD_BYTES


def _bring_to_start(preflight: Preflight, driver: Driver, clock: Clock) -> None:
    path, motion, arm = preflight.motion_path, preflight.motion, preflight.arm
    state = driver.state()
    check_state(path, arm, state)
    if preflight.options.move_to_start:
        start = np.array(motion.points[0].positions)
        held = state.q_held_rad
        q_from = np.array([*state.q_rad, *held.values()])
        q_to = np.array([*start, *(arm.held[name] for name in held)])
        whole = slow_trajectory(arm, [*arm.joints, *held], q_from, q_to, 1.0 / CHECK_STEP_S)
        moved = (x[:, : len(start)] for x in (whole.q_rad, whole.qd_rad_s, whole.qdd_rad_s2))
        slow = JointTrajectory(whole.time_s, *moved)
        check_limits(path, "the move to the start", arm, slow)
        check_reach(path, arm, slow, preflight.options.hanging_m)
        driver.move_to_start(start)
    clock.sleep_until(clock.now_ns() + round(1e9 * preflight.options.settle_s))
    await_start(path, motion, arm, driver, clock)


@contextmanager
def _ended(driver: Driver) -> Iterator[None]:
    """Stop the driver in every case; an error while stopping does not hide an earlier one."""
    try:
        yield
    except BaseException:
        with held_off(), suppress(Exception):
            driver.stop()
        raise
    with (
        held_off(),
        _guarded(driver, "at its end", "the run is kept, but the connection may still be open", ENVIRONMENT),
    ):
        driver.stop()


@contextmanager
def _guarded(driver: Driver, when: str, cost: str, exit_code: int) -> Iterator[None]:
    """Report any exception of a driver as an error of ours."""
    try:
        yield
    except StrandcastError:
        raise
    except Exception as error:
        raise StrandcastError(
            "SC-X011",
            f"the driver {driver.name} failed {when} ({type(error).__name__}: {error})",
            cost=cost,
            fix="check the arm, then play again",
            exit_code=exit_code,
        ) from error


def _keep_predicted(preflight: Preflight) -> None:
    """Keep what was expected of the throw; without it, only a figure of the page is missing."""
    planned = preflight.motion_path.with_name("predicted.parquet")
    if planned.parent == preflight.out_dir:  # where it belongs already
        return
    with suppress(StrandcastError, OSError):
        write_bytes(preflight.out_dir / planned.name, planned.read_bytes())


def _keep(preflight: Preflight, driver: Driver, recording: Recording) -> Run:
    folder = preflight.out_dir
    try:
        preflight.motion.write(folder / "motion.json")
        run = run_record(preflight, driver, recording, write_joint_log(folder / "joints.csv", recording.log))
        _keep_predicted(preflight)
        run.write(folder / "run.json")
    except (OSError, StrandcastError) as error:
        reason = error.what if isinstance(error, StrandcastError) else error.strerror
        raise StrandcastError(
            "SC-W002",
            f"the log could not be written ({reason})",
            file=folder,
            cost="the throw happened, but the trial cannot be used",
            fix="check the disk, and play it again",
            exit_code=LOG_INCOMPLETE,
        ) from error
    return run
