"""Planning, and the loop closed on a string that the planner does not know."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from strandcast.arm.limits import violations
from strandcast.arm.load import load_arm
from strandcast.arm.reach import reach_of
from strandcast.arm.servo import Servo, respond
from strandcast.arm.yielding_joints import JointResponse
from strandcast.config.plan import PlanSettings
from strandcast.core.strings import StringBatch
from strandcast.dynamics.masses import mass_layout, point_masses
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import minima
from strandcast.errors import StrandcastError
from strandcast.executor.checks import check_motion
from strandcast.planning import local_search, motion_descent
from strandcast.planning import plan as plan_module
from strandcast.planning.approach import closest_approaches
from strandcast.planning.assessment import Assessment, assess_rollouts
from strandcast.planning.bezier import Curve, rest_heights
from strandcast.planning.bias_correction import likely_miss_m
from strandcast.planning.cost import OUTSIDE_COST, rollout_cost, start_violation_m
from strandcast.planning.describe import prediction_flags, stopped_outside_m, touch_of_links_m
from strandcast.planning.global_search import Encoding
from strandcast.planning.miss_calibration import LEVELS, MissDistribution
from strandcast.planning.motion_descent import MotionResiduals, descend_motion, motion_residuals
from strandcast.planning.past_trials import PastTrial, past_trial
from strandcast.planning.plan import PlannedMotion, likeliest, plan_first, plan_next, predicted
from strandcast.planning.rollouts import (
    RolloutConditions,
    Rollouts,
    commands,
    rollouts_of_paths,
    simulate_rollouts,
)
from strandcast.planning.search import SearchInputs, SearchResult
from strandcast.planning.task import PlanningTask
from strandcast.planning.write import to_record
from strandcast.records.files import content_sha256
from strandcast.records.motion import Motion
from strandcast.records.record import HEAD
from strandcast.stages.plan_inputs import past_trial_of
from strandcast.threads import threads

LAYOUT = mass_layout(0.30, 10, [0.30])
FIRST = Curve(
    np.array([0.05, 0.28, 0.07]),
    0.63,
    rest_heights(
        np.array(
            [
                [2.93, 4.27, 0.12, 0.70, 0.79, -5.10],
                [5.45, 6.85, 4.40, 6.79, 3.67, -1.77],
                [1.22, 5.87, 8.25, 4.73, -1.37, -0.01],
            ]
        )
    ),
)
SMALL = PlanSettings(evaluations=480)
TRUE_SERVO = Servo(np.full(3, 0.012), np.full(3, 30.0), np.array([0.7, 0.8, 0.9]), np.full(3, 0.97))


@pytest.fixture(scope="module")
def unknown(strings: StringBatch) -> StringBatch:
    """Return a string that no member of the ensemble is: stiffer, with more drag, curled, turned."""
    parameters = strings.parameters[:1].copy()
    parameters[0, 2:6] *= 2.5
    parameters[0, 7] *= 3.0
    unlike = {"rest_curl_rad_m": np.array([3.0]), "clamp_offset_rad": np.array([0.1])}
    return StringBatch(parameters, strings.masses[1:2] * [[0.8] * 9 + [0.5]], unlike)


def nearest_m(tip_m: np.ndarray, target_m: np.ndarray) -> float:
    (away_m,), _ = closest_approaches(tip_m[None], np.array([len(tip_m) - 1]), target_m)
    return float(away_m)


def thrown_for_real(task: PlanningTask, unknown: StringBatch, plan: PlannedMotion, trial: int) -> PastTrial:
    """Throw with the unknown string and another servo; track the tip with 0.7 mm of noise."""
    rng = np.random.default_rng(trial)
    record = to_record(plan, task, "test", trial, 0, {})
    time_s, command, last = commands([plan.motion], task.step_s)
    q = respond(TRUE_SERVO, time_s, command)
    points = simulate_rollouts(task, unknown, RolloutConditions(), q, last).points_m[0]
    seen = points + rng.normal(0.0, 0.0007, points.shape)
    miss = nearest_m(points[:, -1], task.target_m)
    measured = q[0] + rng.normal(0.0, 0.0005, q[0].shape)
    return past_trial(record, task.step_s, (time_s, measured), (time_s, seen), miss)


def planned(task: PlanningTask, strings: StringBatch, seed: int = 1, **changes: object) -> PlannedMotion:
    return plan_first(task, strings, SMALL.model_copy(update=changes), np.random.default_rng(seed))


def planned_next(
    task: PlanningTask,
    strings: StringBatch,
    trial: PastTrial,
    fit_E_m: float | None = None,
    seed: int = 2,
    **changes: object,
) -> PlannedMotion:
    settings, rng = SMALL.model_copy(update=changes), np.random.default_rng(seed)
    return plan_next(task, strings, [trial], settings, rng, fit_E_m=fit_E_m)


@pytest.fixture(scope="module")
def searched(task: PlanningTask, strings: StringBatch) -> PlannedMotion:
    return planned(task, strings)


@pytest.fixture(scope="module")
def first(task: PlanningTask, strings: StringBatch) -> PlannedMotion:
    """Return a motion that a search found once, rounded: elsewhere a search ends elsewhere."""
    conditions = RolloutConditions(task.arm.servo)
    given = SearchInputs(task, strings, conditions, SMALL, np.random.default_rng(1))
    return predicted(given, SearchResult("first", FIRST, 1307, []))


@pytest.fixture(scope="module")
def trial(task: PlanningTask, unknown: StringBatch, first: PlannedMotion) -> PastTrial:
    return thrown_for_real(task, unknown, first, 1)


@pytest.fixture(scope="module")
def joints(task: PlanningTask, trial: PastTrial) -> JointResponse:
    return plan_module.fitted_servo(task, [trial])


@pytest.fixture
def fitted_joints(joints: JointResponse, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plan with the joints' response that was fitted once: each fit takes as long as a search."""
    monkeypatch.setattr(
        plan_module, "fitted_servo", lambda task, trials: joints if trials else task.arm.servo
    )


def test_a_first_motion_is_expected_to_hit_and_is_playable(
    task: PlanningTask, searched: PlannedMotion
) -> None:
    assert searched.miss_m < 0.02
    assert searched.simulated_hit_probability(task.hit_radius_m) > 0.6
    motion = searched.motion
    assert violations(task.arm, motion) == []
    assert np.all(motion.qd_rad_s[[0, -1]] == 0.0)
    assert np.all(motion.qdd_rad_s2[[0, -1]] == 0.0)
    # The whole string stays in view.
    assert not any("workspace" in flag for flag in searched.flags)


def test_a_descent_keeps_in_the_workspace_what_a_stop_could_carry_out(
    task: PlanningTask, strings: StringBatch, first: PlannedMotion
) -> None:
    (left, right), (low, high) = reach_of(task.arm, first.motion, task.hanging_m).swept_m
    arm = replace(task.arm, box_m=np.array([[left, right - 0.04], [low, high]]))
    tight = replace(task, arm=arm)
    assert stopped_outside_m(tight, first.curve) == pytest.approx(0.04)
    encoding = Encoding(3, (0.35, 0.9), task.step_s)
    start, conditions = encoding.point(first.curve), RolloutConditions(task.arm.servo)

    def residuals(points: np.ndarray) -> MotionResiduals:
        curves = encoding.curves(points)
        return motion_residuals(tight.rough(), strings, conditions, curves, stops=True)

    point, cost_m, _ = descend_motion(residuals, start, len(start) - 1, 200)
    out_m = stopped_outside_m(tight, encoding.curves(point[None])[0])
    assert out_m < 0.03  # 22 mm are left
    assert cost_m < residuals(start[None]).cost_m[0] - OUTSIDE_COST * 0.01


@pytest.mark.thorough
def test_a_rehearsal_shows_joints_that_are_not_as_the_arms_file_says(
    task: PlanningTask, strings: StringBatch, first: PlannedMotion
) -> None:
    """No second-order response describes joints that ring."""

    def joints(plan: PlannedMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        time_s, command, last = commands([plan.motion], task.step_s)
        q = respond(TRUE_SERVO, time_s, command)
        ringing = 0.15 * np.sin(12.0 * time_s)[:, None] * [1.0, -1.0, 1.0]
        return time_s, q + ringing, last

    def missed_m(plan: PlannedMotion) -> float:
        _, q, last = joints(plan)
        tips = simulate_rollouts(task, strings.first(1), RolloutConditions(), q, last).points_m[0, :, -1]
        return nearest_m(tips, task.target_m)

    time_s, q, _ = joints(first)
    nothing_seen = np.zeros(0), np.zeros((0, 2, 2))
    played = past_trial(to_record(first, task, "test", 1, 0, {}), task.step_s, (time_s, q[0]), nothing_seen)
    rng = np.random.default_rng(3)
    plan = plan_first(task, strings, SMALL, rng, rehearsal=played)
    assert plan.kind == "rehearsed"
    assert missed_m(first) > 0.03
    assert missed_m(plan) < 0.5 * missed_m(first)  # of 49 mm, 10 to 13 are left
    # Without control heights there is no motion to stay near, but its log still gives the servo's lag.
    unrelated = plan_first(task, strings, SMALL, rng, rehearsal=replace(played, curve=None))
    assert unrelated.simulations > plan.simulations


@pytest.mark.thorough
def test_the_second_throw_hits_a_string_that_was_unknown(
    task: PlanningTask, strings: StringBatch, unknown: StringBatch, trial: PastTrial
) -> None:
    # The ensemble is not fitted: bias correction, and the servo from the log, must do the work.
    tip = trial.tip_m
    speed = np.linalg.norm(np.gradient(tip, axis=0), axis=1)
    k = int(np.argmax(speed))
    across = np.array([[0.0, -1.0], [1.0, 0.0]]) @ (tip[k + 3] - tip[k - 3])
    beside = [tip[k] + aside_m * across / np.hypot(*across) for aside_m in (-0.05, 0.05)]
    away = [nearest_m(tip, place) for place in beside]
    # So wide a hit keeps the search near the trial.
    moved = replace(task, target_m=beside[int(np.argmax(away))], hit_radius_m=0.5)
    plan = planned_next(moved, strings, replace(trial, miss_m=max(away)), evaluations=1920)
    two = thrown_for_real(moved, unknown, plan, 2)
    assert plan.kind == "refined"
    assert plan.parent_trial == 1
    assert max(away) > 0.03
    assert two.miss_m is not None
    assert two.miss_m < 0.015
    assert abs(two.miss_m - plan.miss_m) < 0.012


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.thorough)])
def test_the_papers_rubber_string_is_thrown_from_where_a_real_one_hangs_freely(
    task: PlanningTask, seed: int
) -> None:
    draw = minima(1)
    rubber = StringBatch(draw.parameters, point_masses(replace(LAYOUT, tip=1.0), draw.weight_masses))
    plan = planned(task, rubber, seed)
    q0 = plan.curve.q0_rad[None]
    assert start_violation_m(task.arm, 0.30, task.box(), q0)[0] == 0.0
    # The model stretches to more than twice the string's length; what is thrown stays in the workspace, but
    # for the millimetres after which a small search ends.
    stretch = np.hypot(*(plan.tip_m - plan.hand_m).T) / task.model.length_m
    assert stretch.max() > 2.0
    out_mm = [int(mm) for mm in re.findall(r"leave the workspace, by (\d+) mm", " ".join(plan.flags))]
    assert max(out_mm, default=0) <= 10


def test_a_hidden_closest_approach_does_not_hide_a_good_throw(
    task: PlanningTask, strings: StringBatch, first: PlannedMotion, trial: PastTrial
) -> None:
    assert trial.miss_m is not None
    dark = trial.tip_m.copy()
    at = round(first.hit_time_s / task.step_s)
    dark[at - 20 : at + 20] = np.nan
    hidden = replace(trial, tip_m=dark, miss_m=None)
    assert likely_miss_m(task, strings, trial) == trial.miss_m
    assert abs(likely_miss_m(task, strings, hidden) - trial.miss_m) < 0.01
    blind = replace(trial, tip_m=np.full_like(dark, np.nan), miss_m=None)
    start, last = RolloutConditions(start_m=trial.start_m), np.array([len(dark) - 1])
    alone = simulate_rollouts(task, strings.take([0]), start, trial.q_rad[None], last)
    miss_m = nearest_m(alone.points_m[0, :, -1], task.target_m)
    np.testing.assert_allclose(likely_miss_m(task, strings, blind), miss_m)
    # The bias beside the gap is that in it.
    low = trial.tip_m - np.array([0.0, 0.03])
    passed = nearest_m(low, task.target_m)
    assert passed > 0.015
    lower = replace(hidden, tip_m=dark - np.array([0.0, 0.03]))
    np.testing.assert_allclose(likely_miss_m(task, strings, lower), passed, atol=0.004)


def test_planning_gives_the_same_bytes_on_one_core_or_two(
    task: PlanningTask, strings: StringBatch, trial: PastTrial, tmp_path: Path
) -> None:
    small = {"evaluations": 160}
    written = []
    for cores in (2, 1):
        with threads(cores):
            plans = planned(task, strings, 3, **small), planned_next(task, strings, trial, 0.001, 3, **small)
        for plan in plans:
            to_record(plan, task, "demo", 1, 3, {}).write(tmp_path / "motion.json")
            written.append((tmp_path / "motion.json").read_bytes())
    assert written[:2] == written[2:]
    assert written[0] != written[1]


@pytest.mark.thorough
@pytest.mark.usefixtures("fitted_joints")
def test_after_a_motion_without_control_heights_the_plan_is_from_scratch(
    task: PlanningTask, strings: StringBatch, trial: PastTrial
) -> None:
    bare = replace(trial, curve=None)
    plan = planned_next(task, strings, bare, evaluations=200)
    assert plan.kind == "replanned"
    assert plan.parent_trial is None
    with pytest.raises(StrandcastError, match="SC-P005"):
        plan_next(task, strings, [bare], SMALL, np.random.default_rng(0), method="paper")


@pytest.mark.parametrize(
    ("stated", "tried"), [([0.95, 0.99], 1), ([0.5, 0.7, 0.6], 3), ([0.5, 0.92, 0.97], 2)]
)
def test_candidates_are_tried_until_one_is_likely_to_hit_and_the_likeliest_is_taken(
    task: PlanningTask, first: PlannedMotion, stated: list[float], tried: int
) -> None:
    def found(probability: float) -> PlannedMotion:
        at_radius = task.hit_radius_m * np.array(LEVELS) / probability
        return replace(first, miss=MissDistribution(at_radius), simulations=100)

    plan = likeliest(task, [lambda one=one: found(one) for one in stated])
    assert plan.simulations == 100 * tried
    np.testing.assert_allclose(plan.hit_probability(task.hit_radius_m), max(stated[:tried]))


def test_a_motion_beyond_a_limit_that_was_lowered_is_left_out(
    task: PlanningTask, first: PlannedMotion, capsys: pytest.CaptureFixture[str]
) -> None:
    def beyond() -> PlannedMotion:
        raise StrandcastError("SC-P004", "velocity 6.3 rad/s, limit 5.7")

    assert likeliest(task, [beyond, lambda: first, beyond]).curve is first.curve
    assert "motion 1 is left out: velocity 6.3 rad/s, limit 5.7" in capsys.readouterr().err
    with pytest.raises(StrandcastError, match="SC-P004"):
        likeliest(task, [beyond, beyond])


def test_a_trial_of_other_joints_is_refused(task: PlanningTask, first: PlannedMotion) -> None:
    record = to_record(first, task, "test", 1, 0, {})
    played = SimpleNamespace(number=1, motion=record.model_copy(update={"joint_names": ["a", "b", "c"]}))
    with pytest.raises(StrandcastError, match="trial 1 moved a, b, c, and the arm's are joint_1"):
        past_trial_of(cast(Any, played), task)


def test_a_prediction_that_failed_widens_the_next_one(
    task: PlanningTask,
    strings: StringBatch,
    unknown: StringBatch,
    first: PlannedMotion,
    trial: PastTrial,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(plan_module, "search_near", lambda *_: (first.curve, 10))
    monkeypatch.setattr(plan_module, "WORTH_A_SEARCH", 1.0)
    close = replace(task, target_m=trial.tip_m[np.nanargmax(trial.tip_m[:, 1])])
    known = replace(trial, miss_m=0.0)

    monkeypatch.setattr(plan_module, "fitted_servo", lambda *_: None)  # nothing has to be identified

    def plan(*trials: PastTrial) -> PlannedMotion:
        return plan_next(close, strings, list(trials), SMALL, np.random.default_rng(2))

    alone = plan(known)
    held, failed = (replace(known, trial=2, miss_m=0.004, stated_m=stated_m) for stated_m in (0.004, 0.0004))
    likely = plan(known, held).hit_probability(0.005)
    assert likely == pytest.approx(alone.hit_probability(0.005), abs=0.1)
    assert plan(known, failed).hit_probability(0.005) < likely - 0.2
    # So does a motion that is to change much of what was thrown.
    far = plan(replace(known, miss_m=0.15))
    assert far.hit_probability(0.005) < alone.hit_probability(0.005) - 0.1

    # Only what was stated with a string fitted to throws speaks of such statements.
    assert trial.stated_m is None
    assert thrown_for_real(task, unknown, alone, 2).stated_m == alone.miss_quantile_m(0.5)


@pytest.mark.usefixtures("fitted_joints")
def test_a_motion_unlikely_to_hit_gives_way_to_one_that_has_hit(
    task: PlanningTask,
    strings: StringBatch,
    trial: PastTrial,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The searches find motions that miss: the trial's own is thrown again."""
    worse = replace(trial.curve, heights_rad_s=0.9 * trial.curve.heights_rad_s)
    monkeypatch.setattr(plan_module, "search_near", lambda *_: (worse, 10))
    monkeypatch.setattr(plan_module, "search_globally", lambda *_: (worse, 30))
    monkeypatch.setattr(plan_module, "WORTH_A_SEARCH", -1.0)
    at_tip = replace(task, target_m=trial.tip_m[np.nanargmax(trial.tip_m[:, 1])])
    plan = planned_next(at_tip, strings, replace(trial, miss_m=0.0), 0.001)
    assert plan.simulations == 50
    np.testing.assert_array_equal(plan.curve.heights_rad_s, trial.curve.heights_rad_s)
    said = capsys.readouterr().err
    assert said.count("likely to hit\n") == 4  # of each motion, before the next one's search
    assert "repeats trial 1's motion: no change was found likelier to hit" in said


def test_a_motion_that_the_player_refuses_is_a_last_resort(
    task: PlanningTask, first: PlannedMotion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stop on the way would take it out of the workspace."""
    other = replace(first, curve=replace(first.curve, heights_rad_s=0.9 * first.curve.heights_rad_s))
    refused = {id(first.curve)}
    monkeypatch.setattr(plan_module, "stopped_outside_m", lambda _, curve: float(id(curve) in refused))
    assert plan_module.likeliest(task, [lambda: first, lambda: other]).curve is other.curve
    refused.add(id(other.curve))
    monkeypatch.setattr(plan_module, "most_likely", lambda *_: 2.0)
    assert plan_module.likeliest(task, [lambda: first, lambda: other]).curve is first.curve


@pytest.mark.usefixtures("fitted_joints")
def test_a_motion_from_nothing_is_taken_where_those_near_the_trial_miss(
    task: PlanningTask,
    strings: StringBatch,
    first: PlannedMotion,
    trial: PastTrial,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(plan_module, "search_near", lambda *_: (trial.curve, 10))
    monkeypatch.setattr(plan_module, "search_globally", lambda *_: (first.curve, 30))
    at_tip = replace(task, target_m=trial.tip_m[np.nanargmax(trial.tip_m[:, 1])])
    hits = planned_next(at_tip, strings, replace(trial, miss_m=0.0), 0.05)
    assert (hits.kind, hits.parent_trial, hits.simulations) == ("refined", 1, 10)
    high = replace(
        trial, tip_m=trial.tip_m + np.array([0.0, 0.2]), miss_m=0.2
    )  # far from all that is simulated
    again = planned_next(task, strings, high, 0.001)
    assert (again.kind, again.parent_trial, again.simulations) == ("replanned", None, 50)
    sure, unsure = (planned_next(task, strings, high, E_m).hit_probability(0.02) for E_m in (0.001, 0.02))
    assert sure > unsure + 0.1  # of a model that leaves so much of the tracks


def test_the_papers_planner_by_name(task: PlanningTask, strings: StringBatch, unknown: StringBatch) -> None:
    settings = PlanSettings(duration_s=(0.2, 1.2), evaluations=256)
    plan = plan_first(task, strings, settings, np.random.default_rng(4), method="paper")
    assert plan.miss_m <= 0.02
    assert plan.planner == "paper"
    assert plan.simulations < 256
    assert plan.curve.ramp_s > 0.0
    trial = thrown_for_real(task, unknown, plan, 1)
    later = plan_next(task, strings, [trial], settings, np.random.default_rng(5), method="paper")
    assert (later.kind, later.parent_trial) == ("refined", 1)
    change = later.curve.heights_rad_s - plan.curve.heights_rad_s
    assert 0.0 < np.abs(change).max() <= 0.5
    np.testing.assert_array_equal(later.curve.q0_rad, plan.curve.q0_rad)
    never, few = replace(task, hit_radius_m=1e-9), settings.model_copy(update={"evaluations": 32})
    none = plan_first(never, strings, few, np.random.default_rng(4), method="paper")
    assert "no simulated hit within the budget: the best so far is thrown" in none.flags
    assert none.simulations == 32


def test_an_unreachable_target_says_how_near_a_throw_gets(task: PlanningTask, strings: StringBatch) -> None:
    far = replace(task, target_m=np.array([1.2, 0.5]))
    with pytest.raises(StrandcastError, match=r"no throw comes nearer than 0\.300 m"):
        planned(far, strings)
    hidden = replace(task, target_m=np.array([0.3, 0.9]))
    with pytest.raises(StrandcastError, match=r"0\.100 m outside the workspace"):
        planned(hidden, strings)


def test_a_target_in_reach_that_nothing_found_comes_near_is_flagged_with_the_distance(
    task: PlanningTask, strings: StringBatch
) -> None:
    calm = replace(task.arm.limits, velocity_rad_s=np.full(3, 0.5))
    slow = replace(task, arm=replace(task.arm, limits=calm), target_m=np.array([0.30, 0.75]))
    plan = plan_first(slow, strings, PlanSettings(evaluations=100), np.random.default_rng(0))
    assert plan.miss_m > 0.05
    (flag,) = plan.flags
    by_mm = 1e3 * plan.miss_quantile_m(0.5)
    assert flag.startswith(f"not expected to hit: half the throws miss by more than {by_mm:.0f} mm")
    assert plan.simulated_hit_probability(slow.hit_radius_m) == 0.0


@pytest.mark.thorough
@pytest.mark.usefixtures("fitted_joints")
def test_the_prediction_is_over_strings_and_disturbances(
    task: PlanningTask,
    strings: StringBatch,
    searched: PlannedMotion,
    trial: PastTrial,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    later = planned_next(task, strings, trial, 0.001)
    for plan in (searched, later):
        assert plan.throws.miss_m.shape == (16 * len(strings),)
        simulated = plan.simulated_hit_probability(task.hit_radius_m)
        assert simulated == np.mean(plan.throws.miss_m <= task.hit_radius_m)
        # Undisturbed is not among them, but the spread is around it.
        one = plan.throws.miss_m[:16]
        assert one.max() > plan.miss_m
        assert np.sqrt(np.mean(one**2)) < plan.miss_m + 0.03
    # A search does not ask how wide a hit is; with a narrow one some of the throws hit.
    monkeypatch.setattr(plan_module, "SEARCHES", 1)
    alone = planned(task, strings)
    narrow = replace(task, hit_radius_m=float(np.quantile(alone.throws.miss_m, 0.6)))
    again = planned(narrow, strings)
    np.testing.assert_array_equal(again.throws.miss_m, alone.throws.miss_m)
    assert 0.55 < again.simulated_hit_probability(narrow.hit_radius_m) < 0.65
    predicted = to_record(later, task, "demo", 2, 3, {}).predicted
    assert predicted is not None
    assert list(predicted.miss_quantiles_m) == [f"p{level}" for level in range(5, 100, 5)]
    np.testing.assert_allclose(predicted.miss_rms_m, np.sqrt(np.mean(later.throws.miss_m**2)))
    np.testing.assert_allclose(predicted.miss_quantiles_m["p50"], later.miss_quantile_m(0.5))
    assert predicted.hit_probability == later.hit_probability(task.hit_radius_m)
    still = planned(task, strings, disturbances=0.0)
    np.testing.assert_allclose(still.throws.miss_m, np.repeat(still.ensemble_miss_m, 16), atol=1e-4)


@pytest.mark.parametrize("budget", [{"evaluations": 8}, {"evaluations": 200}])
def test_the_reported_number_of_rollouts_is_that_simulated(
    task: PlanningTask, strings: StringBatch, budget: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated: list[int] = []

    def counted(*given: Any) -> Rollouts:
        simulated.append(len(given[3].q) * len(given[1]))
        return rollouts_of_paths(*given)

    monkeypatch.setattr(motion_descent, "rollouts_of_paths", counted)
    # No motion is good enough, so the search is repeated.
    narrow = replace(task, hit_radius_m=1e-6)
    plan = planned(narrow, strings, **budget)
    assert plan.simulations == sum(simulated)


@pytest.mark.parametrize(
    ("kind", "limit"),
    [
        ("torque_n_m", [8.0, 2.8, 0.7]),
        # `test_an_arm_with_limited_jerk_throws` finds most of it.
        pytest.param("jerk_rad_s3", [600.0, 600.0, 600.0], marks=pytest.mark.thorough),
    ],
)
def test_torque_and_jerk_are_kept_by_the_search(
    task: PlanningTask, strings: StringBatch, kind: str, limit: list[float], tmp_path: Path
) -> None:
    weak = replace(task.arm, limits=replace(task.arm.limits, **{kind: np.array(limit)}))
    plan = planned(replace(task, arm=weak), strings)
    assert plan.miss_m < 0.03
    assert (plan.peaks[kind] <= limit).all()
    # It is the limit that keeps them.
    assert (plan.peaks[kind] / limit).max() > 0.6
    # The player derives them again, on a grid of its own.
    check_motion(tmp_path, to_record(plan, task, "test", 1, 0, {}), weak)


def test_an_old_motion_without_the_newer_predictions_is_still_read(
    task: PlanningTask, first: PlannedMotion, tmp_path: Path
) -> None:
    to_record(first, task, "demo", 1, 99, {}).write(tmp_path / "motion.json")
    data = json.loads((tmp_path / "motion.json").read_text(encoding="utf-8"))
    for name in ("miss_quantiles_m", "limits", "peak_jerk_rad_s3", "workspace_room_m"):
        del data["predicted"][name]
    del data["provenance"]["objective"]
    sha256 = content_sha256({key: value for key, value in data.items() if key not in HEAD})
    (tmp_path / "motion.json").write_text(json.dumps(data | {"content_sha256": sha256}), encoding="utf-8")
    old = Motion.read(tmp_path / "motion.json")
    assert old.predicted is not None
    # A throw that was played keeps the hash of its motion.
    assert old.content_sha256() == sha256


def test_an_arm_with_limited_jerk_throws(project_root: Path, strings: StringBatch, tmp_path: Path) -> None:
    arm = load_arm(project_root / "config/arms/fr3-example.toml").planar()
    assert np.isfinite(arm.limits.jerk_rad_s3).all()
    task = PlanningTask(arm, StringModel(0.30, 10), np.array([0.75, 0.30]), 0.02)
    settings = PlanSettings(evaluations=320, duration_s=(0.6, 1.2))
    plan = plan_first(task, strings, settings, np.random.default_rng(0))
    check_motion(tmp_path, to_record(plan, task, "test", 1, 0, {}), arm)
    assert plan.miss_m < 0.03


def test_the_record_holds_the_motion_and_comes_back(
    task: PlanningTask, first: PlannedMotion, tmp_path: Path
) -> None:
    record = to_record(first, task, "demo", 1, 99, {"estimate.json": "ab"}, None, "ensemble")
    record.write(tmp_path / "motion.json")
    back = Motion.read(tmp_path / "motion.json")
    trajectory = back.trajectory()
    np.testing.assert_array_equal(trajectory.q_rad, first.motion.q_rad)
    np.testing.assert_array_equal(trajectory.qd_rad_s[-1], 0.0)
    np.testing.assert_array_equal(trajectory.qdd_rad_s2[-1], 0.0)
    assert back.points[1].time_from_start.nanosec == 2_000_000
    assert back.bezier is not None
    assert back.bezier.duration_s == first.curve.duration_s
    assert back.predicted is not None
    assert len(back.predicted.time_s) == len(back.predicted.tip_m)
    assert back.robot.file_sha256 == task.arm.sha256
    predicted = back.predicted
    np.testing.assert_allclose(predicted.limits["torque_n_m"], task.arm.limits.torque_n_m)
    assert predicted.limits["jerk_rad_s3"] == [None] * 3
    assert all(peak <= most for peak, most in zip(predicted.peak_torque_n_m, [48.0, 20.0, 6.4], strict=True))
    assert predicted.workspace_room_m is not None
    assert predicted.workspace_room_m > 0.0
    assert back.provenance is not None
    assert back.provenance.objective == "point"


@pytest.mark.thorough
def test_three_parallel_joints_of_six_throw(project_root: Path, strings: StringBatch) -> None:
    arm = load_arm(project_root / "config/arms/ur5e-example.toml").planar()
    task = PlanningTask(arm, StringModel(0.30, 10), np.array([0.95, 0.45]), 0.02)
    settings = PlanSettings(evaluations=480, duration_s=(0.6, 1.2))
    plan = plan_first(task, strings, settings, np.random.default_rng(0))
    motion = plan.motion
    assert violations(arm, motion) == []
    assert plan.miss_m < 0.03
    assert np.abs(motion.qd_rad_s).max() < np.pi


def assessment(outside_m: list[float], touch_m: list[float], hidden_m: list[float]) -> Assessment:
    nothing, depths = np.zeros(3), map(np.array, (outside_m, touch_m, hidden_m))
    return Assessment(nothing, nothing.astype(int), nothing, *depths, nothing)


def test_a_fault_is_flagged_if_it_is_likelier_than_not(task: PlanningTask, first: PlannedMotion) -> None:
    """One wild string of the ensemble says nothing of the throw, be it the first."""

    def flags(
        *depths_m: list[float], miss_m: float = 0.0, likely: MissDistribution | None = None
    ) -> list[str]:
        throws = assessment(*depths_m)
        throws.miss_m[:] = [0.3, miss_m, miss_m]
        return prediction_flags(task, first.curve, throws, likely)

    assert flags([0.0] * 3, [0.0] * 3, [0.0] * 3) == []
    assert flags([0.0, 0.0, 0.05], [0.0, 0.0, 0.04], [0.03, 0.0, 0.0]) == []
    assert flags([0.0, 0.0104, 0.02], [0.001, 0.002, 0.003], [0.0] * 3, miss_m=0.033) == [
        "not expected to hit: half the throws miss by more than 33 mm, and nothing better was found within "
        "the arm's limits",
        "will probably leave the workspace, by 11 mm (in 67 % of the simulated throws)",
        "the string will probably come too near to a link, by 2 mm (in 100 % of the simulated throws)",
    ]
    worse = MissDistribution(np.linspace(0.05, 0.2, len(LEVELS)))  # than is simulated
    assert len(flags([0.0] * 3, [0.0] * 3, [0.0] * 3, likely=worse)) == 1


@pytest.mark.parametrize(("capsule", "touched"), [(-1, False), (0, True)])
def test_only_links_are_touched_and_not_the_plate_behind_the_string(
    task: PlanningTask, strings: StringBatch, first: PlannedMotion, capsule: int, touched: bool
) -> None:
    _, q, last = commands([first.motion], task.step_s)
    rollouts = simulate_rollouts(task, strings.first(1), RolloutConditions(), q, last)
    assert rollouts.capsules_m.shape[2] == len(task.arm.joints) + 1
    rollouts.capsules_m[:] = 50.0
    rollouts.capsules_m[:, :, capsule] = rollouts.points_m[:, :, -1, None]
    assert assess_rollouts(task, rollouts).touch_m[0] > 0.0
    assert (touch_of_links_m(task, rollouts)[0] > 0.0) == touched


@pytest.mark.parametrize("name", ["fold", "outside_m", "touch_m", "hidden_m"])
def test_every_fault_of_a_throw_costs(name: str) -> None:
    good = assessment([0.0] * 3, [0.0] * 3, [0.0] * 3)
    bad = good._replace(**{name: np.array([0.0, 0.0, 0.6])})
    assert rollout_cost(good, 3, 0.002)[0] == 0.0
    assert rollout_cost(bad, 3, 0.002)[0] > 0.002


@pytest.mark.usefixtures("fitted_joints")
def test_a_later_motion_stays_near_the_one_that_it_changes(
    task: PlanningTask,
    strings: StringBatch,
    first: PlannedMotion,
    trial: PastTrial,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plans = []
    for price in (1.0, 0.0):
        monkeypatch.setattr(local_search, "CHANGE_COST_M_S_RAD", price)
        plans.append(planned_next(task, strings, trial, seed=3))
    moved = [np.abs(plan.curve.heights_rad_s - first.curve.heights_rad_s).max() for plan in plans]
    assert [plan.kind for plan in plans] == ["refined", "refined"]
    assert moved[0] < 0.5 * moved[1]


def test_a_later_motion_starts_where_the_joints_were_not_where_they_were_commanded(
    task: PlanningTask, strings: StringBatch, trial: PastTrial
) -> None:
    """A soft servo sags. The string hung at rest as the model's does: its own shape is as good."""
    sagged = trial.q_rad + np.array([0.02, -0.15, 0.05])
    resting, last = np.tile(sagged[0], (1, 2, 1)), np.array([1])
    at_rest = simulate_rollouts(task, strings.first(1), RolloutConditions(), resting, last).points_m[0, 0]
    hung = replace(trial, q_rad=sagged, start_m=at_rest[1:])
    assert local_search.settled(task, strings, hung) is None
    bent_m = at_rest[1:] + np.linspace(0.0, 1.0, 10)[:, None] ** 2 * [0.02, 0.0]
    start_m = local_search.settled(task, strings, replace(hung, start_m=bent_m))
    assert start_m is not None
    assert np.linalg.norm(start_m[0] - at_rest[0]) == pytest.approx(task.model.spacing_m, rel=0.02)


@pytest.mark.usefixtures("fitted_joints")
def test_fitted_strings_that_diverge_on_a_past_trial_are_left_out(
    task: PlanningTask,
    strings: StringBatch,
    first: PlannedMotion,
    trial: PastTrial,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Negative damping makes a string diverge; where all strings do, all are kept."""
    used: list[StringBatch] = []

    def spy(given: SearchInputs, *_: object) -> list[Any]:
        used.append(given.strings)
        return [lambda: first]

    monkeypatch.setattr(plan_module, "_near_trials", spy)
    monkeypatch.setattr(plan_module, "WORTH_A_SEARCH", 1.0)
    fed = strings.parameters.copy()
    fed[:, [3, 5]] *= -30.0
    one = strings.parameters.copy()
    one[0] = fed[0]
    flags = [
        set(planned_next(task, replace(strings, parameters=parameters), trial).flags) - set(first.flags)
        for parameters in (strings.parameters, one, fed)
    ]
    assert [len(each) for each in used] == [3, 2, 3]
    np.testing.assert_array_equal(used[1].parameters, strings.parameters[1:])
    left_out = "1 of 3 fitted strings left out: they diverge on the joints of a past trial"
    assert flags == [set(), {left_out}, set()]
