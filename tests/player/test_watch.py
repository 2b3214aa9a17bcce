"""What stops an arm that is being streamed to: each bound alone, wrong once and wrong twice."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.player.bounds import Bounds
from strandcast.player.rows import Rows
from strandcast.player.watch import FROZEN_TICKS, Reading, Watch

PERIOD_S = 0.002
LAG_S = 0.030
SPEED_RAD_S = 5.0
TRACKING_RAD = 0.02
NOW = 100  # rows


@pytest.fixture
def bounds() -> Bounds:
    two = np.ones(2)
    return Bounds(
        LAG_S * two, TRACKING_RAD * two, 6.0 * two, 50.0 * two, 1000.0 * two, lambda q: bool(q[1] > 1.0)
    )


@pytest.fixture
def rows() -> Rows:
    """Both joints told to turn at 5 rad/s, the second the other way."""
    rows = Rows(200, 2)
    rows.count = NOW
    rows.elapsed_s[:NOW] = np.arange(NOW) * PERIOD_S
    rows.q_cmd[:NOW] = rows.elapsed_s[:NOW, None] * [SPEED_RAD_S, -SPEED_RAD_S]
    return rows


def reading(**told: object) -> Reading:
    """Return joints that trail by exactly the lag."""
    q = SPEED_RAD_S * (NOW * PERIOD_S - LAG_S) * np.array([1.0, -1.0])
    return Reading(**{"time_s": 1.0, "q_rad": q, "qd_rad_s": np.zeros(2)} | told)


def twice(watch: Watch, rows: Rows, **told: object) -> tuple[str | None, str | None]:
    return tuple(watch.problem(reading(**told), NOW * PERIOD_S, rows) for _ in range(2))


def test_a_joint_that_trails_by_its_lag_is_where_it_should_be(bounds: Bounds, rows: Rows) -> None:
    assert twice(Watch(bounds, ["a", "b"], PERIOD_S), rows) == (None, None)
    # Without the lag it would be 0.15 rad off.
    ahead = Bounds(np.zeros(2), *list(vars(bounds).values())[1:])
    assert twice(Watch(ahead, ["a", "b"], PERIOD_S), rows)[1] is not None


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"q_rad": np.array([0.85, -0.85 - 0.025])}, "b is 0.025 rad off its command, allowed 0.020"),
        ({"q_rad": np.array([np.nan, -0.85])}, "a is nan rad off"),
        ({"qd_rad_s": np.array([-6.1, 0.0])}, "a moves at -6.10 rad/s"),
        ({"qd_rad_s": np.array([0.0, np.inf])}, "b moves at inf"),
    ],
)
def test_what_is_wrong_twice_running_stops_the_arm(
    bounds: Bounds, rows: Rows, told: dict[str, object], words: str
) -> None:
    first, second = twice(Watch(bounds, ["a", "b"], PERIOD_S), rows, **told)
    assert first is None
    assert words in str(second)


def test_out_of_the_workspace_stops_the_arm(bounds: Bounds) -> None:
    first, second = twice(Watch(bounds, ["a", "b"], PERIOD_S), Rows(10, 2), q_rad=np.array([0.0, 1.1]))
    assert (first, second) == (None, "the hand is out of the workspace")


def test_what_is_wrong_now_and_then_does_not(bounds: Bounds, rows: Rows) -> None:
    watch = Watch(bounds, ["a", "b"], PERIOD_S)
    for fast in (7.0, 0.0, 7.0, 0.0):
        told = reading(qd_rad_s=np.array([fast, 0.0]))
        assert watch.problem(told, NOW * PERIOD_S, rows) is None


def test_a_slower_speed_scaling_stops_at_once(bounds: Bounds, rows: Rows) -> None:
    told = reading(speed_scaling=0.99)
    assert "99 %" in str(Watch(bounds, ["a", "b"], PERIOD_S).problem(told, NOW * PERIOD_S, rows))


def test_a_clock_may_stand_for_a_few_cycles(bounds: Bounds) -> None:
    watch = Watch(bounds, ["a", "b"], PERIOD_S)
    assert not any(watch.frozen(reading(time_s=1.0)) for _ in range(1 + FROZEN_TICKS))
    assert watch.frozen(reading(time_s=0.5))  # backwards is no better
    assert not watch.frozen(reading(time_s=1.002))
