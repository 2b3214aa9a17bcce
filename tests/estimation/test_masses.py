"""Which masses of a weight explain a recording as well, and which motions determine more."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.spatial.clamps import clamp_poses
from strandcast.estimation.cable_series import CableSeries
from strandcast.estimation.cable_space import space_of_cable
from strandcast.estimation.excitation import undetermined
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective, simulate_throw
from strandcast.estimation.masses import RISE, with_masses
from strandcast.estimation.uncertainty import uncertainty_of
from strandcast.estimation.windows import parts_of_series

LENGTH_M = 0.5
PLACES = np.linspace(0.25, 1.0, 4)
DOWN = np.array([0.0, 0.0, -1.0])
TRUTH = {"bending_length": 0.15, "damping_s": 0.03, "air": 0.1, "clamp_stiffness": 1.0, "weight_1": 12.0}


def objective_of(size_m: float, **other: float) -> tuple[FitObjective, np.ndarray]:
    """Return a fit of a weighted string that a hand swings this far, and the true exponents."""
    true = TRUTH | other
    model, space = space_of_cable(LENGTH_M, False, points=10, weight_places_m=[LENGTH_M])
    chi = space.exponents(np.array([true.get(name, 0.0) for name in space.names]))
    time_s = np.arange(0.0, 1.5, 0.02)
    ways = [np.sin(7.0 * time_s), np.sin(5.0 * time_s), 0.0 * time_s]
    place = size_m * time_s[:, None] * np.column_stack(ways)
    pose = clamp_poses(place, np.broadcast_to(DOWN, place.shape))
    series = CableSeries(time_s, pose, np.zeros((len(time_s), len(PLACES), 3)), PLACES)
    throw = parts_of_series([series], model.points, "hanging", last=False).throws[0]
    throw = replace(throw, hand=HandPath(time_s, pose))
    seen, _ = simulate_throw(model, throw, space.strings(chi))
    noise = np.random.default_rng(1).normal(0.0, 5e-4, seen[0].shape)
    throw = replace(throw, points_m=seen[0] + noise)
    return FitObjective(model, space, (throw,), np.ones(1), "world", overstretched_allowed=True), chi


@pytest.fixture(scope="module")
def swung():
    """Return a fit, its log and its uncertainty before masses were tried."""
    objective, chi = objective_of(0.2)
    log = EvaluationLog(objective.cost)
    log(chi[None])
    return objective, chi, log, uncertainty_of(objective, log, profiles=True)


def test_masses_that_explain_a_recording_as_well_are_found(swung):
    """Ends of the interval are as much worse as is allowed, or at the bound of the range."""
    objective, chi, log, known = swung
    row = objective.space.names.index("weight_1")
    found = with_masses(known, objective, log)
    value = log.best()[1]
    assert found.low[row] < chi[row] < found.high[row]
    assert found.low[row] <= known.low[row]
    assert found.high[row] >= known.high[row]
    others = np.arange(len(chi)) != row
    np.testing.assert_array_equal(found.low[others], known.low[others])
    tried, values = log.all()
    outside = (tried[:, row] < found.low[row] - 1e-9) | (tried[:, row] > found.high[row] + 1e-9)
    assert outside.any()
    assert values[outside].min() > (1.0 + RISE) * value
    assert not found.open_low[row]
    assert not found.open_high[row]


def test_a_stiff_string_with_another_weight_and_as_heavy_moves_nearly_alike():
    objective, chi = objective_of(0.2, bending_length=1.0)
    row = objective.space.names.index("weight_1")
    moved = np.tile(chi, (2, 1))
    moved[:, row] += [0.1, -0.1]
    as_heavy = objective.space.as_heavy(moved[:, row], chi, row)
    np.testing.assert_allclose(as_heavy[:, row], moved[:, row])
    assert (objective.cost(as_heavy) < 0.5 * objective.cost(moved)).all()


def test_a_motion_that_hardly_moves_the_string_leaves_it_open_and_another_is_advised(swung):
    objective, chi = objective_of(0.004)
    log = EvaluationLog(objective.cost)
    log(chi[None])
    known = uncertainty_of(objective, log, profiles=True, long=True)
    # Long profiles go on until E rises.
    np.testing.assert_allclose(known.low[known.open_low], 0.0, atol=1e-9)
    np.testing.assert_allclose(known.high[known.open_high], 1.0, atol=1e-9)
    left = undetermined(objective, objective.throws[0], log, known)
    assert "air" in left
    assert left["air"] in ("a wider motion", "a free swing")
    wide, _, wide_log, wide_known = swung
    assert "air" not in undetermined(wide, wide.throws[0], wide_log, wide_known)
