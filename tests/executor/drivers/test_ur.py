"""The UR driver, by the real client ur_rtde, against a stand-in for the controller (see rtde_standin).

It shows what happens on the wire and in the log; it does not show what a UR does. Most faults are tried at
the rate of a CB3, where a busy machine is late by less of a cycle; where the machine itself stalls a throw,
as no test can forbid, it is tried again.
"""

import itertools
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.errors import (
    ABORTED,
    ENVIRONMENT,
    LOG_INCOMPLETE,
    REFUSED,
    STOPPED_BY_CONTROLLER,
    StrandcastError,
)
from strandcast.executor.drivers.ur import UrDriver
from strandcast.executor.drivers.ur_sender import MESSAGE, OUTPUT, SERVO, STOP, newest
from strandcast.executor.play import play
from strandcast.executor.preflight import PlayOptions, run_preflight
from strandcast.records.joint_log import JointLog, Run, read_joint_log, read_run

from ..motions import swing
from .network import Network
from .rtde_standin import Setting, StandIn

pytest.importorskip("rtde_control", reason="vendor package ur_rtde; make test-drivers")

ARMS = Path(__file__).parents[3] / "config" / "arms"
START = np.array([-1.2, -1.0, -0.6])
WAY = np.array([0.5, -0.35, 0.4])
DURATION_S = 0.6
LEAD_S = 0.5  # the arm is held so long before the motion begins
MID_S = LEAD_S + 0.5 * DURATION_S  # when most faults happen
SERVO_LAG_S = 0.034  # of the stand-in: look-ahead and transport
PEAK = 1.875  # of a swing's speed, over its mean
CB3 = {"version": (3, 15, 0)}
NUMBERS = itertools.count(1)

again = pytest.mark.flaky(reruns=4, reruns_delay=2)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("strandcast.executor.streaming.jitter.TIMING_TEST_S", 0.01)


@dataclass
class Bench:
    """An arm's file, a motion and a stand-in."""

    folder: Path
    arm: PlanarArm
    standin: StandIn
    options: PlayOptions

    def play(self, trial: str = "trial-01") -> Run:
        driver = UrDriver(self.arm)
        preflight = run_preflight(
            self.folder / "planned.json", self.arm, driver, self.folder / trial, self.options
        )
        return play(preflight, driver, preflight.short_hash)

    def fails(self) -> tuple[StrandcastError, Run, JointLog]:
        """Return the error, and what is kept of the run."""
        with pytest.raises(StrandcastError) as caught:
            self.play()
        assert (self.folder / "trial-01" / "motion.json").exists()
        run = Run.read(self.folder / "trial-01" / "run.json")
        assert not run.complete
        return caught.value, run, read_joint_log(self.folder / "trial-01" / "joints.csv")


Make = Callable[..., Bench]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Make]:
    standins = []

    def make(
        settings: dict[str, Any] | None = None,
        payload: str = "",
        away: float = 0.005,
        to_start: bool = False,
        **setting: Any,
    ) -> Bench:
        number = next(NUMBERS)
        host = f"127.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.{number}"
        folder = tmp_path / str(number)
        folder.mkdir()
        rate_hz = 125 if setting.get("version") == CB3["version"] else 500
        arm = arm_at(folder, {"host": host, "rate_hz": rate_hz, "watchdog_hz": 5} | (settings or {}), payload)
        swing(arm, START, WAY, DURATION_S).write(folder / "planned.json")
        standing = [*arm.held.values()]
        q = [standing[0], *(START + away), standing[1], standing[2]]
        standins.append(StandIn(Setting(host=host, q_rad=q, **setting)))
        return Bench(folder, arm, standins[-1], PlayOptions(soft_realtime=True, move_to_start=to_start))

    yield make
    for standin in standins:
        standin.end()


def arm_at(folder: Path, settings: dict[str, Any], payload: str) -> PlanarArm:
    """Return the example arm with the settings that a lab would write into its file."""
    (folder / "ur5e-example.urdf").write_bytes((ARMS / "ur5e-example.urdf").read_bytes())
    text = (ARMS / "ur5e-example.toml").read_text()
    lines = "\n".join(f"{key} = {value!r}" for key, value in settings.items()).replace("'", '"')
    text = text[: text.index("[driver]")] + f'{payload}\n[driver]\nname = "ur"\n[driver.settings]\n{lines}\n'
    (folder / "arm.toml").write_text(text)
    return load_arm(folder / "arm.toml").planar()


def played(bench: Bench) -> tuple[Run, JointLog]:
    bench.play()
    return read_run(bench.folder / "trial-01")


def at_rest(bench: Bench) -> dict[str, Any]:
    """Return the stand-in's report once its arm stands; fail if it does not come to rest."""
    for _ in range(100):
        report = bench.standin.report()
        if max(map(abs, report["qd_rad_s"])) < 1e-3:
            return report
        time.sleep(0.02)
    raise AssertionError(f"the arm still moves: {report}")


@again
def test_a_throw_is_played_and_logged_completely(bench: Make) -> None:
    there = bench(settings={"sync_output": 2})
    run, log = played(there)
    report = there.standin.report()
    assert (run.driver, run.clock, run.complete) == ("ur", "UR controller", True)
    assert run.controller["model"] == "UR5"
    assert run.controller["software"].startswith("5.11.0")
    assert run.timing.nominal_rate_hz == 500
    assert (np.diff(log.time_s) > 0).all()
    assert log.time_s[0] < run.motion_start_s < run.motion_start_s + DURATION_S + 0.5 < log.time_s[-1]
    np.testing.assert_allclose(log.q_rad[-1], START + WAY, atol=1e-3)
    np.testing.assert_allclose(report["q_rad"][1:4], START + WAY, atol=1e-4)
    np.testing.assert_allclose(
        np.delete(report["q_rad"], [1, 2, 3]), list(there.arm.held.values()), atol=1e-6
    )
    np.testing.assert_allclose(run.following.lag_s, SERVO_LAG_S, atol=0.008)
    assert max(run.following.peak_error_rad) < 0.02
    assert report["first_step_rad"] < 1e-3  # though the arm stood 5 mrad off the start
    assert report["servo_stop"] >= 1
    assert (report["playing"], report["watchdog_trips"]) == (False, 0)


@again
def test_the_sync_output_is_high_during_the_motion_and_in_run_json(bench: Make) -> None:
    run, _ = played(bench(settings={"sync_output": 0}))
    on, off = run.sync_events
    assert (on.kind, off.kind) == ("led_on", "led_off")
    assert abs(on.time_s - run.motion_start_s) < 0.03
    assert abs(off.time_s - on.time_s - DURATION_S) < 0.02
    assert 0.0005 < on.sigma_s < 0.01


@again
def test_all_six_joints_move_slowly_to_the_start(bench: Make) -> None:
    there = bench(**CB3, away=0.06, to_start=True)
    run, log = played(there)
    assert run.complete
    np.testing.assert_allclose(log.q_rad[0], START, atol=2e-3)
    assert there.standin.report()["uploads"] >= 2  # a program for the way to the start, and one for the throw


def test_an_arm_away_from_the_start_plays_nothing(bench: Make) -> None:
    there = bench(away=0.06)
    with pytest.raises(StrandcastError, match=r"from its start") as caught:
        there.play()
    assert caught.value.exit_code == REFUSED
    assert not there.standin.report()["moved"]


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ({"speed_fraction": 0.5}, "speed scaling is 50 %"),
        ({"speed_scaling": 0.5}, "speed scaling is 50 %"),
        ({"remote": False}, "not in remote control"),
        ({"safety_mode": 3}, "protective stop"),
        ({"safety_mode": 7}, "robot emergency stop"),
        ({"robot_mode": 5}, "idle"),
        ({"program_runs": True}, "a program runs"),
        ({"clock_stands": True}, "nothing new came"),
        ({"payload_kg": 1.0, "payload_centre_m": [0.0, 0.0, 0.03]}, "1.000 kg"),
        ({"payload_kg": 0.05, "payload_centre_m": [0.0, 0.1, 0.03]}, "payload's centre is 0.100 m"),
    ],
)
@pytest.mark.parametrize("to_start", [False, True], ids=["at the start", "to the start"])
def test_a_controller_that_is_not_ready_is_refused_before_anything_is_sent(
    bench: Make, setting: dict[str, Any], said: str, to_start: bool
) -> None:
    loaded = {"payload_kg": 0.05, "payload_centre_m": [0.0, 0.0, 0.03]}
    payload = "[payload]\nmass_kg = 0.05\ncentre_m = [0.0, 0.0, 0.03]\n"
    there = bench(payload=payload, to_start=to_start, **(loaded | setting))
    with pytest.raises(StrandcastError, match=said) as caught:
        there.play()
    assert caught.value.exit_code == REFUSED
    report = there.standin.report()
    assert (report["uploads"], report["moved"], report["servo_stop"]) == (0, False, 0)
    assert not (there.folder / "trial-01").exists()


def test_a_controller_with_another_rate_is_refused(bench: Make) -> None:
    there = bench(settings={"rate_hz": 500}, **CB3)
    with pytest.raises(StrandcastError, match=r"rate_hz.*125 Hz") as caught:
        there.play()
    assert caught.value.exit_code == REFUSED


def test_a_missing_controller_is_reported(bench: Make) -> None:
    there = bench()
    there.standin.end()
    with pytest.raises(StrandcastError, match="SC-X061") as caught:
        there.play()
    assert caught.value.exit_code == ENVIRONMENT


@again
def test_an_old_controller_that_reports_no_payload_can_play(bench: Make) -> None:
    there = bench(**CB3, absent=["payload", "payload_cog"], payload="[payload]\nmass_kg = 0.05\n")
    assert played(there)[0].complete


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"protective_stop_at_s": MID_S}, "protective stop"),
        ({"emergency_stop_at_s": MID_S}, "robot emergency stop"),
        ({"stop_program_at_s": MID_S}, "program on the controller was stopped"),
    ],
    ids=["protective stop", "emergency stop", "stopped at the pendant"],
)
@again
def test_a_stop_by_the_controller_keeps_the_log(bench: Make, fault: dict[str, Any], said: str) -> None:
    there = bench(**CB3, **fault)
    error, run, log = there.fails()
    assert (error.exit_code, run.status) == (STOPPED_BY_CONTROLLER, "fault")
    assert said in run.reason
    assert 0 < run.motion_start_s < log.time_s[-1] < run.motion_start_s + 0.5 * DURATION_S + 1.0
    np.testing.assert_allclose(log.qd_rad_s[-1], 0.0, atol=1e-3)  # the tail shows how it came to rest
    assert there.standin.report()["servoj"] < MID_S * 125 + 5


@again
def test_a_speed_slider_that_is_moved_stops_the_arm_softly(bench: Make) -> None:
    there = bench(**CB3, slow_at_s=MID_S)
    error, run, log = there.fails()
    assert (error.exit_code, run.status) == (ABORTED, "aborted")
    assert "50 %" in run.reason
    went = log.q_cmd_rad[-1] - START
    assert (np.abs(went) < 0.95 * np.abs(WAY)).all()
    assert (np.abs(went) > 0.5 * np.abs(WAY)).all()
    np.testing.assert_allclose(log.q_rad[-1], log.q_cmd_rad[-1], atol=1e-3)
    assert there.standin.report()["watchdog_trips"] == 0


@again
def test_an_interrupt_stops_the_arm_softly(bench: Make) -> None:
    there = bench(**CB3)
    when_it_moves(there, lambda: os.kill(os.getpid(), signal.SIGINT))
    error, run, _ = there.fails()
    assert (error.exit_code, run.reason) == (ABORTED, "interrupted by SIGINT")
    report = at_rest(there)
    assert (report["watchdog_trips"], report["servo_stop"]) == (0, 1)


@again
def test_lost_packages_are_gaps_in_run_json(bench: Make) -> None:
    run, log = played(bench(**CB3, lose_every=7))
    gaps = len(run.timing.gaps)
    assert gaps >= 0.1 * len(log.time_s)
    assert sum(gap.missing for gap in run.timing.gaps) >= gaps
    assert any(f"{gaps} gaps" in warning for warning in run.warnings)


@again
def test_repeated_packages_are_logged_once(bench: Make) -> None:
    run, log = played(bench(**CB3, double_every=3))
    assert run.timing.duplicates == 0
    assert (np.diff(log.time_s) > 0).all()


@again
def test_late_packages_appear_as_lag(bench: Make) -> None:
    run, _ = played(bench(**CB3, delay_s=0.024))
    np.testing.assert_allclose(run.following.lag_s, SERVO_LAG_S + 0.024, atol=0.016)


@again
def test_too_many_lost_packages_end_the_run(bench: Make) -> None:
    error, run, log = bench(**CB3, lose=(MID_S, MID_S + 0.06)).fails()
    assert error.exit_code in (LOG_INCOMPLETE, ABORTED)  # by how late the machine is: 60 of 80 ms are lost
    assert max(gap.duration_s for gap in run.timing.gaps) > 0.05
    assert log.time_s[-1] > run.motion_start_s + 0.5 * DURATION_S


@again
def test_a_frozen_time_stamp_stops_the_arm_softly(bench: Make) -> None:
    there = bench(**CB3, freeze_stamp_at_s=MID_S)
    error, run, log = there.fails()
    assert (error.exit_code, run.reason) == (ABORTED, "the controller's clock has stopped")
    assert len(log.time_s) > 0.9 * MID_S * 125
    report = at_rest(there)
    assert (report["watchdog_trips"], report["servo_stop"]) == (0, 1)
    assert (np.abs(np.array(report["q_rad"])[1:4] - START - WAY) > 0.01).all()  # stopped before its end


@again
def test_on_a_slow_network_that_loses_packets_the_arm_keeps_up_or_stops(
    bench: Make, network: Callable[..., Network]
) -> None:
    there = bench(**CB3)
    between = network(there.standin.host, 29999, 30001, 30002, 30003, 30004)
    there.arm.driver_settings["host"] = between.host
    when_it_moves(there, lambda: setattr(between.loss, "value", 0.01), since_s=0.0)
    with suppress(StrandcastError):
        there.play()
    run = Run.read(there.folder / "trial-01" / "run.json")
    assert run.status != "fault", run.reason  # the stand-in stops where its target jumps
    assert run.lateness is not None
    report = at_rest(there)
    step_rad = PEAK * np.abs(WAY).max() / DURATION_S / 125.0
    assert report["largest_step_rad"] < 1.01 * (1 + run.lateness.missed) * step_rad


@pytest.mark.parametrize("fault", ["half_close_at_s", "mute_at_s", "drop_sender_at_s"])
@again
def test_a_broken_connection_ends_the_run_and_nothing_resumes_it(bench: Make, fault: str) -> None:
    there = bench(**CB3, **{fault: MID_S})
    error, run, log = there.fails()
    assert error.exit_code in (ABORTED, STOPPED_BY_CONTROLLER)
    assert run.status in ("aborted", "fault")
    assert len(log.time_s) > 0.8 * MID_S * 125
    assert (np.abs(log.q_rad[-1] - START - WAY) > 0.01).all()  # stopped before its end
    time.sleep(1.0)
    report = there.standin.report()
    assert (report["servoj_after_break"], report["rtde"], report["uploads"]) == (
        0,
        2,
        1,
    )  # no new connection


@again
def test_a_controller_that_dies_ends_the_run_and_nothing_goes_to_its_successor(bench: Make) -> None:
    there = bench(**CB3, die_at_s=MID_S)
    error, _, log = there.fails()
    assert error.exit_code in (ABORTED, STOPPED_BY_CONTROLLER)
    assert len(log.time_s) > 0.8 * MID_S * 125
    successor = StandIn(Setting(host=there.standin.host, **CB3))
    try:
        time.sleep(1.5)
        assert successor.report()["rtde"] == 0
    finally:
        successor.end()


@pytest.fixture
def senders(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[bytes]]:
    """Return the sending processes, as they are started."""
    started = []

    class Noted(subprocess.Popen[bytes]):
        def __init__(self, *how: Any, **more: Any) -> None:
            super().__init__(*how, **more)
            started.append(self)

    monkeypatch.setattr("strandcast.executor.drivers.ur_sender_handle.subprocess.Popen", Noted)
    return started


@pytest.mark.parametrize(
    ("done", "said"),
    [
        (signal.SIGKILL, "(sending process has ended|Broken pipe)"),
        (signal.SIGSTOP, "did not return from servoJ"),
    ],
    ids=["killed", "hanging"],
)
@again
def test_without_the_sending_process_the_watchdog_stops_the_arm(
    bench: Make, senders: list[subprocess.Popen[bytes]], done: signal.Signals, said: str
) -> None:
    there = bench(**CB3)
    when_it_moves(there, lambda: senders[-1].send_signal(done))
    error, run, _ = there.fails()
    assert error.exit_code == ABORTED
    assert re.search(said, run.reason)
    assert senders[-1].poll() is not None  # nothing is left that could go on sending
    report = at_rest(there)
    assert (report["watchdog_trips"], report["servo_stop"], report["playing"]) == (1, 0, False)


def test_an_outdated_set_point_is_not_sent() -> None:
    player, sender = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with player, sender:
        for k, what in enumerate([SERVO, SERVO, SERVO, OUTPUT, SERVO, STOP]):
            player.send(MESSAGE.pack(what, *[float(k)] * 6))
        taken = [newest(sender) for _ in range(4)]
        assert [(what, numbers[0]) for what, numbers in taken] == [
            (SERVO, 2),
            (OUTPUT, 3),
            (SERVO, 4),
            (STOP, 5),
        ]
        player.close()
        with pytest.raises(ConnectionError):
            newest(sender)


@again
def test_when_the_player_is_killed_the_sender_stops_the_arm_and_ends(bench: Make) -> None:
    there = bench(**CB3)
    player = subprocess.Popen([sys.executable, "-c", PLAYER, str(there.folder)], stderr=subprocess.DEVNULL)
    when_it_moves(there, player.kill)
    player.wait()
    report = at_rest(there)
    assert report["servoj"] >= 0.9 * MID_S * 125
    assert report["servo_stop"] + report["watchdog_trips"] >= 1
    assert not sending_to(there.standin.host)


PLAYER = """
import sys
from pathlib import Path
from strandcast.arm.load import load_arm
from strandcast.executor.play import play
from strandcast.executor.preflight import PlayOptions, run_preflight
from strandcast.executor.drivers.ur import UrDriver
folder = Path(sys.argv[1])
driver = UrDriver(arm := load_arm(folder / "arm.toml"))
options = PlayOptions(soft_realtime=True)
ready = run_preflight(folder / "planned.json", arm, driver, folder / "trial-01", options)
play(ready, driver, ready.short_hash)
"""


def sending_to(host: str) -> bool:
    """Return whether a sending process to a controller still lives some seconds later."""
    for _ in range(100):
        commands = [path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline") if path.exists()]
        if not any(b"ur_sender" in command and host.encode() in command for command in commands):
            return False
        time.sleep(0.05)
    return True


def when_it_moves(there: Bench, do: Callable[[], object], since_s: float = MID_S) -> None:
    """Do something in the middle of the motion, or so long after the first set point."""

    def wait() -> None:
        while there.standin.report()["servoj"] <= since_s * 125:
            time.sleep(0.005)
        do()

    threading.Thread(target=wait, daemon=True).start()
