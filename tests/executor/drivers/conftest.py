"""A live test that fails on every try is skipped, with the reason, where the machine itself stood still."""

import ctypes
import itertools
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

import pytest

from .network import Network

# Well above the lateness of an idle machine (under 2 ms), and what a controller of 500 Hz or 1 kHz notices.
STALLED_S = 0.010
STEP_S = 0.001
DELAY_S = 0.020  # of the network, each way
NUMBERS = itertools.count(1)
sys.path.append(str(Path(__file__).parents[3]))  # processes that tests start find the tests


@pytest.fixture(scope="session")
def lateness() -> Iterator["Synchronized[float]"]:
    """Yield the greatest lateness of a process that only sleeps, in seconds; a test may set it to 0."""
    context = multiprocessing.get_context("spawn")
    greatest = context.Value(ctypes.c_double, 0.0)
    sleeper = context.Process(target=sleep_and_measure, args=(greatest,), daemon=True)
    sleeper.start()
    yield greatest
    sleeper.terminate()
    sleeper.join()


def sleep_and_measure(greatest: "Synchronized[float]") -> None:
    """Sleep a step at a time, and keep by how much the latest waking was too late."""
    before = time.monotonic()
    while True:
        time.sleep(STEP_S)
        now = time.monotonic()
        greatest.value = max(greatest.value, now - before - STEP_S)
        before = now


@pytest.fixture(autouse=True)
def watched(request: pytest.FixtureRequest) -> None:
    """Measure the machine's lateness during each live test."""
    if request.node.get_closest_marker("flaky"):
        request.node.lateness = request.getfixturevalue("lateness")
        request.node.lateness.value = 0.0


@pytest.fixture
def network() -> Iterator[Callable[..., Network]]:
    """Return a function that puts a slow network before a stand-in; see `Network`."""
    with ExitStack() as stack:

        def make(back: str, *ports: int) -> Network:
            host = f"127.{220 + os.getpid() % 30}.{os.getpid() // 30 % 250}.{next(NUMBERS)}"
            made = Network(host, back, ports, DELAY_S)
            stack.callback(made.end)
            return made

        yield make


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Report the last failed try of a live test as skipped where the machine stalled during it."""
    report = yield
    live: Any = item.get_closest_marker("flaky")
    if live is None or not report.failed or report.when != "call":
        return report
    stalled_s = getattr(item, "lateness").value  # noqa: B009
    last = getattr(item, "execution_count", 1) > live.kwargs["reruns"]
    if last and stalled_s > STALLED_S:
        report.outcome = "skipped"
        reason = f"Skipped: this machine stood still for {1000 * stalled_s:.0f} ms in the last try"
        report.longrepr = (str(item.path), 0, reason)
    return report
