"""The safety monitor stops the arm: each bound alone, wrong once and wrong twice."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.executor.streaming.bounds import SafetyBounds, safety_bounds
from strandcast.executor.streaming.link import ControllerState
from strandcast.executor.streaming.log_buffer import LogBuffer
from strandcast.executor.streaming.safety_monitor import FROZEN_TICKS, SafetyMonitor

PERIOD_S = 0.002
LAG_S = 0.030
SPEED_RAD_S = 5.0
TRACKING_RAD = 0.02
NOW = 100  # buffer


@pytest.fixture
def bounds() -> SafetyBounds:
    two = np.ones(2)
    return SafetyBounds(
        LAG_S * two, TRACKING_RAD * two, 6.0 * two, 50.0 * two, 1000.0 * two, lambda q: bool(q[1] > 1.0)
    )


@pytest.fixture
def buffer() -> LogBuffer:
    """Both joints commanded at 5 rad/s, the second the other way."""
    buffer = LogBuffer(200, 2)
    buffer.count = NOW
    buffer.elapsed_s[:NOW] = np.arange(NOW) * PERIOD_S
    buffer.q_cmd[:NOW] = buffer.elapsed_s[:NOW, None] * [SPEED_RAD_S, -SPEED_RAD_S]
    return buffer


def state(**given: object) -> ControllerState:
    """Return joints that trail by exactly the lag."""
    q = SPEED_RAD_S * (NOW * PERIOD_S - LAG_S) * np.array([1.0, -1.0])
    return ControllerState(**{"time_s": 1.0, "q_rad": q, "qd_rad_s": np.zeros(2)} | given)


def twice(monitor: SafetyMonitor, buffer: LogBuffer, **given: object) -> tuple[str | None, str | None]:
    return tuple(monitor.problem(state(**given), NOW * PERIOD_S, buffer) for _ in range(2))


def test_a_joint_behind_by_its_lag_is_within_bounds(bounds: SafetyBounds, buffer: LogBuffer) -> None:
    assert twice(SafetyMonitor(bounds, ["a", "b"], PERIOD_S), buffer) == (None, None)
    # Without the lag it would be 0.15 rad off.
    ahead = SafetyBounds(np.zeros(2), *list(vars(bounds).values())[1:])
    assert twice(SafetyMonitor(ahead, ["a", "b"], PERIOD_S), buffer)[1] is not None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"q_rad": np.array([0.85, -0.85 - 0.025])}, "b is 0.025 rad from its command, allowed 0.020"),
        ({"q_rad": np.array([np.nan, -0.85])}, "a is nan rad from"),
        ({"qd_rad_s": np.array([-6.1, 0.0])}, "a moves at -6.10 rad/s"),
        ({"qd_rad_s": np.array([0.0, np.inf])}, "b moves at inf"),
    ],
)
def test_a_problem_in_two_consecutive_cycles_stops_the_arm(
    bounds: SafetyBounds, buffer: LogBuffer, given: dict[str, object], message: str
) -> None:
    first, second = twice(SafetyMonitor(bounds, ["a", "b"], PERIOD_S), buffer, **given)
    assert first is None
    assert message in str(second)


def test_a_tool_that_is_too_fast_stops_the_arm(project_root: Path) -> None:
    arm = load_arm(project_root / "config" / "arms" / "planar3.toml")
    limits = replace(arm.limits, whole_arm=np.array([np.inf, 1.0, *[np.inf] * 6]))
    bounds = safety_bounds(replace(arm, limits=limits, tracking_rad=np.full(3, 9.0)))
    assert safety_bounds(arm).too_fast is None
    q = np.array([0.5, 0.0, 0.0])
    for speed_rad_s, said in (
        (1.5, None),
        (1.7, "clamp speed 1.19 m/s, allowed 1.1 m/s"),
    ):  # 0.7 m from the joint
        monitor = SafetyMonitor(bounds, list(arm.joints), PERIOD_S)
        seen = state(q_rad=q, qd_rad_s=np.array([speed_rad_s, 0.0, 0.0]))
        assert [monitor.problem(seen, 0.0, LogBuffer(2, 3)) for _ in range(2)] == [None, said]


def test_leaving_the_workspace_stops_the_arm(bounds: SafetyBounds) -> None:
    first, second = twice(
        SafetyMonitor(bounds, ["a", "b"], PERIOD_S), LogBuffer(10, 2), q_rad=np.array([0.0, 1.1])
    )
    assert (first, second) == (None, "the hand is outside the workspace")


def test_a_problem_in_single_cycles_does_not_stop_the_arm(bounds: SafetyBounds, buffer: LogBuffer) -> None:
    monitor = SafetyMonitor(bounds, ["a", "b"], PERIOD_S)
    for fast in (7.0, 0.0, 7.0, 0.0):
        given = state(qd_rad_s=np.array([fast, 0.0]))
        assert monitor.problem(given, NOW * PERIOD_S, buffer) is None


def test_a_slower_speed_scaling_stops_at_once(bounds: SafetyBounds, buffer: LogBuffer) -> None:
    given = state(speed_scaling=0.99)
    assert "99 %" in str(SafetyMonitor(bounds, ["a", "b"], PERIOD_S).problem(given, NOW * PERIOD_S, buffer))


def test_a_clock_may_stop_for_a_few_cycles(bounds: SafetyBounds) -> None:
    monitor = SafetyMonitor(bounds, ["a", "b"], PERIOD_S)
    assert not any(monitor.frozen(state(time_s=1.0)) for _ in range(1 + FROZEN_TICKS))
    assert monitor.frozen(state(time_s=0.5))  # backwards counts as frozen
    assert not monitor.frozen(state(time_s=1.002))
