"""Planning, and the loop closed on a string that the planner does not know."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.limits import violations
from strandcast.arm.load import load_arm
from strandcast.arm.servo import Servo, respond
from strandcast.errors import StrandcastError
from strandcast.motion.bars import start_blame
from strandcast.motion.bezier import sample
from strandcast.motion.earlier import Earlier, earlier_trial
from strandcast.motion.objective import closest_approach
from strandcast.motion.plan import Plan, plan_first, plan_next
from strandcast.motion.rank import likely_miss_m
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import World, commands, throw
from strandcast.motion.write import to_record
from strandcast.records.motion import Motion
from strandcast.string.masses import mass_layout, point_masses
from strandcast.string.model import StringModel
from strandcast.string.parameters import minima

LAYOUT = mass_layout(0.30, 10, [0.30])
TRUE_SERVO = Servo(np.full(3, 0.012), np.full(3, 30.0), np.array([0.7, 0.8, 0.9]), np.full(3, 0.97))


@pytest.fixture(scope="module")
def unknown(strings: Strings) -> Strings:
    """Return a string that no member of the ensemble is: stiffer, with more drag, curled, turned."""
    parameters = strings.parameters[:1].copy()
    parameters[0, 2:6] *= 2.5
    parameters[0, 7] *= 3.0
    return Strings(parameters, strings.masses[1:2] * [[0.8] * 9 + [0.5]], np.array([3.0]), np.array([0.1]))


def thrown_for_real(task: Task, unknown: Strings, plan: Plan, trial: int) -> Earlier:
    """Throw with the unknown string and another servo; see the tip through 0.7 mm of noise."""
    rng = np.random.default_rng(trial)
    record = to_record(plan, task, "test", trial, 0, {})
    time_s, command, last = commands([plan.motion], task.step_s)
    q = respond(TRUE_SERVO, time_s, command)
    points = throw(task, unknown, World(), q, last).points_m[0]
    seen = points + rng.normal(0.0, 0.0007, points.shape)
    miss, _ = closest_approach(np.ascontiguousarray(points[:, -1]), int(last[0]), *task.target_m)
    measured = q[0] + rng.normal(0.0, 0.0005, q[0].shape)
    return earlier_trial(record, time_s, measured, time_s, seen, miss, task.step_s)


@pytest.fixture(scope="module")
def first(task: Task, strings: Strings) -> Plan:
    return plan_first(
        task, strings, Options(screening=64, evaluations=160, members=3), np.random.default_rng(1)
    )


def test_a_first_motion_is_expected_to_hit_and_is_playable(task: Task, first: Plan) -> None:
    assert first.miss_m < 0.02
    assert first.hit_probability > 0.6
    motion = first.motion
    assert violations(task.arm, motion.time_s, motion.q, motion.qd, motion.qdd) == []
    assert np.all(motion.qd[[0, -1]] == 0.0)
    assert np.all(motion.qdd[[0, -1]] == 0.0)
    # The whole string stays in view.
    assert not any("workspace" in flag for flag in first.flags)


def test_the_second_throw_hits_a_string_that_was_unknown(
    task: Task, strings: Strings, unknown: Strings, first: Plan, options: Options
) -> None:
    # The first motion was for another target. The ensemble is left as it was: what is carried over, and the
    # servo that the log tells, must do the work.
    moved = replace(task, target_m=task.target_m + np.array([0.06, 0.05]))
    one = thrown_for_real(moved, unknown, first, 1)
    plan = plan_next(moved, strings, [one], replace(options, evaluations=480), np.random.default_rng(2))
    two = thrown_for_real(moved, unknown, plan, 2)
    assert plan.kind == "refined"
    assert plan.parent_trial == 1
    assert one.miss_m is not None
    assert two.miss_m is not None
    assert one.miss_m > 0.03
    assert two.miss_m < 0.015
    assert abs(two.miss_m - plan.miss_m) < 0.012


@pytest.mark.parametrize("seed", [2, 3])
def test_the_papers_rubber_string_is_thrown_from_where_a_real_one_hangs_freely(task: Task, seed: int) -> None:
    draw = minima(1)
    rubber = Strings(draw.parameters, point_masses(LAYOUT, draw.weight_masses))
    plan = plan_first(task, rubber, Options(screening=64, evaluations=160), np.random.default_rng(seed))
    q0 = plan.curve.q0_rad[None]
    assert start_blame(task.arm, 0.30, task.box(), Options().clearance_m, q0)[0] == 0.0
    # The model stretches to more than twice the string's length; what is thrown stays in the workspace.
    stretch = np.hypot(*(plan.tip_m - plan.hand_m).T) / task.model.length_m
    assert stretch.max() > 2.0
    assert not any("workspace" in flag for flag in plan.flags)


def test_a_hidden_closest_approach_does_not_hide_a_good_throw(
    task: Task, strings: Strings, unknown: Strings, first: Plan
) -> None:
    seen = thrown_for_real(task, unknown, first, 1)
    assert seen.miss_m is not None
    dark = seen.tip_m.copy()
    at = round(first.hit_time_s / task.step_s)
    dark[at - 20 : at + 20] = np.nan
    hidden = replace(seen, tip_m=dark, miss_m=None)
    assert likely_miss_m(task, strings, seen) == seen.miss_m
    assert abs(likely_miss_m(task, strings, hidden) - seen.miss_m) < 0.01
    blind = replace(seen, tip_m=np.full_like(dark, np.nan), miss_m=None)
    alone = throw(
        task, strings.take([0]), World(start_m=seen.start_m), seen.q[None], np.array([len(dark) - 1])
    )
    miss, _ = closest_approach(alone.points_m[0, :, -1], len(dark) - 1, *task.target_m)
    np.testing.assert_allclose(likely_miss_m(task, strings, blind), miss)


def test_planning_is_the_same_twice(task: Task, strings: Strings) -> None:
    small = Options(screening=32, evaluations=64, members=2)
    one, two = (plan_first(task, strings, small, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.motion.q, two.motion.q)
    assert one.miss_m == two.miss_m


def test_bad_fit_and_far_miss_plan_anew(
    task: Task, strings: Strings, unknown: Strings, first: Plan, options: Options
) -> None:
    trial = replace(thrown_for_real(task, unknown, first, 1), miss_m=0.05)
    small = replace(options, screening=32, evaluations=64)
    plan = plan_next(task, strings, [trial], small, np.random.default_rng(2), fit_E_m=0.009)
    assert plan.kind == "replanned"
    assert "planned anew" in plan.flags[0]
    assert not np.array_equal(plan.curve.q0_rad, first.curve.q0_rad)
    near = plan_next(task, strings, [trial], small, np.random.default_rng(2), fit_E_m=0.007)
    np.testing.assert_array_equal(near.curve.q0_rad, first.curve.q0_rad)


def test_a_target_beyond_what_is_near_is_planned_anew(
    task: Task, strings: Strings, unknown: Strings, first: Plan, options: Options
) -> None:
    away = replace(task, target_m=np.array([0.75, -0.10]))
    trial = thrown_for_real(away, unknown, first, 1)
    small = replace(options, screening=96, evaluations=96)
    plan = plan_next(away, strings, [trial], small, np.random.default_rng(2), fit_E_m=0.002)
    assert plan.kind == "replanned"
    assert "planned anew: near trial 1's motion the best is" in plan.flags[0]
    assert plan.miss_m < 0.05


def test_the_papers_planner(task: Task, strings: Strings, unknown: Strings) -> None:
    options = Options(planner="paper", duration_s=(0.2, 1.2), screening=256, use_servo=False)
    plan = plan_first(task, strings, options, np.random.default_rng(4))
    assert plan.miss_m <= 0.02
    assert plan.simulations < 256
    assert plan.curve.ramp_s > 0.0
    motion = sample(plan.curve, task.step_s)
    assert violations(task.arm, motion.time_s, motion.q, motion.qd, motion.qdd) == []
    trial = thrown_for_real(task, unknown, plan, 1)
    later = plan_next(task, strings, [trial], options, np.random.default_rng(5))
    change = later.curve.heights_rad_s - plan.curve.heights_rad_s
    assert 0.0 < np.abs(change).max() <= 0.5
    np.testing.assert_array_equal(later.curve.q0_rad, plan.curve.q0_rad)
    none = plan_first(
        replace(task, hit_radius_m=1e-9), strings, replace(options, screening=32), np.random.default_rng(4)
    )
    assert "no simulated hit within the budget: the best so far is thrown" in none.flags


def test_an_unreachable_target_says_how_near_a_throw_gets(
    task: Task, strings: Strings, options: Options
) -> None:
    far = replace(task, target_m=np.array([1.2, 0.5]))
    with pytest.raises(StrandcastError, match=r"no throw comes nearer than 0\.300 m"):
        plan_first(far, strings, options, np.random.default_rng(0))
    hidden = replace(task, target_m=np.array([0.3, 0.9]))
    with pytest.raises(StrandcastError, match=r"0\.100 m outside the workspace"):
        plan_first(hidden, strings, options, np.random.default_rng(0))


def test_the_record_holds_the_motion_and_comes_back(task: Task, first: Plan, tmp_path: Path) -> None:
    record = to_record(first, task, "demo", 1, 99, {"estimate.json": "ab"}, None, "ensemble")
    record.write(tmp_path / "motion.json")
    back = Motion.read(tmp_path / "motion.json")
    q, qd, qdd = back.joints()
    np.testing.assert_array_equal(q, first.motion.q)
    np.testing.assert_array_equal(qd[-1], 0.0)
    np.testing.assert_array_equal(qdd[-1], 0.0)
    assert back.points[1].time_from_start.nanosec == 2_000_000
    assert back.bezier is not None
    assert back.bezier.duration_s == first.curve.duration_s
    assert back.predicted is not None
    assert len(back.predicted.time_s) == len(back.predicted.tip_m)
    assert back.robot.file_sha256 == task.arm.sha256


def test_three_parallel_joints_of_six_throw(project_root: Path, strings: Strings) -> None:
    arm = load_arm(project_root / "config/arms/ur5e-example.toml")
    task = Task(arm, StringModel(0.30, 10), np.array([0.95, 0.45]), 0.02, arm.workspace)
    options = Options(screening=96, evaluations=192, duration_s=(0.6, 1.2))
    plan = plan_first(task, strings, options, np.random.default_rng(0))
    motion = plan.motion
    assert violations(arm, motion.time_s, motion.q, motion.qd, motion.qdd) == []
    assert plan.miss_m < 0.03
    assert np.abs(motion.qd).max() < np.pi
