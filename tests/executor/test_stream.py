"""Streaming on a virtual clock: whatever goes wrong ends in the one soft stop, with the log kept."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.errors import ABORTED, LOG_INCOMPLETE, REFUSED, STOPPED_BY_CONTROLLER, StrandcastError
from strandcast.executor.dry_run_report import dry_run_report
from strandcast.executor.play import play
from strandcast.executor.preflight import PlayOptions, run_preflight
from strandcast.executor.streaming.bounds import safety_bounds
from strandcast.executor.streaming.link import ControllerState
from strandcast.executor.streaming.loop import stream
from strandcast.records.joint_log import (
    AFTER_DUPLICATE,
    SYNC_HIGH,
    JointLog,
    Run,
    read_joint_log,
    write_joint_log,
)

from .test_play import START, make_motion
from .virtual import Controller, PacingController, StreamedArm, VirtualClock

ROOT = Path(__file__).parents[2]
MIDDLE_S = 0.5 + 0.25  # of the streaming: half way through the motion, at its fastest
CONTROLLERS = (Controller, PacingController)


@pytest.fixture(scope="module")
def arm() -> PlanarArm:
    return load_arm(ROOT / "config" / "arms" / "planar3.toml").planar()


def streamed(arm: PlanarArm, kind: type[Controller] = Controller, q: np.ndarray = START) -> StreamedArm:
    return StreamedArm(arm, kind(VirtualClock(), arm, q))


def throw(arm: PlanarArm, driver: StreamedArm, folder: Path, by: float = 0.8, **options: object) -> Run:
    make_motion(arm, by).write(folder / "planned.json")
    preflight = run_preflight(
        folder / "planned.json", arm, driver, folder / "run", PlayOptions(**options), driver.clock
    )
    return play(preflight, driver, preflight.short_hash, driver.clock)


def stopped(
    arm: PlanarArm, driver: StreamedArm, folder: Path, exit_code: int, reason: str
) -> tuple[Run, JointLog]:
    """Throw, check that it ends with this code and reason, and return run and log."""
    with pytest.raises(StrandcastError) as caught:
        throw(arm, driver, folder)
    assert caught.value.exit_code == exit_code
    run = Run.read(folder / "run" / "run.json")
    assert not run.complete
    assert reason in str(run.reason)
    assert driver.controller.finished == 1
    assert driver.stopped == 1
    return run, read_joint_log(folder / "run" / "joints.csv")


def assert_soft(arm: PlanarArm, log: JointLog) -> None:
    """Check that the command comes to rest within the arm's acceleration and jerk, wherever it was.

    Between two set points the command goes on by its mean speed; the log has only set points that were sent.
    """
    q, qd, time_s = log.q_cmd_rad, log.qd_cmd_rad_s, log.host_time_ns * 1e-9
    assert np.abs(qd[-1]).max() < 1e-9
    assert np.ptp(q[-100:], axis=0).max() < 1e-9
    step = np.diff(time_s)
    even = np.abs(step - np.median(step)) < 1e-4
    bend = np.abs(np.diff(qd, n=2, axis=0))[even[1:] & even[:-1]]
    assert (bend <= 1.05 * arm.stop.jerk_rad_s3 * np.median(step) ** 2).all()
    measured = np.diff(q, axis=0) / np.median(step)
    assert (np.abs(measured - 0.5 * (qd[1:] + qd[:-1]))[even] < 0.02).all()
    assert (np.abs(np.diff(qd, axis=0)) <= 1.02 * arm.limits.acceleration_rad_s2 * np.median(step)).all()


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_a_motion_is_streamed_and_its_lag_found(
    arm: PlanarArm, tmp_path: Path, kind: type[Controller]
) -> None:
    driver = streamed(arm, kind)
    run = throw(arm, driver, tmp_path)
    log = read_joint_log(tmp_path / "run" / "joints.csv")
    assert run.status == "ok"
    assert run.lateness.missed == 0
    assert run.timing.gaps == []
    # A servo of 62 rad/s and 0.9 trails by 2 * 0.9 / 62 s, its dead time of 4 ms and the hold besides.
    assert run.following is not None
    assert run.following.lag_s == pytest.approx([0.033] * 3, abs=0.004)
    assert max(run.following.peak_error_rad) < 0.01
    inside = np.isfinite(log.since_start_s)
    s = log.since_start_s[inside] / 0.5
    np.testing.assert_allclose(
        log.q_cmd_rad[inside, 1], START[1] + 0.8 * s**3 * (10 - 15 * s + 6 * s**2), atol=1e-6
    )
    assert run.motion_start_s == pytest.approx(log.time_s[inside][0], abs=0.003)
    assert log.time_s[0] <= run.motion_start_s - 0.45
    assert log.time_s[-1] >= run.motion_end_s + 0.5
    np.testing.assert_allclose(log.q_rad[-1], START + 0.8, atol=1e-4)
    high = (log.flags & SYNC_HIGH) > 0
    assert log.time_s[high][0] == pytest.approx(run.motion_start_s, abs=0.006)
    assert log.time_s[high][-1] == pytest.approx(run.motion_end_s, abs=0.006)


def test_late_wake_ups_do_not_stretch_or_stop_the_motion(arm: PlanarArm, tmp_path: Path) -> None:
    driver = streamed(arm)
    original = driver.play

    def play_late(command, folder):
        driver.clock.late = dict.fromkeys(np.arange(0.5, 1.0, 0.02).tolist(), 0.0049)
        return original(command, folder)

    driver.play = play_late
    run = throw(arm, driver, tmp_path)
    log = read_joint_log(tmp_path / "run" / "joints.csv")
    assert run.lateness.missed == pytest.approx(50, abs=3)
    assert run.lateness.degraded
    assert any("timing: degraded" in warning for warning in run.warnings)
    assert run.motion_end_s - run.motion_start_s == pytest.approx(0.5, abs=1e-6)
    inside = np.isfinite(log.since_start_s)
    host_s = log.host_time_ns[inside] * 1e-9
    since_s = log.since_start_s[inside]
    assert np.ptp(host_s - since_s) < 0.002  # the commanded time is the elapsed time, to within a tick


def after(seconds: float, set_up: Callable[[StreamedArm, float], None]) -> Callable[[StreamedArm], None]:
    """Return what makes a fault happen `seconds` after the streaming has begun."""

    def apply(driver: StreamedArm) -> None:
        original = driver.play

        def play_with_fault(command, folder):
            set_up(driver, seconds)
            return original(command, folder)

        driver.play = play_with_fault

    return apply


def stall(driver: StreamedArm, at: float) -> None:
    driver.clock.late = {at: 0.030}


def freeze(driver: StreamedArm, at: float) -> None:
    driver.controller.frozen_at = at


def push(driver: StreamedArm, at: float) -> None:
    driver.controller.pushed_at = at


def slow_down(driver: StreamedArm, at: float) -> None:
    driver.controller.scaled_at = at


def break_write(driver: StreamedArm, at: float) -> None:
    driver.controller.broken_at = at


@pytest.mark.parametrize("kind", CONTROLLERS)
@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (stall, "set points in a row were missed"),
        (freeze, "clock has stopped"),
        (push, "from its command"),
        (slow_down, "speed scaling fell to 50 %"),
        (break_write, "OSError: no buffer"),
    ],
)
def test_every_fault_ends_in_the_soft_stop(
    arm: PlanarArm,
    tmp_path: Path,
    kind: type[Controller],
    fault: Callable[[StreamedArm, float], None],
    reason: str,
) -> None:
    driver = streamed(arm, kind)
    after(MIDDLE_S, fault)(driver)
    _, log = stopped(arm, driver, tmp_path, ABORTED, reason)
    assert_soft(arm, log)
    assert log.q_cmd_rad[-1, 0] < START[0] + 0.8 - 0.05
    assert np.isfinite(log.since_start_s).sum() < 150
    host_s = log.host_time_ns * 1e-9
    assert host_s[-1] - host_s[np.isfinite(log.since_start_s)][-1] > 0.5


def test_a_clock_that_jumps_ahead_does_not_make_the_command_jump(arm: PlanarArm) -> None:
    driver = streamed(arm, PacingController)
    read = driver.controller.read

    def read_ahead() -> ControllerState:
        reading = read()
        reading.time_s += 0.1 if driver.clock.since_s > MIDDLE_S else 0.0
        return reading

    driver.controller.read = read_ahead
    command = make_motion(arm).trajectory().resampled(0.002)
    done = stream(driver.controller, command, safety_bounds(arm), 500.0, list(arm.joints), clock=driver.clock)
    assert (done.status, done.reason) == ("aborted", "50 set points in a row were missed")
    fastest = np.abs(done.log.qd_cmd_rad_s).max(axis=0)
    assert (np.abs(np.diff(done.log.q_cmd_rad, axis=0)).max(axis=0) < 1.05 * 0.002 * fastest).all()


def test_the_end_of_streaming_is_undisturbed_as_well(arm: PlanarArm) -> None:
    driver = streamed(arm)
    calm: list[bool] = [False]
    ended: list[bool] = []

    @contextmanager
    def undisturbed() -> Iterator[str]:
        calm[0] = True
        yield "calm"
        calm[0] = False

    driver.clock.undisturbed = undisturbed
    driver.controller.finish = lambda: ended.append(calm[0])
    command = make_motion(arm).trajectory().resampled(0.002)
    done = stream(driver.controller, command, safety_bounds(arm), 500.0, list(arm.joints), clock=driver.clock)
    assert (done.status, ended, calm) == ("ok", [True], [False])


def test_after_a_long_stall_an_arm_that_stands_is_left_standing(arm: PlanarArm) -> None:
    driver = streamed(arm)
    driver.clock.late = {MIDDLE_S: 1.0}  # as by Ctrl-Z and fg
    command = make_motion(arm).trajectory().resampled(0.002)
    done = stream(driver.controller, command, safety_bounds(arm), 500.0, list(arm.joints), clock=driver.clock)
    assert done.status == "aborted"
    sent = np.array([q for _, q, _ in driver.controller.sent])
    after = done.log.q_cmd_rad[np.argmax(np.diff(done.log.time_s)) :]
    assert np.ptp(after[1:], axis=0).max() == 0.0
    assert np.abs(done.log.qd_cmd_rad_s[-len(after) + 1 :]).max() == 0.0
    assert len(sent)


def test_the_set_points_sent_are_those_that_were_checked(arm: PlanarArm) -> None:
    driver = StreamedArm(arm, Controller(VirtualClock(), arm, START, rate_hz=125.0))
    motion = make_motion(arm).trajectory()
    done = stream(driver.controller, motion, safety_bounds(arm), 125.0, list(arm.joints), clock=driver.clock)
    checked = motion.at(np.arange(np.ceil(motion.end_s * 125.0) + 1) / 125.0).q_rad
    sent = done.log.q_cmd_rad
    apart = np.abs(sent[:, None] - checked[None]).max(axis=2).min(axis=1)
    assert done.status == "ok"
    assert apart.max() < 1e-9


@pytest.mark.parametrize("where", ["before the stream", "while the move to the start ends"])
def test_ctrl_c_before_the_throw_lets_nothing_be_thrown(arm: PlanarArm, tmp_path: Path, where: str) -> None:
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    driver, press = streamed(arm, q=START + 0.1), lambda: os.kill(os.getpid(), signal.SIGINT)
    play_once, finish_once = driver.play, driver.controller.finish

    def press_and_play(command, folder):
        press()
        return play_once(command, folder)

    def press_and_finish() -> None:
        if driver.played == 0:
            press()
        finish_once()

    if where == "before the stream":
        driver.play = press_and_play
    else:
        driver.controller.finish = press_and_finish
    try:
        with pytest.raises(StrandcastError, match="interrupted by SIGINT"):
            throw(arm, driver, tmp_path, move_to_start=True)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert np.abs(driver.controller.target - START).max() < 1e-6


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_in_the_soft_stop(arm: PlanarArm, tmp_path: Path, number: signal.Signals) -> None:
    driver = streamed(arm)
    write = driver.controller.write

    def write_and_signal(q, qd):
        if len(kills) == 0 and driver.clock.since_s > MIDDLE_S:
            kills.append(os.kill(os.getpid(), number))
        write(q, qd)

    kills: list[None] = []
    driver.controller.write = write_and_signal
    # Under nohup, which the tests may run under, a signal that is ignored stays so.
    handler = signal.signal(number, signal.default_int_handler)
    try:
        _, log = stopped(arm, driver, tmp_path, ABORTED, number.name)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, handler)
    assert_soft(arm, log)


def test_a_second_ctrl_c_does_not_lose_the_log(
    arm: PlanarArm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run in the background
    driver = streamed(arm)
    play_once = driver.play

    def play_and_press(command, folder):
        recording = play_once(command, folder)
        os.kill(os.getpid(), signal.SIGINT)
        return recording

    def write_and_press(path, log):
        os.kill(os.getpid(), signal.SIGINT)
        return write_joint_log(path, log)

    def stop_and_press() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        driver.stopped += 1

    driver.play, driver.stop = play_and_press, stop_and_press
    monkeypatch.setattr("strandcast.executor.play.write_joint_log", write_and_press)
    assert throw(arm, driver, tmp_path).complete
    assert (tmp_path / "run" / "run.json").exists()
    assert driver.stopped == 1
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_a_protective_stop_is_a_fault_of_the_controller(
    arm: PlanarArm, tmp_path: Path, kind: type[Controller]
) -> None:
    driver = streamed(arm, kind)
    after(MIDDLE_S, lambda d, at: setattr(d.controller, "protective_at", at))(driver)
    run, log = stopped(arm, driver, tmp_path, STOPPED_BY_CONTROLLER, "protective stop")
    assert run.status == "fault"
    last = log.time_s[np.isfinite(log.since_start_s)][-1]
    assert log.time_s[-1] - last > 0.5
    assert np.ptp(log.q_cmd_rad[log.time_s > last + 0.01], axis=0).max() == 0.0  # no further commands


def test_a_link_that_dies_leaves_the_log_so_far(arm: PlanarArm, tmp_path: Path) -> None:
    driver = streamed(arm)
    after(MIDDLE_S, lambda d, at: setattr(d.controller, "deaf_at", at))(driver)
    _, log = stopped(arm, driver, tmp_path, ABORTED, "broken pipe")
    assert 350 < len(log.time_s) < 400


def test_a_failed_start_is_reported(arm: PlanarArm, tmp_path: Path) -> None:
    driver = streamed(arm)

    def start() -> None:
        raise OSError("no route")

    driver.controller.start = start
    driver.controller.write = lambda q, qd: pytest.fail("a link that has not started was written to")
    with pytest.raises(StrandcastError, match="no route") as caught:
        throw(arm, driver, tmp_path)
    assert caught.value.exit_code == ABORTED
    run = Run.read(tmp_path / "run" / "run.json")
    assert (run.complete, run.status, run.rows) == (False, "aborted", 0)


def test_a_state_reported_twice_is_logged_once(arm: PlanarArm) -> None:
    clock = VirtualClock()
    controller = Controller(clock, arm, START, rate_hz=250.0)
    command = make_motion(arm).trajectory().resampled(0.002)
    done = stream(controller, command, safety_bounds(arm), 500.0, list(arm.joints), clock=clock)
    assert done.status == "ok"
    assert np.diff(done.log.time_s).min() > 0.0039
    assert len(done.log.time_s) == pytest.approx(400, abs=2)
    assert np.mean(done.log.flags & AFTER_DUPLICATE > 0) > 0.9


def test_a_controller_faster_than_declared_is_stopped_before_the_log_is_full(arm: PlanarArm) -> None:
    driver = streamed(arm, PacingController)
    command = make_motion(arm).trajectory().resampled(0.002)
    done = stream(driver.controller, command, safety_bounds(arm), 250.0, list(arm.joints), clock=driver.clock)
    assert (done.status, driver.controller.finished) == ("aborted", 1)
    assert "faster than its rate" in str(done.reason)
    assert np.abs(done.log.qd_cmd_rad_s[-1]).max() < 1e-9


def test_a_log_that_cannot_be_written_is_an_incomplete_run(arm: PlanarArm, tmp_path: Path) -> None:
    driver = streamed(arm)
    original = driver.play

    def play_and_lose_the_folder(command, folder):
        recording = original(command, folder)
        folder.rmdir()
        folder.write_text("no folder any more")
        return recording

    driver.play = play_and_lose_the_folder
    with pytest.raises(StrandcastError, match="SC-W002") as caught:
        throw(arm, driver, tmp_path)
    assert caught.value.exit_code == LOG_INCOMPLETE
    assert driver.stopped == 1


def test_a_folder_that_is_not_writable_is_refused_beforehand(arm: PlanarArm, tmp_path: Path) -> None:
    (tmp_path / "run").write_text("a file")
    driver = streamed(arm)
    with pytest.raises(StrandcastError, match="SC-W002") as caught:
        throw(arm, driver, tmp_path)
    assert caught.value.exit_code == REFUSED
    assert not driver.played


def test_a_driver_that_fails_leaves_an_incomplete_run(arm: PlanarArm, tmp_path: Path) -> None:
    driver = streamed(arm)

    def explode(command, folder):
        raise RuntimeError("segment lost")

    driver.play = explode
    with pytest.raises(StrandcastError, match=r"SC-X011.*segment lost") as caught:
        throw(arm, driver, tmp_path)
    assert caught.value.exit_code == LOG_INCOMPLETE
    assert driver.stopped == 1
    assert not (tmp_path / "run" / "run.json").exists()


def test_a_slow_move_brings_the_arm_to_the_start(arm: PlanarArm, tmp_path: Path) -> None:
    driver = streamed(arm, q=START + np.array([0.2, -0.1, 0.0]))
    with pytest.raises(StrandcastError, match="SC-X006"):
        throw(arm, driver, tmp_path)
    run = throw(arm, driver, tmp_path, move_to_start=True)
    assert run.complete


def test_four_times_slower_is_the_same_path(arm: PlanarArm, tmp_path: Path) -> None:
    driver = streamed(arm)
    run = throw(arm, driver, tmp_path, time_scale=4.0)
    log = read_joint_log(tmp_path / "run" / "joints.csv")
    assert run.time_scale == 4.0
    assert run.motion_end_s - run.motion_start_s == pytest.approx(2.0)
    s = log.since_start_s[np.isfinite(log.since_start_s)] / 2.0
    q = log.q_cmd_rad[np.isfinite(log.since_start_s), 2]
    np.testing.assert_allclose(q, START[2] + 0.8 * s**3 * (10 - 15 * s + 6 * s**2), atol=1e-6)


def test_a_dry_run_reports_a_host_that_is_late(arm: PlanarArm, tmp_path: Path) -> None:
    driver = streamed(arm)
    make_motion(arm, 0.8).write(tmp_path / "planned.json")
    for late_s, refused in ((0.0, False), (0.0015, True)):
        driver.clock.late = dict.fromkeys(np.arange(0.0, 2.0, 0.1).tolist(), late_s)
        driver.clock.origin_ns = driver.clock.ns
        preflight = run_preflight(
            tmp_path / "planned.json", arm, driver, tmp_path / "run", clock=driver.clock
        )
        report = "\n".join(dry_run_report(preflight))
        assert (preflight.refused_live is not None) == refused
        assert ("p99 is 1.53 ms late, allowed 0.50 ms" in report) == refused
        assert ("a live run would be refused now (SC-X018); allow real-time scheduling" in report) == refused


def test_a_host_that_is_late_is_refused(arm: PlanarArm, tmp_path: Path) -> None:
    driver = streamed(arm)
    driver.clock.late = dict.fromkeys(np.arange(0.0, 2.0, 0.1).tolist(), 0.0015)
    with pytest.raises(StrandcastError, match=r"SC-X018.*1.5") as caught:
        throw(arm, driver, tmp_path)
    assert caught.value.exit_code == REFUSED
    assert driver.controller.sent == []
    driver.clock.late = dict.fromkeys(np.arange(0.0, 2.0, 0.1).tolist(), 0.0015)
    driver.clock.origin_ns = driver.clock.ns
    assert throw(arm, driver, tmp_path, soft_realtime=True).complete
