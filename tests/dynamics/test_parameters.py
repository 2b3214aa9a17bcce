"""Ranges, exponents, start strings and masses."""

import numpy as np
from arrays import start_shape

from strandcast.core.strings import PARAMETERS
from strandcast.dynamics import parameters as ps
from strandcast.dynamics.masses import mass_layout, point_masses
from strandcast.dynamics.model import StringModel


def test_exponents_are_equation_2():
    ranges = ps.RANGES["paper"]
    np.testing.assert_allclose(ps.from_exponent(np.full(10, 0.5), ranges)[[0, 2]], [10**4.5, 0.1])
    chi = np.linspace(-0.2, 1.2, 10)
    np.testing.assert_allclose(ps.to_exponent(ps.from_exponent(chi, ranges), ranges), chi, atol=1e-12)


def test_minima_are_table_2():
    np.testing.assert_array_equal(
        ps.minima(2).parameters[0], [1e3, 1, 1e-3, 1e-3, 1e-4, 1e-4, 1e-6, 1e-6, 1e-3, 1e-3]
    )
    np.testing.assert_array_equal(ps.minima(2).weight_masses, [[1.0, 1.0]])


def test_ensemble_is_plausible_and_repeatable():
    first = ps.ensemble(8, 0.3, 10, 1, np.random.default_rng(3))
    again = ps.ensemble(8, 0.3, 10, 1, np.random.default_rng(3))
    assert first.parameters.tobytes() == again.parameters.tobytes()
    low, high = ps.RANGES["wide"].T
    assert np.all((first.parameters >= low) & (first.parameters <= high))
    # 2 to 30 g over 30 mm of 1…40 g/m
    assert np.all((first.weight_masses > 1.6) & (first.weight_masses <= 800.0))
    assert np.ptp(np.log(first.weight_masses)) > np.log(4.0)
    masses = point_masses(mass_layout(0.3, 10, [0.3]), first.weight_masses)
    for p, m in zip(first.parameters, masses, strict=True):
        points = start_shape(StringModel(0.3, 10), p, m, np.array([0.0, 0.0, -1.57]))
        assert abs(points[-1, 1] + 0.3) < 0.005  # nearly inextensible


def test_pipes_are_lighter_than_weights():
    layout = mass_layout(0.51, 17, [0.17], [(0.37, 0.44)])
    assert (layout.count, layout.stiff) == (3, 2)
    masses = ps.ensemble(64, 0.51, 17, 1, np.random.default_rng(0), layout.stiff).weight_masses
    # Points of pipe: 8 to 40 g/m over 1 to 40 g/m of cord, the same at both.
    assert np.all((masses[:, 1] > 8 / 40) & (masses[:, 1] < 40 / 1))
    np.testing.assert_array_equal(masses[:, 1], masses[:, 2])
    assert np.median(masses[:, 0]) > 10 * np.median(masses[:, 1])


def test_drag_follows_a_known_thickness():
    thin, thick = (
        ps.ensemble(16, 0.3, 10, 0, np.random.default_rng(1), thickness_m=d) for d in (0.002, 0.008)
    )
    drag = PARAMETERS.index("C_c2")
    np.testing.assert_allclose(thick.parameters[:, drag], 4.0 * thin.parameters[:, drag])


def test_weights_are_split_over_their_neighbours():
    layout = mass_layout(0.3, 10, [0.11, 0.3])
    np.testing.assert_allclose(layout.shares[0, 2:4], [1 / 3, 2 / 3])
    masses = point_masses(layout, np.array([6.0, 40.0]))
    np.testing.assert_allclose(masses, [1, 1, 3, 5, 1, 1, 1, 1, 1, 40.5])


def test_stiff_sections_free_the_masses_they_touch():
    layout = mass_layout(0.51, 17, [], [(0.37, 0.44)], "own")
    np.testing.assert_allclose(layout.places_m, [0.39, 0.42])
    masses = point_masses(layout, np.array([[0.5, 7.0]]), np.array([4.0]))
    np.testing.assert_allclose(masses[0, 11:15], [4.0, 0.5, 7.0, 4.0])
