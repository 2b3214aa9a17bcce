"""Descent over motions in space: steps to the least miss, only along what the tips are sensitive to."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.config.plan import PlanSettings
from strandcast.dynamics.masses import mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.planning import global_search
from strandcast.planning.assessment import assess_rollouts
from strandcast.planning.bezier import Curve, rest_heights
from strandcast.planning.global_search import Encoding, screen
from strandcast.planning.motion_descent import (
    LADDER,
    MotionResiduals,
    descend_motion,
    miss_parts,
    motion_residuals,
    near_limits,
)
from strandcast.planning.paths import Curves, paths_of
from strandcast.planning.rollouts import RolloutConditions, Rollouts
from strandcast.planning.search import SearchInputs
from strandcast.planning.simulated_misses import simulated_miss
from strandcast.planning.start_strings import start_strings_in_space
from strandcast.planning.task import PlanningTask

RANK = 2  # of the tips' sensitivity in these tests


def bowl(points: np.ndarray) -> MotionResiduals:
    """Two residuals that bend with the first two of five unknowns; a wall at 1.5 of the second."""
    x, y = points[:, 0], points[:, 1]
    parts = np.column_stack([x + 0.3 * x**2 - 1.0, 2.0 * (y - 1.0) + 0.2 * x * y])
    return MotionResiduals(parts, np.sqrt((parts**2).sum(axis=1)) + 10.0 * (y > 1.5))


def test_a_descent_ends_at_the_least_cost_and_leaves_the_rest() -> None:
    start = np.array([-0.5, 0.2, 0.4, -0.3, 0.7])
    point, cost_m, tried = descend_motion(bowl, start, 4, 120)
    assert cost_m < 1e-4
    assert tried <= 120
    np.testing.assert_allclose(bowl(point[None]).cost_m, cost_m)
    np.testing.assert_allclose(point[RANK:], start[RANK:], atol=1e-9)  # nothing depends on them


def test_a_descent_keeps_to_its_evaluations_and_never_gets_worse() -> None:
    start = np.array([-0.5, 0.2, 0.4, -0.3, 0.7])
    point, cost_m, tried = descend_motion(bowl, start, 4, 4 + len(LADDER))
    assert tried == 1  # one step needs one more
    np.testing.assert_array_equal(point, start)
    _, one_step_m, tried = descend_motion(bowl, start, 4, 5 + len(LADDER))
    assert tried == 5 + len(LADDER)
    assert one_step_m < cost_m


def test_a_descent_from_the_minimum_stops_there() -> None:
    point, _, _ = descend_motion(bowl, np.zeros(5), 4, 200)
    again, _, tried = descend_motion(bowl, point, 4, 200)
    flat = descend_motion(lambda points: MotionResiduals(0.0 * points, np.ones(len(points))), point, 4, 200)
    assert flat[1:] == (1.0, 5)
    np.testing.assert_allclose(again, point, atol=1e-3)
    assert tried < 60


@pytest.fixture(scope="module")
def task(project_root: Path) -> PlanningTask:
    arm = load_arm(project_root / "config/arms/ur5e-space.toml").spatial()
    return PlanningTask(arm, StringModel(0.4, 10, dt_s=2e-3), np.array([0.55, 0.75, 0.55]), 0.02).rough()


def test_offsets_are_as_long_as_the_misses_between_samples_too(task: PlanningTask) -> None:
    # The tip passes the target 30 mm below it, half-way between two samples.
    points_m = np.zeros((1, 3, 2, 3))
    places_m = np.array([[-0.2, 0.0, -0.03], [-0.1, 0.0, -0.03], [0.1, 0.0, -0.03]])
    points_m[0, :, 1] = task.target_m + places_m
    rollouts = Rollouts(points_m, np.zeros((1, 3, 3)), np.array([2]), 2e-3, 0.04, np.zeros((1, 3, 1, 2, 3)))
    found = miss_parts(task, rollouts, assess_rollouts(task, rollouts))
    np.testing.assert_allclose(found, [[0.0, 0.0, -0.03]], atol=1e-12)
    np.testing.assert_allclose(simulated_miss(task.aim, rollouts)[0], 0.03)


def test_joints_turn_away_before_their_limits(task: PlanningTask) -> None:
    curves = Curves(np.zeros((2, 6)), np.full(2, 0.5), rest_heights(np.full((2, 6, 6), 0.5)))
    paths = paths_of(curves, task.step_s)
    limits = task.arm.limits
    assert near_limits(paths, task.arm).max() == 0.0
    fast = paths.speed.copy()
    fast[1, 2] = 0.99 * limits.velocity_rad_s[2]  # allowed, but near
    paths.speed[:] = fast
    found = near_limits(paths, task.arm)
    assert found[0].max() == 0.0
    assert np.flatnonzero(found[1]).tolist() == [2 * 6 + 2]
    np.testing.assert_allclose(found[1].max(), 0.99 - 0.995 + 0.02)


def test_random_motions_are_ranked_by_all_strings_though_most_meet_only_one(
    task: PlanningTask, monkeypatch: pytest.MonkeyPatch
) -> None:
    misses_m = np.random.default_rng(2).uniform(1.0, 2.0, (200, 2))
    misses_m[100:] += 2.0
    misses_m[80] = 1.4, 0.0  # the best with both strings, one of many with the first
    drawn = [Curve(np.full(6, float(k)), 0.5, np.zeros((6, 6))) for k in range(len(misses_m))]
    rollouts = 0

    def cost_of(*given: Any) -> MotionResiduals:
        nonlocal rollouts
        met_m = misses_m[given[3].q0_rad[:, 0].astype(int), : len(given[1])]
        rollouts += met_m.size
        return MotionResiduals(met_m, np.sqrt(np.mean(met_m**2, axis=1)))

    monkeypatch.setattr(global_search, "draw_first", lambda *_: drawn)
    monkeypatch.setattr(global_search, "motion_residuals", cost_of)
    rng = np.random.default_rng(1)
    strings = start_strings_in_space(2, 0.4, mass_layout(0.4, 10, [0.4]), rng)
    best, counted = screen(SearchInputs(task, strings, RolloutConditions(), PlanSettings(), rng), 4)
    ranking = np.argsort((misses_m**2).sum(axis=1))
    assert [curve.q0_rad[0] for curve in best] == ranking[:4].tolist()
    assert ranking[0] == 80
    assert counted == rollouts < 200 + 2 * 150


def test_a_descent_finds_a_throw_near_the_best_of_some_random_ones(task: PlanningTask) -> None:
    rng = np.random.default_rng(1)
    strings = start_strings_in_space(2, 0.4, mass_layout(0.4, 10, [0.4]), rng)
    given = SearchInputs(task, strings, RolloutConditions(), PlanSettings(evaluations=64), rng)
    encoding = Encoding(6, (0.35, 0.9), task.step_s)
    best = encoding.point(screen(given, 1)[0][0])

    def residuals(points: np.ndarray) -> MotionResiduals:
        return motion_residuals(task, strings, RolloutConditions(), encoding.curves(points))

    start_m = residuals(best[None]).cost_m[0]
    _, cost_m, tried = descend_motion(residuals, best, 42, 300)
    assert tried <= 300
    assert start_m > 0.10
    assert cost_m < 0.2 * start_m
