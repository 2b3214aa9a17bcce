"""Each kind of objective: its miss on simple paths, and a plan that reaches it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from strandcast.arm.servo import respond
from strandcast.config.plan import PlanSettings
from strandcast.core.objectives import (
    AimedPoint,
    Objective,
    SegmentObjective,
    ShapeObjective,
    ShapePlace,
    SwingObjective,
)
from strandcast.core.strings import StringBatch
from strandcast.errors import StrandcastError
from strandcast.planning.bezier import Curve, sample
from strandcast.planning.bias_correction import likely_miss_m
from strandcast.planning.past_trials import PastTrial
from strandcast.planning.plan import PlannedMotion, plan_first, plan_next
from strandcast.planning.reachability import refuse_unreachable
from strandcast.planning.rollouts import (
    RolloutConditions,
    Rollouts,
    commands,
    rollouts_of_curves,
    simulate_rollouts,
)
from strandcast.planning.simulated_misses import simulated_miss, velocities
from strandcast.planning.task import PlanningTask

STEP_S = 0.002


def segment(ends_m: tuple) -> SegmentObjective:
    return SegmentObjective(kind="segment", ends_m=ends_m)


def shape(*places: tuple[float, tuple[float, float]]) -> ShapeObjective:
    return ShapeObjective(kind="shape", places=[ShapePlace(along_m=along, at_m=at) for along, at in places])


def swing(**wanted: float) -> SwingObjective:
    return SwingObjective(kind="swing", **wanted)


def aimed(target_m: tuple[float, float], direction_rad: Any = None, **wanted: float) -> AimedPoint:
    return AimedPoint(target_m=target_m, direction_rad=direction_rad, **wanted)


def one(tip: np.ndarray, last: int | None = None, bias: np.ndarray | None = None) -> Rollouts:
    """One rollout of a string of four points 0.1 m apart, straight down from the hand but for the tip."""
    points = np.zeros((1, len(tip), 5, 2))
    points[0, :, :, 1] = -0.1 * np.arange(5)
    points[0, :, -1] = tip
    bias = np.zeros_like(tip) if bias is None else bias
    window = np.array([len(tip) - 1 if last is None else last])
    return Rollouts(points, bias[None], window, STEP_S, 0.1, np.zeros((1, len(tip), 0, 2, 2)))


def missed(objective: Objective, rollouts: Rollouts) -> tuple[float, int]:
    miss, index = simulated_miss(objective, rollouts)
    return float(miss[0]), int(index[0])


ACROSS = np.stack([np.linspace(-0.5, 0.5, 51), np.full(51, 0.1)], axis=1)  # to the right, 10 m/s


def test_a_point_is_missed_by_the_path_between_samples_with_its_bias_correction() -> None:
    np.testing.assert_allclose(missed(aimed((0.01, 0.0)), one(ACROSS)), (0.1, 26))
    up = np.tile([0.0, -0.1], (51, 1))
    np.testing.assert_allclose(missed(aimed((0.01, 0.0)), one(ACROSS, bias=up)), (0.0, 26), atol=1e-12)
    np.testing.assert_allclose(missed(aimed((0.5, 0.1)), one(ACROSS, last=25)), (0.5, 25))


def test_a_direction_that_is_off_counts_beyond_its_tolerance() -> None:
    for direction, off in ((0.0, 0.0), (0.3, 0.0), (0.5, 0.15), (-0.5, 0.15), (np.pi, np.pi - 0.35)):
        found = missed(aimed((0.01, 0.1), direction), one(ACROSS))[0]
        np.testing.assert_allclose(found, off, atol=1e-9)
    # Where the path turns back, it passes the place in the right direction later.
    back = np.concatenate([ACROSS, ACROSS[::-1] + np.array([0.0, 0.02])])
    np.testing.assert_allclose(missed(aimed((0.01, 0.1), np.pi), one(back)), (0.02, 76), atol=1e-9)


def test_a_tip_that_is_too_slow_misses() -> None:
    assert missed(aimed((0.01, 0.1), least_speed_m_s=9.9), one(ACROSS))[0] < 1e-9
    np.testing.assert_allclose(missed(aimed((0.01, 0.1), least_speed_m_s=12.0), one(ACROSS))[0], 0.2)


@pytest.mark.parametrize(
    ("ends", "miss"),
    [
        (((0.03, -1.0), (0.03, 1.0)), 0.0),  # crossed between samples
        (((0.03, 0.15), (0.03, 1.0)), 0.05),  # its lower end is above the path
        (((0.6, 0.1), (0.9, 0.1)), 0.1),  # the path ends before it
        (((-0.2, 0.07), (0.2, 0.07)), 0.03),  # alongside
    ],
)
def test_a_bar_is_missed_by_the_distance_of_two_segments(ends: tuple, miss: float) -> None:
    np.testing.assert_allclose(missed(segment(ends), one(ACROSS))[0], miss, atol=1e-12)


def test_a_shape_is_missed_by_the_rms_of_its_places_at_one_instant() -> None:
    still = shape((0.05, (0.0, -0.05)), (0.4, (0.1, 0.1)))
    np.testing.assert_allclose(missed(still, one(ACROSS)), (0.0, 30), atol=1e-12)
    both = shape((0.15, (0.03, -0.15)), (0.4, (0.1, 0.14)))
    np.testing.assert_allclose(missed(both, one(ACROSS))[0], np.sqrt((0.03**2 + 0.04**2) / 2))
    # Only the tip has a bias correction.
    moved = one(ACROSS, bias=np.tile([0.0, 0.04], (51, 1)))
    np.testing.assert_allclose(missed(both, moved)[0], np.sqrt(0.03**2 / 2))


def test_a_swing_is_missed_by_its_shortfall() -> None:
    arc = np.stack([np.linspace(-0.5, 0.5, 51), 0.4 - np.linspace(-0.5, 0.5, 51) ** 2], axis=1)
    np.testing.assert_allclose(missed(swing(height_m=0.5), one(arc)), (0.1, 25), atol=1e-12)
    assert missed(swing(height_m=0.3), one(arc))[0] == 0.0
    # After the window it does not count.
    np.testing.assert_allclose(missed(swing(height_m=0.5), one(arc, last=20)), (0.11, 20), atol=1e-12)
    np.testing.assert_allclose(missed(swing(speed_m_s=13.0), one(ACROSS))[0], 0.3)


def test_velocity_is_that_over_a_few_samples() -> None:
    np.testing.assert_allclose(velocities(ACROSS[None], STEP_S)[0], np.tile([10.0, 0.0], (51, 1)), atol=1e-9)
    noisy = ACROSS + np.random.default_rng(0).normal(0, 7e-4, ACROSS.shape)
    assert np.std(velocities(noisy[None], STEP_S)[0, 3:-3, 0]) < 0.12


def test_every_objective_refuses_only_targets_out_of_reach(task: PlanningTask) -> None:
    far = replace(task, objective=segment(((0.4, 0.5), (1.2, 0.5))))
    refuse_unreachable(far)  # its near end will do
    with pytest.raises(StrandcastError, match=r"no throw comes nearer than") as caught:
        refuse_unreachable(replace(task, objective=segment(((1.1, 0.5), (1.2, 0.5)))))
    assert caught.value.field == "objective"
    # The middle of the string reaches less far than the tip.
    refuse_unreachable(replace(task, objective=shape((0.3, (0.9, 0.0)))))
    with pytest.raises(StrandcastError, match=r"arm and string reach 0\.800 m"):
        refuse_unreachable(replace(task, objective=shape((0.1, (0.9, 0.0)))))
    refuse_unreachable(replace(task, objective=swing(height_m=9.0)))


def with_objective(task: PlanningTask, objective: Objective) -> PlanningTask:
    """Return the task with an objective; an aimed point brings its own target."""
    target_m = np.array(getattr(objective, "target_m", task.target_m))
    return replace(task, objective=objective, target_m=target_m)


def planned(task: PlanningTask, strings: StringBatch, objective: Objective, seed: int = 1) -> PlannedMotion:
    settings = PlanSettings(evaluations=480, disturbances=0.3)
    return plan_first(with_objective(task, objective), strings, settings, np.random.default_rng(seed))


def again(task: PlanningTask, strings: StringBatch, plan: PlannedMotion) -> tuple[np.ndarray, int]:
    """Throw a plan's motion with its best string: the points (T, n+1, 2) and the sample of the hit."""
    rollouts = rollouts_of_curves(task, strings.take([0]), RolloutConditions(task.arm.servo), [plan.curve])
    return rollouts.points_m[0], round(plan.hit_time_s / task.step_s)


@pytest.mark.thorough
def test_a_plan_hits_a_point_from_above_and_fast(task: PlanningTask, strings: StringBatch) -> None:
    wanted = aimed((0.62, 0.05), (-np.pi / 2, 0.5), least_speed_m_s=3.0)
    plan = planned(task, strings, wanted)
    assert plan.miss_m < 0.04
    points, k = again(task, strings, plan)
    velocity = (points[k + 2, -1] - points[k - 2, -1]) / (4 * task.step_s)
    assert np.hypot(*velocity) > 2.5
    assert abs(np.arctan2(*velocity[::-1]) + np.pi / 2) < 0.6
    assert np.hypot(*(points[k, -1] - [0.62, 0.05])) < 0.05
    assert plan.objective == "point, the tip moving at -90° ± 29°, at 3 m/s at least"


def test_a_plan_strikes_a_bar(task: PlanningTask, strings: StringBatch) -> None:
    plan = planned(task, strings, segment(((0.80, 0.25), (0.80, 0.45))))
    assert plan.miss_m < 0.01
    points, k = again(task, strings, plan)
    assert abs(points[k, -1, 0] - 0.80) < 0.04
    assert 0.22 < points[k, -1, 1] < 0.48


def test_a_plan_makes_a_shape_for_a_moment(task: PlanningTask, strings: StringBatch) -> None:
    # The string stretched out, straight and nearly level, to the right of the arm.
    level = shape((0.15, (0.75, 0.02)), (0.30, (0.90, 0.05)))
    plan = planned(task, strings, level)
    assert plan.miss_m < 0.06
    points, k = again(task, strings, plan)
    away = [points[k, 5] - [0.75, 0.02], points[k, 10] - [0.90, 0.05]]
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(away)) * 2), plan.miss_m, atol=0.002)


def test_a_plan_swings_the_tip_up(task: PlanningTask, strings: StringBatch) -> None:
    plan = planned(task, strings, swing(height_m=0.70))
    points, _ = again(task, strings, plan)
    assert plan.miss_m < 0.02
    assert points[:, -1, 1].max() > 0.68
    assert not any("workspace" in flag for flag in plan.flags)


@pytest.fixture(scope="module")
def first(task: PlanningTask, strings: StringBatch) -> Curve:
    return planned(task, strings, aimed((0.50, 0.50))).curve


def really(task: PlanningTask, string: StringBatch, curve: Curve, trial: int) -> tuple[PastTrial, Rollouts]:
    """Throw a string that was not planned with: the track without a measured miss, and the truth."""
    time_s, command, last = commands([sample(curve, task.step_s)], task.step_s)
    q = respond(task.arm.servo, time_s, command)
    rollouts = simulate_rollouts(task, string, RolloutConditions(), q, last)
    tip = rollouts.points_m[0, :, -1]
    seen = tip + np.random.default_rng(trial).normal(0.0, 0.0007, tip.shape)
    return PastTrial(trial, curve, command[0], q[0], time_s, seen, None, 0.0, None), rollouts


def beside(kind: str, points: np.ndarray, step_s: float, offset_m: float) -> Objective:
    """Return an objective beside the place where a throw (T, n+1, 2) had its fastest tip."""
    velocity = velocities(points[None, :, -1], step_s)[0]
    speed = np.linalg.norm(velocity, axis=1)
    k = int(np.argmax(speed))
    along = velocity[k] / speed[k]
    offset = offset_m * np.array([-along[1], along[0]])
    near, far, middle = (
        tuple(map(float, p)) for p in points[k, [10, 10, 5]] + offset * [[1.0], [1.6], [1.0]]
    )
    if kind == "segment":
        return segment((near, far))
    if kind == "shape":
        return shape((0.15, middle), (0.30, near))
    if kind == "swing":
        return swing(speed_m_s=float(speed[k]) + 0.6)
    direction_rad = float(np.arctan2(along[1], along[0]))
    return aimed(near, (direction_rad, 0.4), least_speed_m_s=0.8 * float(speed[k]))


@pytest.mark.parametrize("kind", ["segment", "shape", "swing", "direction"])
def test_later_motions_come_nearer_for_every_kind(
    task: PlanningTask, strings: StringBatch, first: Curve, kind: str
) -> None:
    parameters = strings.parameters[:1] * np.where(np.arange(10) == 7, 3.0, 1.0)
    unlike = {"rest_curl_rad_m": np.array([4.0]), "clamp_offset_rad": np.array([0.25])}
    unknown = StringBatch(parameters, 0.8 * strings.masses[1:2], unlike)
    trial, truth = really(task, unknown, first, 1)

    def missed(objective: Objective, rollouts: Rollouts) -> float:
        return float(simulated_miss(objective, rollouts)[0][0])

    both = [beside(kind, truth.points_m[0], task.step_s, offset_m) for offset_m in (-0.05, 0.05)]
    objective = max(both, key=lambda one: missed(one, truth))
    # So wide a hit keeps the search near the trial: bias correction must do the work.
    goal = replace(with_objective(task, objective), hit_radius_m=0.5)
    # No miss was measured: the planner estimates it from the tracked tip.
    assert abs(likely_miss_m(goal, strings, trial) - missed(objective, truth)) < 0.03
    settings = PlanSettings(evaluations=1440, disturbances=0.3)
    second = plan_next(goal, strings, [trial], settings, np.random.default_rng(2))
    assert second.kind == "refined"
    again_m = missed(objective, really(task, unknown, second.curve, 2)[1])
    assert missed(objective, truth) > 0.03
    assert again_m < 0.5 * missed(objective, truth)
