"""The Franka driver against a real FCI server: franka-sim, with the reflexes of a real controller.

The server runs slower than real time on a busy machine, which a driver that goes by the controller's clock
must not mind. Where the machine itself stalls us, as no test can forbid, the test is run again.
"""

import csv
import platform
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.interpolate import BPoly

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import ABORTED, ENVIRONMENT, REFUSED, STOPPED_BY_CONTROLLER, StrandcastError
from strandcast.executor.drivers.franka import FrankaDriver
from strandcast.executor.drivers.franka_link import FrankaLink
from strandcast.executor.drivers.protocol import Recording
from strandcast.executor.play import play
from strandcast.executor.preflight import PlayOptions, run_preflight
from strandcast.executor.streaming.easing import EASE_S
from strandcast.records.joint_log import JointLog, Run, read_joint_log, read_run
from strandcast.records.motion import Motion

from .. import motions
from .franka_sim import Server, served

pytest.importorskip("pylibfranka", reason="vendor package; make test-drivers")

ARMS = Path(__file__).parents[3] / "config" / "arms"
START = np.array([-0.30, -2.00, 1.90])
# Control heights of velocity curves as the planner draws them, from rest to rest: one of up to 2.1 rad/s and
# 8 rad/s², and one that ends where it began, from which the way back is short.
FAST = np.array(
    [[0, 0, -1.0, 2.0, 4.0, 1.5, 0, 0], [0, 0, 2.2, 3.8, 0.5, 0.2, 0, 0], [0, 0, -1.0, 2.0, 3.8, 2.5, 0, 0]]
)
BACK = np.array([[0, 0, -2, -2, 2, 2, 0, 0], [0, 0, 3, 1, -1, -3, 0, 0], [0, 0, 3, 2, -2, -3, 0, 0]])
DURATION_S = 1.0

pytestmark = pytest.mark.flaky(reruns=4, reruns_delay=2)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with served(tmp_path_factory.mktemp("franka-sim")) as server:
        yield server


@pytest.fixture
def arm(server: Server, tmp_path: Path) -> PlanarArm:
    arm = arm_at(server, tmp_path)
    with connected(FrankaDriver(arm)) as driver:
        if driver.state().fault:  # a reflex that the test before was ended by
            recover(driver)
    return arm


def recover(driver: FrankaDriver) -> str:
    """Clear a reflex, as a person does in Desk; return which."""
    state = driver._robot.read_once()
    driver._robot.automatic_error_recovery()
    return f"{state.robot_mode.name}, {state.current_errors}"


def arm_at(server: Server, folder: Path) -> PlanarArm:
    """Return the example arm at the server's address, as a lab would write it into the file."""
    text = (ARMS / "fr3-example.toml").read_text()
    for old, new in (('host = ""', f'host = "{server.host}"'), ('"enforce"', '"ignore"')):
        assert old in text
        text = text.replace(old, new)
    (folder / "arm.toml").write_text(text)
    (folder / "fr3-example.urdf").write_text((ARMS / "fr3-example.urdf").read_text())
    return load_arm(folder / "arm.toml").planar()


def motion_of(arm: PlanarArm, heights: np.ndarray = BACK) -> Motion:
    time_ns = np.arange(round(1000 * DURATION_S) + 1) * 1_000_000
    curve = BPoly(heights.T[:, None, :], [0.0, DURATION_S])
    place, acceleration = curve.antiderivative(), curve.derivative()
    t = time_ns * 1e-9
    return motions.motion_of(arm, time_ns, START + place(t), curve(t), acceleration(t))


def command_of(arm: PlanarArm) -> JointTrajectory:
    return motion_of(arm).trajectory().resampled(0.001)


def planned(arm: PlanarArm, folder: Path, heights: np.ndarray = BACK) -> Path:
    path = folder / "planned.json"
    motion_of(arm, heights).write(path)
    return path


@contextmanager
def connected(driver: FrankaDriver) -> Iterator[FrankaDriver]:
    """Let the connection go in any case: the server has one client at a time, and the next would wait."""
    driver.connect()
    try:
        yield driver
    finally:
        driver.stop()


@pytest.fixture
def driver(arm: PlanarArm) -> Iterator[FrankaDriver]:
    with connected(FrankaDriver(arm)) as driver:
        yield driver


def throw(arm: PlanarArm, motion: Path, driver: FrankaDriver, folder: Path) -> Run:
    """Play as a person would who accepts what this machine can do."""
    options = PlayOptions(hanging_m=0.3, move_to_start=True, soft_realtime=True)
    preflight = run_preflight(motion, arm, driver, folder, options)
    return play(preflight, driver, preflight.short_hash)


def typed(arm: PlanarArm, motion: Path, folder: Path) -> list[str]:
    """Return the command that does the same."""
    return [
        sys.executable,
        "-m",
        "strandcast",
        "play",
        str(motion),
        "--arm",
        str(arm.path),
        "--out",
        str(folder),
        "--hanging",
        "0.3",
        "--move-to-start",
        "--accept-soft-realtime",
        "--confirm",
        Motion.read(motion).content_sha256()[:8],
    ]


def test_a_throw_is_played_and_the_arm_follows(arm: PlanarArm, tmp_path: Path) -> None:
    motion = planned(arm, tmp_path, FAST)
    folder = tmp_path / "trial"
    done = subprocess.run(typed(arm, motion, folder), capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    run, log = read_run(folder)
    assert (run.complete, run.status, run.driver) == (True, "ok", "franka")
    assert run.timing.rate_hz == pytest.approx(1000.0)
    assert log.time_s[-1] >= run.motion_end_s + 0.5
    assert log.time_s[0] <= run.motion_start_s - EASE_S
    asked = ~np.isnan(log.since_start_s)
    plan = Motion.read(motion).trajectory().resampled(0.001)
    k = np.round(1000 * log.since_start_s[asked]).astype(int)
    np.testing.assert_allclose(log.q_cmd_rad[asked], plan.q_rad[k], atol=1e-9)
    np.testing.assert_allclose(log.time_s[asked][0], run.motion_start_s, atol=2e-3)
    lag_s, off = best_lag(log)
    assert 0.0 <= lag_s <= 0.03
    assert off.max() < 0.05
    assert np.ptp(log.q_rad, axis=0).min() > 0.3
    np.testing.assert_allclose(log.q_rad[-1], plan.q_rad[-1], atol=2e-3)
    table = held_still(folder / "franka.csv", rows=run.rows)
    # What the controller understood is what was sent in the cycle before, in its single precision.
    asked = np.array([[float(row[f"q_d{j}_rad"]) for j in (2, 4, 6)] for row in table])[: run.rows]
    eased = log.time_s > log.time_s[0] + EASE_S + 0.01
    steady = eased[1:] & (np.diff(log.time_s) < 0.0015)
    assert np.quantile(np.abs(asked[1:] - log.q_cmd_rad[:-1])[steady], 0.9) < 1e-6
    np.testing.assert_allclose(asked[1:][steady], log.q_cmd_rad[:-1][steady], atol=2e-4)


def best_lag(log: JointLog) -> tuple[float, np.ndarray]:
    """Return the lag after which the command fits the arm best, and each joint's largest misfit then."""
    lags = np.arange(0.0, 0.06, 0.0005)
    since = log.time_s - log.time_s[0]
    inner = since > 0.1

    def off(lag: float) -> np.ndarray:
        delayed = [np.interp(since - lag, since, column) for column in log.q_cmd_rad.T]
        return np.abs(log.q_rad - np.array(delayed).T)[inner]

    best = min(lags, key=lambda lag: float(np.square(off(lag)).sum()))
    return float(best), off(best).max(axis=0)


def held_still(path: Path, rows: int) -> list[dict[str, str]]:
    with path.open() as file:
        table = list(csv.DictReader(file))
    assert len(table) >= rows
    for joint in (1, 3, 5, 7):
        assert np.ptp([float(row[f"q{joint}_rad"]) for row in table]) < 2e-3
        assert np.ptp([float(row[f"q_d{joint}_rad"]) for row in table]) == 0.0
    assert np.ptp([float(row["q4_rad"]) for row in table]) > 0.2
    return table


def test_a_throw_begins_at_the_arms_posture_and_ends_properly(
    arm: PlanarArm, server: Server, tmp_path: Path
) -> None:
    # Within the tolerance of the start, and a held joint a little off: a step of either would be a reflex.
    elsewhere = replace(arm, held=arm.held | {"fr3_joint7": arm.held["fr3_joint7"] + 0.004})
    with connected(FrankaDriver(arm)) as driver:
        driver.move_to_start(START + 0.004)
    ended = server.ended()
    with connected(FrankaDriver(elsewhere)) as driver:
        held = driver.state().q_held_rad["fr3_joint7"]
        recording = driver.play(command_of(arm), tmp_path)
        ended = server.ended() - ended
    assert held == pytest.approx(arm.held["fr3_joint7"], abs=1e-3)
    assert (recording.status, recording.reason, ended) == ("ok", None, 1)
    np.testing.assert_allclose(recording.log.q_rad[0], START + 0.004, atol=1e-3)
    np.testing.assert_allclose(recording.log.q_rad[-1], START, atol=1e-3)
    table = held_still(tmp_path / "franka.csv", rows=len(recording.log.time_s))
    # This server lets the very first set point jump; an arm would not.
    asked = np.array([float(row["q_d2_rad"]) for row in table])[:400]
    assert np.ptp(asked) == pytest.approx(0.004, abs=1e-3)
    assert np.abs(np.diff(asked)).max() < 1e-4


def test_an_arm_away_from_the_start_plays_nothing(
    driver: FrankaDriver, arm: PlanarArm, tmp_path: Path
) -> None:
    driver.move_to_start(START)
    command = command_of(arm)
    away = replace(command, q_rad=command.q_rad + 0.1)
    recording = driver.play(away, tmp_path)
    assert recording.status == "aborted"
    assert "0.100 rad from the motion's start" in recording.reason
    np.testing.assert_allclose(driver.state().q_rad, START, atol=1e-3)


@pytest.mark.parametrize(("joint", "factor", "kind"), [(0, 1.5, "velocity"), (2, -3.0, "position")])
def test_a_motion_beyond_the_limits_is_refused_before_anything_is_sent(
    arm: PlanarArm, server: Server, tmp_path: Path, joint: int, factor: float, kind: str
) -> None:
    heights = FAST.copy()
    heights[joint] *= factor
    moves = server.asked("Move")
    with pytest.raises(StrandcastError, match=f"SC-X004.*{kind}") as caught:
        throw(arm, planned(arm, tmp_path, heights), FrankaDriver(arm), tmp_path / "trial")
    assert caught.value.exit_code == REFUSED
    assert server.asked("Move") == moves
    assert not (tmp_path / "trial").exists()


def test_too_fast_near_a_joints_end_is_refused_before_anything_is_sent(
    arm: PlanarArm, server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("strandcast.executor.drivers.franka_limits.MAX_SPEED_RAD_S", np.full(7, 0.1))
    moves = server.asked("Move")
    with pytest.raises(StrandcastError, match="SC-X004.*near its end"):
        throw(arm, planned(arm, tmp_path, FAST), FrankaDriver(arm), tmp_path / "trial")
    assert server.asked("Move") == moves


def test_payload_and_thresholds_are_set_on_the_controller(arm: PlanarArm, server: Server) -> None:
    arm.driver_settings.update(torque_threshold_n_m=[40.0] * 7, force_threshold_n=[60.0] * 6)
    before = server.asked("SetCollisionBehavior")
    with connected(FrankaDriver(arm)) as driver:
        assert driver.state().payload_kg == pytest.approx(arm.payload.mass_kg)
    assert server.asked("SetCollisionBehavior") == before + 1


class Jumping(FrankaDriver):
    """Plays with a step of 0.3 rad in the middle, which no check of ours sees."""

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        step = 0.3 * (command.time_s[:, None] > 0.4) * np.array([0.0, 1.0, 0.0])
        return super().play(replace(command, q_rad=command.q_rad + step), folder)


def test_a_reflex_ends_the_throw_and_leaves_the_log(arm: PlanarArm, tmp_path: Path) -> None:
    with pytest.raises(StrandcastError, match="SC-X011.*discontinuity") as caught:
        throw(arm, planned(arm, tmp_path), Jumping(arm), tmp_path / "trial")
    assert caught.value.exit_code == STOPPED_BY_CONTROLLER
    run = Run.read(tmp_path / "trial" / "run.json")
    assert (run.complete, run.status) == (False, "fault")
    assert "discontinuity" in run.reason
    log = read_joint_log(tmp_path / "trial" / "joints.csv")
    assert len(log.time_s) == run.rows
    # Until the step, and on until the arm is at rest.
    assert log.since_start_s[~np.isnan(log.since_start_s)].max() == pytest.approx(0.4, abs=0.01)
    assert log.time_s[-1] > run.motion_start_s + 0.4 + 0.5
    assert np.abs(log.qd_rad_s[-1]).max() < 0.05
    with (tmp_path / "trial" / "franka.csv").open() as file:
        assert list(csv.DictReader(file))[-1]["mode"] == "Reflex"


def test_after_a_reflex_the_arm_has_a_fault_until_it_is_recovered(arm: PlanarArm, tmp_path: Path) -> None:
    with connected(Jumping(arm)) as driver:
        reflex_and_recovery(driver, arm, tmp_path)


def reflex_and_recovery(driver: FrankaDriver, arm: PlanarArm, tmp_path: Path) -> None:
    driver.move_to_start(START)
    assert driver.state().fault is None
    recording = driver.play(command_of(arm), tmp_path)
    assert recording.status == "fault"
    assert "Reflex" in driver.state().fault
    assert "discontinuity" in driver.state().fault
    again = FrankaDriver.play(driver, command_of(arm), tmp_path)
    assert again.status == "fault"
    said = recover(driver)
    assert "Reflex" in said
    assert "discontinuity" in said
    assert driver.state().fault is None
    driver.move_to_start(START)
    again = FrankaDriver.play(driver, command_of(arm), tmp_path)
    assert (again.status, again.reason) == ("ok", None)


def test_an_arm_in_a_reflex_is_asked_for_no_settings(arm: PlanarArm, server: Server, tmp_path: Path) -> None:
    with connected(Jumping(arm)) as driver:
        driver.move_to_start(START)
        driver.play(command_of(arm), tmp_path)
        assert "Reflex" in driver.state().fault
    arm.driver_settings.update(torque_threshold_n_m=[40.0] * 7, force_threshold_n=[60.0] * 6)
    before = server.asked("SetCollisionBehavior")  # a controller in a reflex refuses it
    with connected(FrankaDriver(arm)) as again:
        assert "Reflex" in again.state().fault
        recover(again)
    assert server.asked("SetCollisionBehavior") == before


def test_states_that_cannot_be_written_do_not_lose_the_recording(
    driver: FrankaDriver, arm: PlanarArm, tmp_path: Path
) -> None:
    (tmp_path / "franka.csv").mkdir()
    driver.move_to_start(START)
    recording = driver.play(command_of(arm), tmp_path)
    assert len(recording.log.time_s) > 100
    assert recording.controller["franka.csv"].startswith("not written (")


class Stalling:
    """Loses some of the controller's cycles once, in the midst of the motion, between a state and its answer.

    Cycles, not milliseconds: on a busy machine the controller's are longer.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, cycles: int) -> None:
        self._write, self._lost_s, self._first_s, self.done = FrankaLink.write, 0.001 * cycles, None, False
        monkeypatch.setattr(FrankaLink, "write", lambda *args: self.write(*args))

    def write(self, link: FrankaLink, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        now_s = link.states[-1][1].time.to_sec()
        self._first_s = now_s if self._first_s is None else self._first_s
        if now_s > self._first_s + 0.9 and not self.done:
            self.done = True
            with suppress(RuntimeError):  # the controller's reflex, which the link sees next
                while link._control.readOnce()[0].time.to_sec() < now_s + self._lost_s:
                    pass
        self._write(link, q_rad, qd_rad_s)


def sleeping(write: Callable[..., None]) -> Callable[..., None]:
    """Let the sender sleep once, for longer than the controller's patience on any machine."""

    def slept(link: FrankaLink, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        if len(link.states) == 900:
            time.sleep(0.3)
        write(link, q_rad, qd_rad_s)

    return slept


def test_a_long_stall_ends_the_throw_and_leaves_the_log(
    driver: FrankaDriver, arm: PlanarArm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver.move_to_start(START)
    monkeypatch.setattr(FrankaLink, "write", sleeping(FrankaLink.write))
    recording = driver.play(command_of(arm), tmp_path)
    assert recording.status == "fault"
    assert "communication_constraints_violation" in recording.reason
    assert len(recording.log.time_s) > 1000
    assert recording.log.time_s[-1] > recording.motion_start_s + 0.4 + 0.5
    assert "communication_constraints_violation" in driver.state().fault
    assert "communication_constraints_violation" in recover(driver)
    assert driver.state().fault is None


def test_a_kept_error_does_not_keep_the_connection_open(
    arm: PlanarArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    with connected(FrankaDriver(arm)) as driver:
        driver.move_to_start(START)
        monkeypatch.setattr(FrankaLink, "write", sleeping(FrankaLink.write))
        with pytest.raises(StrandcastError, match="SC-X011") as caught:
            driver.move_to_start(START + 0.2)
    assert caught.tb is not None  # and with it whatever the stream's frames hold
    with connected(FrankaDriver(arm)) as driver:
        recover(driver)
        assert driver.state().fault is None


def test_the_stream_survives_a_few_lost_cycles(
    driver: FrankaDriver, arm: PlanarArm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver.move_to_start(START)
    Stalling(monkeypatch, 3)
    recording = driver.play(command_of(arm), tmp_path)
    assert (recording.status, recording.reason) == ("ok", None)
    np.testing.assert_allclose(recording.log.q_rad[-1], command_of(arm).q_rad[-1], atol=2e-3)
    assert (np.diff(recording.log.time_s) > 0.0015).any()
    assert recording.log.flags.any()


def test_more_lost_cycles_lead_to_the_soft_stop_without_a_reflex(
    driver: FrankaDriver, arm: PlanarArm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver.move_to_start(START)
    Stalling(monkeypatch, 8)
    recording = driver.play(command_of(arm), tmp_path)
    assert recording.status == "aborted"
    assert "missed" in recording.reason
    assert driver.state().fault is None
    at_rest_elsewhere(recording, arm)


def at_rest_elsewhere(recording: Recording, arm: PlanarArm) -> None:
    assert np.abs(recording.log.qd_rad_s[-1]).max() < 0.01
    assert np.abs(recording.log.q_rad[-1] - command_of(arm).q_rad[-1]).max() > 0.05


def test_an_interrupt_is_a_soft_stop(arm: PlanarArm, tmp_path: Path) -> None:
    folder = tmp_path / "trial"
    with subprocess.Popen(
        typed(arm, planned(arm, tmp_path), folder), stderr=subprocess.PIPE, text=True, cwd=tmp_path
    ) as process:
        # The folder is made when the arm stands at the start and is about to be played to.
        while not folder.exists() and process.poll() is None:
            time.sleep(0.02)
        time.sleep(0.9)
        process.send_signal(signal.SIGINT)
        said = process.communicate()[1]
    assert process.returncode == ABORTED, said
    assert "SC-X011" in said
    assert "SIGINT" in said
    run = Run.read(folder / "run.json")
    assert (run.complete, run.status) == (False, "aborted")
    log = read_joint_log(folder / "joints.csv")
    assert len(log.time_s) == run.rows > 500
    assert np.abs(log.qd_rad_s[-1]).max() < 0.01


def test_a_controller_that_dies_leaves_the_log(tmp_path: Path) -> None:
    with served(tmp_path) as server:
        arm = arm_at(server, tmp_path)
        with connected(FrankaDriver(arm)) as driver:
            driver.move_to_start(START)
            threading.Timer(1.0, server.kill).start()
            recording = driver.play(command_of(arm), tmp_path)
            assert recording.status == "fault"
            assert len(recording.log.time_s) > 300
            with pytest.raises(StrandcastError, match="SC-X061"):
                driver.state()


@pytest.mark.skipif("PREEMPT_RT" in platform.version(), reason="this kernel is a real-time one")
def test_a_kernel_without_real_time_is_refused_by_default(arm: PlanarArm) -> None:
    arm.driver_settings["realtime"] = "enforce"
    with pytest.raises(StrandcastError, match="SC-X061.*realtime") as caught:
        FrankaDriver(arm).connect()
    assert "PREEMPT_RT" in caught.value.fix


def test_a_missing_controller_is_reported(server: Server, tmp_path: Path) -> None:
    arm = arm_at(server, tmp_path)
    arm.driver_settings["host"] = "127.250.250.250"
    with pytest.raises(StrandcastError, match=r"SC-X061.*127\.250\.250\.250") as caught:
        FrankaDriver(arm).connect()
    assert caught.value.exit_code == ENVIRONMENT


def test_the_examples_links_match_the_controllers(driver: FrankaDriver, arm: PlanarArm) -> None:
    model = arm.model()
    data = mujoco.MjData(model)
    for _ in range(2):
        state = driver._robot.read_once()
        data.qpos[:] = state.q
        mujoco.mj_kinematics(model, data)
        # franka-sim without a hand reports the pose of the seventh link; the flange is 0.107 m further on.
        pose = np.array(state.O_T_EE).reshape(4, 4).T
        np.testing.assert_allclose(data.body("fr3_link7").xpos, pose[:3, 3], atol=1e-5)
        np.testing.assert_allclose(data.body("fr3_link7").xmat.reshape(3, 3), pose[:3, :3], atol=1e-5)
        driver.move_to_start(START + 0.1)
