"""The paper's own planner: section V as printed, and its readings by name."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.limits import violations
from strandcast.config.plan import PlanSettings
from strandcast.core.strings import StringBatch
from strandcast.errors import StrandcastError
from strandcast.planning.assessment import assess_rollouts
from strandcast.planning.bezier import Curve, sample
from strandcast.planning.draw import CurvePrior, JointBounds, draw_first
from strandcast.planning.paper import first_by_paper, later_by_paper
from strandcast.planning.rollouts import RolloutConditions, rollouts_of_curves
from strandcast.planning.search import SearchInputs
from strandcast.planning.task import PlanningTask

SETTINGS = PlanSettings(duration_s=(0.2, 1.2), evaluations=256)
PRIOR = CurvePrior("paper", (0.2, 1.2), 60.0)


def bounds(task: PlanningTask) -> JointBounds:
    return JointBounds(task.arm, task.step_s, task.dynamics)


def given(task: PlanningTask, strings: StringBatch, seed: int, **changes: object) -> SearchInputs:
    settings = SETTINGS.model_copy(update=changes)
    return SearchInputs(task, strings, RolloutConditions(), settings, np.random.default_rng(seed))


def misses(task: PlanningTask, strings: StringBatch, curves: list[Curve]) -> np.ndarray:
    return assess_rollouts(
        task, rollouts_of_curves(task, strings.take([0]), RolloutConditions(), curves)
    ).miss_m


@pytest.fixture(scope="module")
def first(task: PlanningTask, strings: StringBatch) -> Curve:
    return first_by_paper(given(task, strings, 4)).curve


def test_it_stops_at_the_first_simulated_hit(task: PlanningTask, strings: StringBatch) -> None:
    wide = replace(task, hit_radius_m=0.08)
    found = first_by_paper(given(wide, strings, 7))
    assert not found.flags
    assert found.simulations < SETTINGS.evaluations
    # Everything drawn before it missed. The draws come in batches; the rest of the batch is not used.
    draws = draw_first(32, PRIOR, bounds(task), np.random.default_rng(7))
    before = misses(task, strings, draws)
    number = int(np.argmax(before <= 0.08))
    assert before[number] <= 0.08
    assert found.simulations == number + 1
    np.testing.assert_array_equal(found.curve.heights_rad_s, draws[number].heights_rad_s)


def test_the_nearest_is_thrown_at_the_end_of_the_budget(task: PlanningTask, strings: StringBatch) -> None:
    found = first_by_paper(given(replace(task, hit_radius_m=1e-9), strings, 4, evaluations=40))
    assert found.flags == ["no simulated hit within the budget: the best so far is thrown"]
    assert found.simulations == 40


def test_first_motions_follow_eq_1_from_any_posture_for_as_long_as_the_papers(task: PlanningTask) -> None:
    draws = draw_first(40, PRIOR, bounds(task), np.random.default_rng(0))
    times = np.array([curve.duration_s for curve in draws])
    assert 0.2 <= times.min() < 0.35
    assert 0.6 < times.max() <= 1.2
    for curve in draws[:10]:
        slopes = np.diff(curve.heights_rad_s, axis=1) / (curve.duration_s / 6)
        assert (curve.heights_rad_s[:, 0] == 0.0).all()
        assert np.abs(slopes).max() <= 60.0 + 1e-9
        motion = sample(curve, task.step_s)
        assert violations(task.arm, motion) == []
    postures = np.array([curve.q0_rad for curve in draws])
    assert (np.ptp(postures, axis=0) > 1.5).all()


def test_later_motions_keep_posture_and_time_and_change_by_at_most_half_a_radian(
    task: PlanningTask, strings: StringBatch, first: Curve
) -> None:
    never = replace(task, hit_radius_m=1e-9)
    found = later_by_paper(given(never, strings, 5, evaluations=64), first)
    change = found.curve.heights_rad_s - first.heights_rad_s
    np.testing.assert_array_equal(found.curve.q0_rad, first.q0_rad)
    assert found.curve.duration_s == first.duration_s
    np.testing.assert_array_equal(change[:, 0], 0.0)
    assert 0.2 < np.abs(change).max() <= 0.5
    motion = sample(found.curve, task.step_s)
    assert violations(task.arm, motion) == []


def test_an_arm_with_a_limited_jerk_needs_no_ramp(task: PlanningTask, strings: StringBatch) -> None:
    smooth = replace(task.arm.limits, jerk_rad_s3=np.full(3, 5e3))
    never = replace(task, hit_radius_m=1e-9, arm=replace(task.arm, limits=smooth))
    found = first_by_paper(given(never, strings, 1, evaluations=16))
    assert found.curve.ramp_s == 0.0
    later = later_by_paper(given(never, strings, 2, evaluations=16), found.curve)
    np.testing.assert_array_equal(later.curve.heights_rad_s[:, [0, 1, -2, -1]], 0.0)


def test_an_arm_that_cannot_follow_the_papers_slopes_gets_smaller_ones(
    task: PlanningTask, strings: StringBatch
) -> None:
    weak = replace(task.arm.limits, acceleration_rad_s2=np.full(3, 12.0))
    never = replace(task, hit_radius_m=1e-9, arm=replace(task.arm, limits=weak))
    found = first_by_paper(given(never, strings, 1, evaluations=4))
    assert violations(never.arm, sample(found.curve, task.step_s)) == []


def test_an_error_where_no_alteration_keeps_the_limits(
    task: PlanningTask, strings: StringBatch, first: Curve
) -> None:
    tight = replace(task.arm.limits, velocity_rad_s=np.full(3, 0.01))
    slow = replace(task, arm=replace(task.arm, limits=tight))
    with pytest.raises(StrandcastError, match="SC-P004"):
        later_by_paper(given(slow, strings, 5, evaluations=2), first)
