"""The paper's own planner: section V as printed, and its readings by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.limits import violations
from strandcast.errors import StrandcastError
from strandcast.motion.bezier import Curve, sample
from strandcast.motion.draw import draw_first
from strandcast.motion.paper import first_by_paper, later_by_paper
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, PaperReading, Task
from strandcast.motion.throws import World, assessed, throw_curves

OPTIONS = Options(planner="paper", duration_s=(0.2, 1.2), screening=256, use_servo=False)
WORLD = World()


def misses(task: Task, strings: Strings, curves: list[Curve]) -> np.ndarray:
    return assessed(task, throw_curves(task, strings.take([0]), WORLD, curves)).miss_m


@pytest.fixture(scope="module")
def first(task: Task, strings: Strings) -> Curve:
    return first_by_paper(task, strings, WORLD, OPTIONS, np.random.default_rng(4)).curve


def test_it_stops_at_the_first_simulated_hit(task: Task, strings: Strings) -> None:
    wide = replace(task, hit_radius_m=0.08)
    found = first_by_paper(wide, strings, WORLD, OPTIONS, np.random.default_rng(7))
    assert found.hit
    assert found.simulations < OPTIONS.screening
    # All that was drawn before it missed. The draws come in batches, of which the rest is left.
    draws = draw_first(
        32, "paper", task.arm.limits, (0.2, 1.2), 6, 60.0, task.step_s, np.random.default_rng(7),
        dynamics=task.dynamics,
    )  # fmt: skip
    before = misses(task, strings, draws)
    number = int(np.argmax(before <= 0.08))
    assert before[number] <= 0.08
    assert found.simulations == number + 1
    np.testing.assert_array_equal(found.curve.heights_rad_s, draws[number].heights_rad_s)
    # The nearest of the batch is not it: that is the other reading.
    best = replace(OPTIONS, screening=32, paper=PaperReading(accept="best"))
    nearest = first_by_paper(wide, strings, WORLD, best, np.random.default_rng(7))
    assert nearest.simulations == 32
    np.testing.assert_array_equal(nearest.curve.heights_rad_s, draws[int(np.argmin(before))].heights_rad_s)


def test_at_the_budgets_end_the_nearest_is_thrown(task: Task, strings: Strings) -> None:
    small = replace(OPTIONS, screening=40)
    found = first_by_paper(replace(task, hit_radius_m=1e-9), strings, WORLD, small, np.random.default_rng(4))
    assert (found.hit, found.simulations) == (False, 40)


def test_first_motions_are_by_eq_1_from_anywhere_and_last_as_long_as_the_papers(task: Task) -> None:
    draws = draw_first(
        40, "paper", task.arm.limits, (0.2, 1.2), 6, 60.0, task.step_s, np.random.default_rng(0),
        dynamics=task.dynamics,
    )  # fmt: skip
    times = np.array([curve.duration_s for curve in draws])
    assert 0.2 <= times.min() < 0.35
    assert 0.6 < times.max() <= 1.2
    for curve in draws[:10]:
        slopes = np.diff(curve.heights_rad_s, axis=1) / (curve.duration_s / 6)
        assert (curve.heights_rad_s[:, 0] == 0.0).all()
        assert np.abs(slopes).max() <= 60.0 + 1e-9
        motion = sample(curve, task.step_s)
        assert violations(task.arm, motion.time_s, motion.q, motion.qd, motion.qdd) == []
    postures = np.array([curve.q0_rad for curve in draws])
    assert (np.ptp(postures, axis=0) > 1.5).all()


def test_later_motions_keep_posture_and_time_and_alter_by_half_a_radian(
    task: Task, strings: Strings, first: Curve
) -> None:
    found = later_by_paper(
        replace(task, hit_radius_m=1e-9), strings, WORLD, replace(OPTIONS, screening=64), first,
        np.random.default_rng(5),
    )  # fmt: skip
    change = found.curve.heights_rad_s - first.heights_rad_s
    np.testing.assert_array_equal(found.curve.q0_rad, first.q0_rad)
    assert found.curve.duration_s == first.duration_s
    np.testing.assert_array_equal(change[:, 0], 0.0)
    assert 0.2 < np.abs(change).max() <= 0.5
    motion = sample(found.curve, task.step_s)
    assert violations(task.arm, motion.time_s, motion.q, motion.qd, motion.qdd) == []


def test_walking_goes_further_than_half_a_radian_and_nearer(
    task: Task, strings: Strings, first: Curve
) -> None:
    away = replace(task, target_m=task.target_m + np.array([0.15, -0.2]), hit_radius_m=1e-9)
    small = replace(OPTIONS, screening=320)
    literal = later_by_paper(away, strings, WORLD, small, first, np.random.default_rng(5))
    walks = replace(small, paper=PaperReading(altered_from="walking"))
    walked = later_by_paper(away, strings, WORLD, walks, first, np.random.default_rng(5))
    assert np.abs(literal.curve.heights_rad_s - first.heights_rad_s).max() <= 0.5
    assert np.abs(walked.curve.heights_rad_s - first.heights_rad_s).max() > 0.6
    np.testing.assert_array_equal(walked.curve.q0_rad, first.q0_rad)
    near = misses(away, strings, [literal.curve, walked.curve])
    assert near[1] < near[0]


def test_the_reading_at_rest_needs_no_ramp(task: Task, strings: Strings) -> None:
    rest = replace(OPTIONS, screening=16, paper=PaperReading(ends="rest"))
    found = first_by_paper(replace(task, hit_radius_m=1e-9), strings, WORLD, rest, np.random.default_rng(1))
    assert found.curve.ramp_s == 0.0
    later = later_by_paper(
        replace(task, hit_radius_m=1e-9), strings, WORLD, rest, found.curve, np.random.default_rng(2)
    )
    np.testing.assert_array_equal(later.curve.heights_rad_s[:, [0, 1, -2, -1]], 0.0)


def test_where_no_alteration_keeps_the_limits_it_says_so(task: Task, strings: Strings, first: Curve) -> None:
    tight = replace(task.arm.limits, velocity_rad_s=np.full(3, 0.01))
    slow = replace(task, arm=replace(task.arm, limits=tight))
    with pytest.raises(StrandcastError, match="SC-P007"):
        later_by_paper(slow, strings, WORLD, replace(OPTIONS, screening=2), first, np.random.default_rng(5))
