"""The streaming loop on the host's own clock: that it runs, not how well (that is the benchmark's)."""

import gc
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.executor.streaming.bounds import safety_bounds
from strandcast.executor.streaming.clock import HostClock
from strandcast.executor.streaming.jitter import measure_wakeups
from strandcast.executor.streaming.link import ControllerState
from strandcast.executor.streaming.loop import stream

from .test_play import make_motion

ROOT = Path(__file__).parents[2]


class Mirror:
    """A controller that follows its set points exactly, on the host's clock."""

    paces = False

    def __init__(self, q: np.ndarray) -> None:
        self.q, self.qd = q, np.zeros_like(q)
        self.writes = 0

    def start(self) -> None:
        pass

    def read(self) -> ControllerState:
        return ControllerState(time.monotonic_ns() * 1e-9, self.q, self.qd)

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        self.q, self.qd = q_rad.copy(), qd_rad_s.copy()
        self.writes += 1

    def finish(self) -> None:
        pass

    def signal(self, high: bool) -> None:
        pass


def test_a_motion_is_streamed_at_its_own_speed() -> None:
    arm = load_arm(ROOT / "config" / "arms" / "planar3.toml").planar()
    command = make_motion(arm, by=0.4).trajectory().resampled(0.002)
    bounds = safety_bounds(arm)
    bounds = type(bounds)(0.0 * bounds.lag_s, np.full(3, 0.3), *list(vars(bounds).values())[2:])
    link = Mirror(command.q_rad[0].copy())
    before = time.monotonic()
    done = stream(link, command, bounds, 500.0, list(arm.joints), hold_s=(0.1, 0.1))
    assert time.monotonic() - before >= 0.7
    if done.status != "ok":  # a shared machine may stall for more than five ticks: then it must have stopped
        assert "set points in a row were missed" in str(done.reason)
        pytest.skip(f"the machine was too busy to stream: {done.reason}")
    assert done.jitter is not None
    assert link.writes + done.jitter.missed == pytest.approx(350, abs=2)
    np.testing.assert_allclose(link.q, command.q_rad[-1], atol=1e-12)
    assert gc.isenabled()
    if hasattr(os, "sched_getscheduler"):
        assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_ticks_are_not_lost_or_counted_twice() -> None:
    late_ns, missed, scheduling = measure_wakeups(500.0, 0.2, HostClock(realtime=False))
    beyond = late_ns[-1] // 2_000_000  # where the host stalled at the very end
    assert 100 <= len(late_ns) + missed <= 100 + beyond
    assert (late_ns >= 0).all()
    assert scheduling == "normal"


def test_streaming_works_outside_the_main_thread() -> None:
    arm = load_arm(ROOT / "config" / "arms" / "planar3.toml").planar()
    command = make_motion(arm, by=0.0).trajectory().resampled(0.002)
    done = []

    def run() -> None:
        link = Mirror(command.q_rad[0].copy())
        done.append(stream(link, command, safety_bounds(arm), 500.0, list(arm.joints), hold_s=(0.0, 0.0)))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(20.0)
    assert len(done) == 1
