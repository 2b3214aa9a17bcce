"""The fitted string is the one that the planner throws, and its motion record gives it back."""

from dataclasses import fields, replace

import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import load_arm
from strandcast.arm.spatial import hand_poses_in_space
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
from strandcast.estimation.cable_space import space_of_cable
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.throws import PreparedThrow
from strandcast.estimation.unknowns import prior_exponents, space_of
from strandcast.planning.bezier import Curve, rest_heights, sample
from strandcast.planning.describe import describe
from strandcast.planning.mesh_refinement import refined_strings, refined_task
from strandcast.planning.rollouts import RolloutConditions, commands, simulate_rollouts
from strandcast.planning.search import SearchResult
from strandcast.planning.task import PlanningTask
from strandcast.planning.write import to_record
from strandcast.records.estimate import ENSEMBLE
from strandcast.records.tables import write_table
from strandcast.stages.estimate import _planned
from strandcast.stages.estimate_record import ensemble_table
from strandcast.stages.plan_inputs import NOT_OF_THE_STRING, fitted_strings

LENGTH_M, POINTS = 0.30, 10
PIPED = mass_layout(LENGTH_M, POINTS, [0.30], [(0.12, 0.18)])
MODEL = StringModel(LENGTH_M, POINTS)


@pytest.fixture
def task(project_root) -> PlanningTask:
    arm = load_arm(project_root / "config/arms/planar3.toml").planar()
    return PlanningTask(arm, MODEL, np.array([0.50, 0.50]), 0.02, Box(x_m=(-0.75, 1.25), y_m=(-0.32, 0.80)))


@pytest.fixture
def fitted() -> StringBatch:
    """Return three strings with every unknown of a fit in the plane but for the camera's offset."""
    settings = EstimateSettings(
        clamp_offset=True, stiff_bend=True, friction_stick=True, drag_along=True, find_weights=1
    )
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
    assert_same_string(known, fitted.first(1))


def assert_same_string(one: StringBatch, other: StringBatch) -> None:
    for column in fields(StringBatch):
        if column.name not in (*NOT_OF_THE_STRING, "disturbances"):
            np.testing.assert_array_equal(getattr(one, column.name), getattr(other, column.name))


def test_the_planner_throws_in_space_what_was_fitted(tmp_path, project_root):
    arm = load_arm(project_root / "config/arms/ur5e-space.toml").spatial()
    every = {"drag_along": True, "friction_stick": True, "taper": True, "marker_shift": True}
    model, space = space_of_cable(LENGTH_M, False, points=POINTS, weight_places_m=[0.2], **every)
    task = PlanningTask(arm, model, np.array([0.55, 0.75, 0.55]), 0.02)
    chi = np.random.default_rng(4).uniform(0.4, 0.6, (2, space.dimension))
    # Curls of fits do not turn, but records know helices.
    fitted = replace(space.strings(chi), rest_torsion_rad_m=np.array([1.0, -2.0]))
    path = tmp_path / "ensemble.parquet"
    write_table(path, ENSEMBLE, ensemble_table(fitted, np.arange(2.0)))
    planned = fitted_strings(path, space.layout)
    assert_same_string(planned, fitted)
    assert not any(getattr(planned, name).any() for name in NOT_OF_THE_STRING)

    heights = rest_heights(np.random.default_rng(5).uniform(-3.0, 3.0, (len(arm.joints), 3)))
    curve = Curve(np.full(len(arm.joints), 0.3), 0.4, heights)
    time_s, q, last = commands([sample(curve, task.step_s)], task.step_s)
    pose = hand_poses_in_space(arm.chain, q, np.zeros((1, len(arm.joints))), np.zeros(1))[0]
    nothing = np.zeros(0)
    throw = PreparedThrow(nothing, time_s, nothing, nothing, HandPath(time_s, pose))
    simulated, _ = simulate_throw(model, throw, fitted)
    rollouts = simulate_rollouts(task, planned, RolloutConditions(), q, last)
    np.testing.assert_allclose(rollouts.points_m, simulated, atol=1e-9)
    # Each property matters: without it the tip is elsewhere.
    for name in ("length_change", "rest_torsion_rad_m", "taper", "drag_along", "clamp_offset_rad"):
        other = replace(fitted, **{name: np.zeros_like(getattr(fitted, name))})
        moved, _ = simulate_throw(model, throw, other)
        assert np.abs(moved - simulated)[:, :, -1].max() > 1e-4


def test_a_refined_chain_is_as_stiff_along_the_string(task):
    space = space_of(EstimateSettings(), PIPED, LENGTH_M)
    strings = space.strings(prior_exponents(space, MODEL, 2, np.random.default_rng(4)))
    tapered = replace(strings, taper=np.array([1.0, -2.0]))
    refined = refined_strings(tapered)
    assert refined_task(task).model.points == 2 * POINTS
    np.testing.assert_allclose(refined.bend_factors(), np.repeat(tapered.bend_factors(), 2, axis=1))
