"""The fitted string is the one that the planner throws, and its motion record gives it back."""

from dataclasses import fields

import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import load_arm
from strandcast.config.estimate import EstimateSettings
from strandcast.core.box import Box
from strandcast.core.strings import (
    BEND_FRICTION,
    CLAMP_OFFSET,
    FRICTION_STICK,
    REST_CURL,
    STIFF_BEND,
    StringBatch,
)
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.masses import mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.throws import PreparedThrow
from strandcast.estimation.unknowns import prior_exponents, space_of
from strandcast.planning.bezier import Curve, rest_heights, sample
from strandcast.planning.describe import describe
from strandcast.planning.rollouts import RolloutConditions, commands, simulate_rollouts
from strandcast.planning.search import SearchResult
from strandcast.planning.task import PlanningTask
from strandcast.planning.write import to_record
from strandcast.records.estimate import ENSEMBLE
from strandcast.records.tables import write_table
from strandcast.stages.estimate import _planned
from strandcast.stages.estimate_record import ensemble_table
from strandcast.stages.plan_inputs import fitted_strings

LENGTH_M, POINTS = 0.30, 10
PIPED = mass_layout(LENGTH_M, POINTS, [0.30], [(0.12, 0.18)])
MODEL = StringModel(LENGTH_M, POINTS)


@pytest.fixture
def task(project_root) -> PlanningTask:
    arm = load_arm(project_root / "config/arms/planar3.toml")
    return PlanningTask(arm, MODEL, np.array([0.50, 0.50]), 0.02, Box(x_m=(-0.75, 1.25), y_m=(-0.32, 0.80)))


@pytest.fixture
def fitted() -> StringBatch:
    """Return three strings with curl, turned clamp, stiff pipe, found weight and sticking friction."""
    settings = EstimateSettings(clamp_offset=True, stiff_bend=True, friction_stick=True, find_weights=1)
    space = space_of(settings, PIPED, LENGTH_M)
    return space.strings(prior_exponents(space, MODEL, 3, np.random.default_rng(4)))


def test_the_options_of_the_experiment_are_fitted():
    for name in ("rest_curl", "clamp_offset", "stiff_bend", "bend_friction", "friction_stick"):
        for wanted in (True, False):
            settings = EstimateSettings.model_validate({name: wanted})
            fitted = {"rest_curl": REST_CURL, "clamp_offset": CLAMP_OFFSET, "stiff_bend": STIFF_BEND}
            fitted["friction_stick"] = FRICTION_STICK
            unknown = fitted.get(name, BEND_FRICTION)
            assert (unknown in space_of(settings, PIPED, LENGTH_M).names) is wanted


def test_the_planner_throws_what_was_fitted(tmp_path, task, fitted):
    path = tmp_path / "ensemble.parquet"
    write_table(path, ENSEMBLE, ensemble_table(fitted, np.arange(3.0)))
    planned = fitted_strings(path, PIPED)
    heights = rest_heights(np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]]))
    curve = Curve(np.array([0.4, -0.5, 0.3]), 0.5, heights)
    time_s, q, last = commands([sample(curve, task.step_s)], task.step_s)
    pose = hand_pose(task.arm.chain, task.arm.clamp, q[0]).array()
    nothing = np.zeros(0)
    throw = PreparedThrow(nothing, time_s, nothing, nothing, HandPath(time_s, pose))
    simulated, _ = simulate_throw(MODEL, throw, fitted)
    rollouts = simulate_rollouts(task, planned, RolloutConditions(), q, last)
    np.testing.assert_allclose(rollouts.points_m, simulated, atol=1e-9)
    assert not np.allclose(simulated[0], simulated[1], atol=0.01)

    found = SearchResult("refined", curve, 1, [])
    plan = describe(task, planned, "ensemble", found, rollouts, rollouts)
    known = _planned(to_record(plan, task, "test", 2, 0, {}), PIPED)
    assert known is not None
    for column in fields(StringBatch):
        # `masses` contains the first two.
        if column.name not in ("free_masses", "found_weights", "disturbances"):
            np.testing.assert_array_equal(getattr(known, column.name), getattr(fitted, column.name)[:1])
