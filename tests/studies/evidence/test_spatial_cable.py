"""A cable in space is fitted to series of its motion and predicts another one; held at one end or both."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.simulate import simulate_batch
from strandcast.dynamics.spatial.clamps import clamp_poses
from strandcast_studies.evidence.spatial_cable import CableFit, CableSeries, fit_cable, space_of_cable

pytestmark = pytest.mark.slow

LENGTH_M = 0.8
TIME_S = np.arange(0.0, 1.5, 0.01)
PLACES = np.linspace(0.0, 1.0, 11)
TRUTH = {
    "bending_length": 0.1,
    "damping_s": 0.05,
    "air": 0.1,
    "clamp_stiffness": 1.0,
    "length_change": -0.015,
    "clamp_left_rad": 0.1,
    "clamp_up_rad": -0.15,
    "far_left_rad": 0.05,
    "far_up_rad": 0.1,
    "curl_left_rad": 0.6,
    "curl_up_rad": -0.4,
}


def moved(phase: float, origin_m: tuple[float, float, float], direction: tuple[float, float, float]):
    """Poses of a clamp that moves and turns about all axes."""
    away = 0.1 * np.column_stack([np.sin(k * TIME_S + phase) - np.sin(phase) for k in (4.0, 3.0, 5.0)])
    turn = Rotation.from_rotvec(np.outer(0.5 * np.sin(4.0 * TIME_S), [0.3, -0.5, 0.8]))
    return clamp_poses(origin_m + away, turn.apply(direction))


def series(two_ends: bool, phase: float) -> CableSeries:
    """Return a motion of the true cable, with its vertices off by 0.2 mm."""
    pose = moved(phase, (0.0, 0.0, 0.0), (0.5, 0.0, -0.8))
    if two_ends:
        pose = np.hstack([pose, moved(phase + 1.0, (0.5, 0.1, 0.0), (-0.5, 0.1, -0.8))])
    model, space = space_of_cable(LENGTH_M, two_ends)
    strings = space.strings(space.exponents(np.array([TRUTH[name] for name in space.names])))
    points, _ = simulate_batch(model, strings, HandPath(TIME_S, pose), TIME_S)
    noise = np.random.default_rng(int(10 * phase)).normal(0.0, 2e-4, points[0, :, ::2].shape)
    return CableSeries(TIME_S, pose, points[0, :, ::2] + noise, PLACES)


@pytest.mark.parametrize("two_ends", [False, True], ids=["one end", "two ends"])
def test_a_fitted_cable_predicts_another_motion(two_ends):
    fit = fit_cable([series(two_ends, 0.0), series(two_ends, 1.3)], LENGTH_M)
    other = series(two_ends, 2.9)
    missed = np.linalg.norm(fit.predict(other) - other.vertices_m, axis=2).mean()
    assert missed < 4e-3
    assert len(fit.space.names) <= 10
    found = fit.values()
    assert found["bending_length"] == pytest.approx(TRUTH["bending_length"], rel=0.1)
    assert found["length_change"] == pytest.approx(TRUTH["length_change"], abs=4e-3)


def test_vertices_that_jump_or_are_not_seen_do_not_count():
    clean = series(False, 0.0)
    vertices = clean.vertices_m.copy()
    vertices[40, 5] += 0.3
    vertices[60:70, 3] = np.nan
    reliable = CableSeries(TIME_S, clean.pose, vertices, PLACES).reliable()
    expected = np.ones_like(reliable)
    expected[39:42, 5] = False
    expected[59:71, 3] = False
    np.testing.assert_array_equal(reliable, expected)


def test_a_prediction_reads_the_start_only():
    model, space = space_of_cable(LENGTH_M, False)
    chi = space.exponents(np.array([TRUTH[name] for name in space.names]))
    whole = series(False, 0.0)
    hidden = whole.vertices_m.copy()
    hidden[2:] = np.nan
    fit = CableFit(model, space, chi, 0.0, 0)
    np.testing.assert_array_equal(
        fit.predict(whole), fit.predict(CableSeries(TIME_S, whole.pose, hidden, PLACES))
    )
