"""The fitted string is the one that the planner throws, and its motion record gives it back."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import load_arm
from strandcast.arm.spatial import hand_poses_in_space
from strandcast.config.estimate import EstimateSettings
from strandcast.config.plan import PlanSettings
from strandcast.core.box import Box
from strandcast.core.strings import (
    BEND_FRICTION,
    CLAMP_OFFSET,
    FORCES,
    FRICTION_STICK,
    REST_CURL,
    REST_TORSION,
    STIFF_BEND,
    UNKNOWNS,
    StringBatch,
    Unknown,
    Way,
)
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.masses import MassLayout, mass_layout, point_masses
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import simulate_batch
from strandcast.estimation.cable_space import space_of_cable
from strandcast.estimation.estimate import estimate_throws
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.measured import Throw
from strandcast.estimation.throws import PreparedThrow
from strandcast.estimation.unknowns import prior_exponents, space_of
from strandcast.planning.bezier import Curve, rest_heights, sample
from strandcast.planning.describe import describe
from strandcast.planning.rollouts import RolloutConditions, Rollouts, commands, simulate_rollouts
from strandcast.planning.search import SearchInputs, SearchResult
from strandcast.planning.task import PlanningTask
from strandcast.planning.write import to_record
from strandcast.records.estimate import ENSEMBLE, Estimate
from strandcast.records.motion import StringSet
from strandcast.records.tables import write_table
from strandcast.report.panels.parameters import parameters as parameters_panel
from strandcast.stages.estimate import _planned
from strandcast.stages.estimate_record import ensemble_table
from strandcast.stages.past_trials import read_members

LENGTH_M, POINTS = 0.30, 10
PIPED = mass_layout(LENGTH_M, POINTS, [0.30], [(0.12, 0.18)])
MODEL = StringModel(LENGTH_M, POINTS)


@dataclass(frozen=True)
class World:
    """Two strings with every unknown that a fit of throws can have, and how fit and planner simulate them."""

    layout: MassLayout
    task: PlanningTask
    fitted: StringBatch
    motion: tuple[np.ndarray, np.ndarray, np.ndarray]
    curve: Curve
    pose: np.ndarray

    def as_fitted(self, strings: StringBatch) -> np.ndarray:
        nothing, time_s = np.zeros(0), self.motion[0]
        throw = PreparedThrow(nothing, time_s, nothing, nothing, HandPath(time_s, self.pose))
        return simulate_throw(self.task.model, throw, strings.thrown())[0]

    def rollouts(self, strings: StringBatch) -> Rollouts:
        return simulate_rollouts(self.task, strings, RolloutConditions(), *self.motion[1:])


def plane(project_root: Path) -> World:
    arm = load_arm(project_root / "config/arms/planar3.toml").planar()
    workspace = Box(x_m=(-0.75, 1.25), y_m=(-0.32, 0.80))
    task = PlanningTask(arm, MODEL, np.array([0.50, 0.50]), 0.02, workspace)
    settings = EstimateSettings(forces=list(FORCES), clamp_offset_sd_rad=0.05, camera_offset_sd_m=0.005)
    space = space_of(settings, PIPED)
    fitted = space.strings(prior_exponents(space, MODEL, 2, np.random.default_rng(4)))
    heights = rest_heights(np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]]))
    curve = Curve(np.array([0.4, -0.5, 0.3]), 0.5, heights)
    motion = commands([sample(curve, task.step_s)], task.step_s)
    return World(PIPED, task, fitted, motion, curve, hand_pose(arm.chain, arm.clamp, motion[1][0]).array())


def space(project_root: Path) -> World:
    arm = load_arm(project_root / "config/arms/ur5e-space.toml").spatial()
    places = {"weight_places_m": [0.2], "stiff_sections_m": [(0.1, 0.15)]}
    model, box = space_of_cable(LENGTH_M, False, points=POINTS, **places, forces=set(FORCES))
    task = PlanningTask(arm, model, np.array([0.55, 0.75, 0.55]), 0.02)
    chi = np.random.default_rng(4).uniform(0.4, 0.6, (2, box.dimension))
    # Curls of fits do not turn, but records know helices.
    fitted = box.strings(chi).with_values(rest_torsion_rad_m=np.array([1.0, -2.0]))
    heights = rest_heights(np.random.default_rng(5).uniform(-2.4, 2.4, (len(arm.joints), 3)))
    curve = Curve(np.full(len(arm.joints), 0.3), 0.4, heights)
    motion = commands([sample(curve, task.step_s)], task.step_s)
    pose = hand_poses_in_space(arm.chain, motion[1], np.zeros((1, len(arm.joints))), np.zeros(1))[0]
    return World(box.layout, task, fitted, motion, curve, pose)


WORLDS = {"plane": plane, "space": space}


@pytest.fixture(scope="module", params=WORLDS)
def world(request, project_root) -> World:
    return WORLDS[request.param](project_root)


def test_the_options_of_the_experiment_are_fitted():
    every = (REST_CURL, STIFF_BEND, BEND_FRICTION, FRICTION_STICK)
    for force, *unknowns in (
        ("rest_curl", REST_CURL),
        ("stiff_bend", STIFF_BEND),
        ("bend_friction", BEND_FRICTION),
        ("friction_stick", BEND_FRICTION, FRICTION_STICK),
    ):
        names = space_of(EstimateSettings(forces=[force]), PIPED).names
        assert set(every) & set(names) == set(unknowns)
    for sd_rad, prior in ((None, []), (0.05, [0.05]), ("any", [np.inf])):
        space = space_of(EstimateSettings(clamp_offset_sd_rad=sd_rad), PIPED)
        assert list(space.prior_sd[[name == CLAMP_OFFSET for name in space.names]]) == prior


FITTED = [
    (name, world)
    for name, row in UNKNOWNS.items()
    for world, how in (("plane", row.range), ("space", row.in_space or name == REST_TORSION))
    if how and not (row.in_space and row.in_space.needs == "two clamps")
]


def planned_from(path: Path, world: World) -> StringBatch:
    write_table(path, ENSEMBLE, ensemble_table(world.fitted, np.arange(2.0)))
    return read_members(path, world.layout).thrown()


@pytest.mark.parametrize(("name", "world"), FITTED, indirect=["world"])
def test_the_planner_throws_what_was_fitted(tmp_path, name, world):
    planned = planned_from(tmp_path / "ensemble.parquet", world)
    row = UNKNOWNS[name]
    assert np.any(world.fitted[name] != row.absent)
    np.testing.assert_array_equal(planned[name], world.fitted[name] if row.thrown else row.absent)
    thrown = world.rollouts(planned)
    np.testing.assert_allclose(thrown.points_m, world.as_fitted(world.fitted), atol=1e-9)
    # It matters: without it the tip is elsewhere.
    other = world.fitted.with_values(**{name: np.full(2, row.absent)})
    moved_m = np.abs(world.as_fitted(other) - thrown.points_m)[:, :, -1].max()
    assert moved_m > 1e-5 if row.thrown else moved_m < 1e-9
    found = SearchResult("refined", world.curve, 1, [])
    given = SearchInputs(world.task, planned, RolloutConditions(), PlanSettings(), np.random.default_rng(0))
    plan = describe(given, found, thrown, thrown)
    known = _planned(to_record(plan, world.task, "test", 2, 0, {}), world.layout)
    assert known is not None
    np.testing.assert_array_equal(known[name], planned[name][:1])


def heavier_tip(strings: StringBatch, values: np.ndarray) -> StringBatch:
    masses = strings.masses.copy()
    masses[:, -1] *= values
    return replace(strings, masses=masses)


@pytest.fixture
def toy(monkeypatch) -> Unknown:
    bounds = (0.5, 50.0)
    row = Unknown(
        "tip_heaviness",
        "heaviness of the tip",
        range=bounds,
        in_space=Way("tip_heaviness", bounds),
        absent=1.0,
        apply=heavier_tip,
    )
    monkeypatch.setitem(UNKNOWNS, row.name, row)
    return row


@pytest.mark.parametrize("kind", WORLDS)
def test_an_unknown_from_outside_is_fitted_stored_and_planned_with(tmp_path, project_root, toy, kind):
    world = WORLDS[kind](project_root)
    planned = planned_from(tmp_path / "ensemble.parquet", world)
    np.testing.assert_array_equal(planned[toy.name], world.fitted[toy.name])
    thrown = world.rollouts(planned).points_m
    np.testing.assert_allclose(thrown, world.as_fitted(world.fitted), atol=1e-9)
    light = world.fitted.with_values(tip_heaviness=np.ones(2))
    assert np.abs(world.as_fitted(light) - thrown)[:, :, -1].max() > 1e-3
    assert StringSet.first_of(planned).options[toy.name] == planned[toy.name][0]


def test_an_unknown_from_outside_is_found_and_on_the_page(toy, project_root):
    time_s = np.arange(0.0, 0.6, 0.004)
    s = np.clip(time_s / 0.4, 0.0, 1.0)
    ease = s**3 * (10 - 15 * s + 6 * s**2)
    pose = np.column_stack([0.5 * ease, 0.3 * np.sin(np.pi * ease), -np.pi / 2 + 2.0 * ease])
    model, layout = StringModel(0.24, 6), mass_layout(0.24, 6, [])
    parameters = np.array([[2e7, 20.0, 0.8, 0.01, 0.5, 0.005, 0.01, 0.2, 2.0, 0.02]])
    string = StringBatch(parameters, point_masses(layout, np.zeros((1, 0))), {toy.name: np.array([12.0])})
    points_m = simulate_batch(model, string, HandPath(time_s, pose), time_s)[0][0]
    throw = Throw(time_s, points_m, time_s, pose, time_s < 0.55)
    settings = EstimateSettings(evaluations=800, forces=["rest_curl"], profiles=False)
    fit = estimate_throws([throw], model, layout, settings, np.random.default_rng(3))
    assert fit.best[toy.name][0] == pytest.approx(12.0, rel=0.5)
    record = Estimate.read(project_root / "tests/records/estimate-v1.json")
    record = record.model_copy(update={"options": StringSet.first_of(fit.best).options})
    page: Any = SimpleNamespace(results=SimpleNamespace(need=lambda _: record), caveat=None)
    assert any(row[0] == toy.words for row in parameters_panel(page).tables[0].rows)
