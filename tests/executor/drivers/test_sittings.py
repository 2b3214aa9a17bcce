"""Sittings with the drivers' stand-ins as arms; the lab films the string on the joints as they moved."""

import csv
import itertools
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from tests.faults.small import NAME
from tests.workflow.rig.driver import ask_arm
from tests.workflow.rig.sitting import Rig

from strandcast.arm.load import load_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.records.joint_log import read_run
from strandcast.workflow.verify import verify

from .franka_sim import served
from .rtde_standin import Setting, StandIn
from .xarm_standin import Handle

ARMS = Path(__file__).parents[3] / "config" / "arms"
SETTINGS = """\
title: A small throw
string: {{length_m: 0.30, weights: [{{place_m: 0.30}}]}}
arm: {arm}
target_m: [0.85, 0.40]
hit_radius_m: 0.02
max_trials: 3
seed: 3
workspace_m: {{x_m: [-0.2, 1.4], y_m: [-0.4, 1.2]}}
camera:
  plane:
    markers:
      - {{id: 0, x_m: 0.00, y_m: 1.10}}
      - {{id: 2, x_m: 1.30, y_m: 1.10}}
      - {{id: 3, x_m: 0.00, y_m: -0.30}}
      - {{id: 5, x_m: 1.30, y_m: -0.30}}
estimate: {{evaluations: 100, profiles: false}}
plan: {{evaluations: 16}}
"""
LAB = """\
lab:
  noise: 0.5
  servo: stiff
  camera: {size_px: [720, 720], frame_rate_hz: 100}
"""
FAST_RAD_S = 0.6  # faster than any move to the start, slower than any throw
STILL_RAD_S, AROUND_S = 0.02, 0.3  # what is filmed before and after the arm moves
TRIES = 6  # of a throw, on a machine that stands still
NUMBERS = itertools.count(1)


@dataclass
class Stand:
    """An arm to hold a sitting with: its file, and what happens at its controller.

    Attributes
    ----------
    path
        Returns times and angles (T, 1 + N) of the last throw; only the joints `moving` move.
    stop
        Has the next throw stopped, for `reason`; it is called before the throw.
    stop_now
        The same in the throw.
    clear
        What a person does after it.
    """

    arm: str
    text: str
    moving: list[int]
    path: Callable[[Rig], np.ndarray]
    reason: str
    stop: Callable[[], object] = lambda: None
    stop_now: Callable[[Rig], object] = lambda rig: None
    clear: Callable[[], object] = lambda: None


def address() -> str:
    """Return an address of its own on the loopback."""
    return f"127.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.{200 + next(NUMBERS)}"


@contextmanager
def ur(folder: Path) -> Iterator[Stand]:
    """A UR at the rate of a CB3; its speed slider is moved."""
    pytest.importorskip("rtde_control", reason="vendor package ur_rtde; make test-drivers")
    arm, host = load_arm(ARMS / "ur5e-example.toml"), address()
    moving = [1, 2, 3]
    q_rad = [arm.held.get(name, -1.0) for name in arm.all_joints]
    standin = StandIn(Setting(host=host, q_rad=q_rad, version=(3, 15, 0)))
    text = arm.path.read_text()
    for old, new in (
        ('host = ""', f'host = "{host}"'),
        ("_hz = 500     ", "_hz = 125"),
        ("_hz = 10 ", "_hz = 5 "),
    ):
        assert old in text
        text = text.replace(old, new)
    yield Stand(
        "ur5e-example",
        text,
        moving,
        lambda rig: np.array(standin.path()),
        "speed scaling fell to 50 %",
        stop=lambda: standin.report(slow_above_rad_s=FAST_RAD_S),
        clear=lambda: standin.report(slow_above_rad_s=None, speed_fraction=1.0),
    )
    standin.end()


@contextmanager
def xarm(folder: Path) -> Iterator[Stand]:
    """An xArm that meets an obstacle."""
    pytest.importorskip("xarm", reason="vendor package xarm-python-sdk; make test-drivers")
    arm, host = load_arm(ARMS / "xarm6-example.toml"), address()
    moving = [1, 2, 4]
    box = Handle(arm.path, moving, [0.0, -0.6, -0.6, 0.0, 0.6, 0.0], "2.5.0", host)
    yield Stand(
        "xarm6-example",
        arm.path.read_text().replace('host = "" ', f'host = "{host}"#'),
        moving,
        lambda rig: np.array(box.seen().path),
        "error C31",
        stop=lambda: box.change(hit_above_rad_s=FAST_RAD_S),
        clear=lambda: box.change(hit_above_rad_s=np.inf, error=0, state=2),
    )
    box.end()


@contextmanager
def franka(folder: Path) -> Iterator[Stand]:
    """A Franka of franka-sim; Ctrl-C is pressed in a throw."""
    pytest.importorskip("pylibfranka", reason="vendor package; make test-drivers")

    def path(rig: Rig) -> np.ndarray:
        table = max((rig.root / "data" / NAME).glob("trial-*/franka.csv"))
        with table.open() as file:
            rows = list(csv.DictReader(file))
        names = ["controller_time_s", *(f"q{j}_rad" for j in range(1, 8))]
        found = np.array([[float(row[name]) for name in names] for row in rows])
        return found[np.unique(found[:, 0], return_index=True)[1]]

    def interrupt(rig: Rig) -> None:
        rig.until("is thrown")
        for _ in range(3000):  # the folder is made when the arm stands at the start; or it does not get there
            if (rig.root / "data" / NAME / "trial-01").exists():
                time.sleep(0.7)  # the arm is held for 0.5 s first
                return rig.interrupt(signal.SIGINT)
            time.sleep(0.02)

    with served(folder, 3600.0) as server:
        text = (ARMS / "fr3-example.toml").read_text()
        text = text.replace('host = ""', f'host = "{server.host}"').replace('"enforce"', '"ignore"')
        yield Stand("fr3-example", text, [1, 3, 5], path, "interrupted by SIGINT", stop_now=interrupt)


@pytest.mark.thorough
@pytest.mark.flaky(reruns=0)
@pytest.mark.parametrize("make", [ur, xarm, franka])
def test_a_throw_is_stopped_and_the_next_one_counts(
    tmp_path: Path, make: Callable[[Path], AbstractContextManager[Stand]]
) -> None:
    with make(tmp_path) as stand:
        rig = Rig(tmp_path, SETTINGS.format(arm=stand.arm), LAB, f"{stand.arm}.toml", stand.text)
        try:
            hold(rig, stand)
        finally:
            rig.end()


def hold(rig: Rig, stand: Stand) -> None:
    """Hold the sitting, and check what it leaves."""
    rig.start("--accept-soft-realtime")
    throw_until_it_is_stopped(rig, stand)
    stand.clear()
    throw_until_it_counts(rig, stand, 1)
    assert rig.quit() == 0
    (miss_m,) = rig.misses().values()
    assert miss_m is not None
    assert read_run(rig.root / "data" / NAME / "trial-01")[0].complete
    assert verify(rig.root, NAME) == []


# How a throw may end, the first one well.
ENDS = "waiting for the film", "was put aside", "nothing was thrown"


def throw_until_it_counts(rig: Rig, stand: Stand, trial: int) -> None:
    """Throw; where the machine stood still, and the arm was stopped, throw again."""
    for _ in range(TRIES):
        rig.throw()
        if rig.until(*ENDS)[0] != ENDS[0]:
            continue
        film(rig, stand)
        rig.until(rf"score: trial {trial}")
        return
    raise AssertionError(f"no throw counts: {rig.aside()}")


def throw_until_it_is_stopped(rig: Rig, stand: Stand) -> None:
    """Throw until the arm is stopped for the reason; on a late machine, it may be on the way to the start."""
    for _ in range(TRIES):
        stand.clear()
        stand.stop()
        rig.throw()
        stand.stop_now(rig)
        if rig.until(*ENDS)[0] == ENDS[0]:
            rig.type("none")
            rig.until("was put aside")
        if any(stand.reason in why for why in rig.aside().values()):
            return
    raise AssertionError(f"no throw was stopped: {rig.aside()}")


def film(rig: Rig, stand: Stand) -> None:
    """Have the lab film the string on the joints as the controller moved them."""
    path = stand.path(rig)
    moved = np.abs(np.gradient(path[:, 1:], path[:, 0], axis=0)).max(axis=1) > STILL_RAD_S
    begin_s, end_s = path[np.flatnonzero(moved)[[0, -1]], 0]
    path = path[(path[:, 0] > begin_s - AROUND_S) & (path[:, 0] < end_s + AROUND_S)]
    time_s, q_rad = path[:, 0] - path[0, 0], path[:, 1:][:, stand.moving]
    qd_rad_s = np.gradient(q_rad, time_s, axis=0)
    command = JointTrajectory(time_s, q_rad, qd_rad_s, np.gradient(qd_rad_s, time_s, axis=0))
    with suppress(ConnectionError):
        ask_arm(command, rig.port.read_text())
