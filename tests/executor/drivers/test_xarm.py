"""The xArm driver, by the vendor's client, against a stand-in for the control box (see xarm_standin).

It shows what happens on the wire and in the log; it does not show what an xArm does.
"""

import itertools
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.errors import ABORTED, ENVIRONMENT, REFUSED, STOPPED_BY_CONTROLLER, StrandcastError
from strandcast.executor.drivers.xarm import XArmDriver
from strandcast.executor.play import play
from strandcast.executor.preflight import PlayOptions, run_preflight
from strandcast.records.joint_log import JointLog, Run, read_joint_log, read_run
from strandcast.records.motion import Motion

from ..motions import swing
from .network import Network
from .xarm_standin import Handle

pytest.importorskip("xarm", reason="vendor package xarm-python-sdk; make test-drivers")

ARMS = Path(__file__).parents[3] / "config" / "arms"
START = np.array([-0.3, -1.2, 0.6])
WAY = np.array([0.3, -0.2, 0.3])
DURATION_S = 0.6
MOVING = [1, 2, 4]
LAG_S = 0.012  # about that of the stand-in
NUMBERS = itertools.count(1)

again = pytest.mark.flaky(reruns=4, reruns_delay=2)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("strandcast.executor.streaming.jitter.TIMING_TEST_S", 0.01)


class Bench:
    """An arm's file, a motion and a control box."""

    def __init__(self, folder: Path, arm: PlanarArm, box: Handle) -> None:
        self.folder, self.arm, self.box = folder, arm, box
        swing(arm, START, WAY, DURATION_S).write(folder / "planned.json")
        self.driver = XArmDriver(arm)

    def play(self, *, to_start: bool = False) -> tuple[Run, JointLog]:
        options = PlayOptions(soft_realtime=True, move_to_start=to_start)
        out = self.folder / "trial-01"
        preflight = run_preflight(self.folder / "planned.json", self.arm, self.driver, out, options)
        play(preflight, self.driver, preflight.short_hash)
        return read_run(out)

    def fails(self) -> tuple[StrandcastError, Run, JointLog]:
        """Return the error, and what is kept of the run."""
        with pytest.raises(StrandcastError) as caught:
            self.play()
        run = Run.read(self.folder / "trial-01" / "run.json")
        assert not run.complete
        return caught.value, run, read_joint_log(self.folder / "trial-01" / "joints.csv")


Make = Callable[..., Bench]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Make]:
    with ExitStack() as stack:

        def make(away: float = 0.005, firmware: str = "2.5.0", settings: str = "") -> Bench:
            host = f"127.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.{next(NUMBERS)}"
            (tmp_path / "xarm6-example.urdf").write_bytes((ARMS / "xarm6-example.urdf").read_bytes())
            text = (ARMS / "xarm6-example.toml").read_text()
            text = text.replace('host = "" ', f'host = "{host}"\n{settings}#')
            (tmp_path / "arm.toml").write_text(text)
            q_rad = np.zeros(6)
            q_rad[MOVING] = START + away
            box = Handle(tmp_path / "arm.toml", MOVING, q_rad.tolist(), firmware, host)
            stack.callback(box.end)
            return Bench(tmp_path, load_arm(tmp_path / "arm.toml").planar(), box)

        yield make


@again
def test_a_motion_is_played_and_logged_by_the_controllers_clock(bench: Make) -> None:
    setup = bench()
    run, log = setup.play()
    assert (run.complete, run.status, run.driver, run.clock) == (True, "ok", "xarm", "xArm controller")
    assert run.controller["firmware"] == "2.5.0"
    assert socket.getdefaulttimeout() is None  # the vendor's client sets one
    assert run.timing.rate_hz == pytest.approx(250.0, rel=0.02)
    assert log.time_s[0] > 999.0  # the box's own clock
    moving = np.isfinite(log.since_start_s)
    expected = Motion.read(setup.folder / "planned.json").trajectory()
    since_s = log.time_s[moving] - run.motion_start_s
    off = np.abs(log.q_rad[moving] - expected.at(since_s - LAG_S).q_rad)
    assert off.max() < 0.02
    seen = setup.box.seen()
    assert (seen.mode, seen.state, seen.error) == (0, 2, 0)
    steps = np.diff(seen.set_points, axis=0)
    assert np.abs(steps).max() < 0.02
    assert np.abs(seen.set_points[0][MOVING] - (START + 0.005)).max() < 1e-3  # where the arm stands


@again
def test_it_moves_to_the_start_slowly(bench: Make) -> None:
    setup = bench(away=0.1)
    setup.play(to_start=True)
    speeds = np.diff(setup.box.seen().set_points, axis=0)[:100] / 0.004
    assert np.abs(speeds).max() < 0.3


@again
def test_a_set_point_that_is_too_fast_is_the_controllers_error(bench: Make) -> None:
    setup = bench()
    setup.box.change(longer=10.0)
    error, run, _ = setup.fails()
    assert error.exit_code == STOPPED_BY_CONTROLLER
    assert "C60" in run.reason
    assert "speed" in run.reason.lower()
    assert setup.box.seen().error == 60  # nothing clears it


@again
def test_an_obstacle_stops_the_arm_and_the_log_is_kept(bench: Make) -> None:
    setup = bench()
    setup.box.change(hit_at_s=0.8)
    error, run, log = setup.fails()
    assert error.exit_code == STOPPED_BY_CONTROLLER
    assert run.status == "fault"
    assert "C31" in run.reason
    assert len(log.time_s) > 200


@again
def test_a_lost_connection_ends_the_run(bench: Make) -> None:
    setup = bench()
    setup.box.change(deaf_at_s=0.8)
    error, run, _ = setup.fails()
    assert error.exit_code == ABORTED
    assert run.reason


@again
def test_late_answers_hold_up_no_set_point(bench: Make) -> None:
    setup = bench()
    setup.box.change(delay_s=0.03)
    run, _ = setup.play()
    assert run.complete
    assert run.lateness is not None
    assert run.lateness.missed <= 2


@again
def test_on_a_slow_network_that_loses_packets_the_arm_keeps_up_or_stops(
    bench: Make, network: Callable[..., Network]
) -> None:
    setup = bench()
    between = network(setup.driver.address, 502, 30000, 30001)
    setup.driver.address = between.host

    def lose_from_the_first_set_point() -> None:
        while not setup.box.seen().set_points:
            time.sleep(0.01)
        between.loss.value = 0.01

    threading.Thread(target=lose_from_the_first_set_point, daemon=True).start()
    with suppress(StrandcastError):
        setup.play()
    run = Run.read(setup.folder / "trial-01" / "run.json")
    assert run.status != "fault", run.reason
    assert run.lateness is not None
    seen = setup.box.seen()
    assert seen.error == 0
    step_rad = 1.875 * np.abs(WAY).max() / DURATION_S / 250.0  # a swing's fastest
    steps = np.abs(np.diff(seen.set_points, axis=0)[:, MOVING])
    assert steps.max() < 1.01 * (1 + run.lateness.missed) * step_rad


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"error": 2}, "error C2"),
        ({"enabled": False}, "motors are not enabled"),
        ({"state": 4}, "stopped or paused"),
        ({"silent": True}, "no report comes on port 30000"),
        ({"answers": False}, "answers no command on port 502"),
    ],
)
def test_an_arm_that_is_not_ready_is_refused_and_nothing_is_sent(
    bench: Make, change: dict[str, object], words: str
) -> None:
    setup = bench()
    setup.box.change(**change)
    with pytest.raises(StrandcastError, match=words) as caught:
        setup.play()
    assert caught.value.exit_code in (REFUSED, ENVIRONMENT)
    assert setup.box.seen().set_points == []
    assert setup.box.seen().mode == 0
    assert not (setup.folder / "trial-01").exists()


def test_what_does_not_fit_the_arm_is_named(bench: Make) -> None:
    old = bench(firmware="1.12.10")
    with pytest.raises(StrandcastError, match=r"1\.12\.10 reports no time") as caught:
        old.play()
    assert caught.value.code == "SC-X061"


def test_a_wrong_address_is_named(bench: Make) -> None:
    setup = bench()
    setup.driver.address = "127.0.0.250"
    with pytest.raises(StrandcastError, match=r"127\.0\.0\.250") as caught:
        setup.play()
    assert caught.value.exit_code == ENVIRONMENT
