"""Eqs. 4 to 6 on numbers that a person can check."""

import numpy as np

from strandcast.estimation.evaluation import distances, evaluation_of_points, point_values, rmse, tip_error

MEASURED = np.array([[[0, 0], [3, 4], [0, 0]], [[0, 0], [0, 0], [np.nan, np.nan]]], dtype=float)
SIMULATED = np.zeros((2, 3, 2))
SIMULATED[0, 2] = [0.0, 2.0]


def evaluation_value(measured, simulated, w=0.0, confidence=None, reading="world"):
    return evaluation_of_points(point_values(distances(measured, simulated, reading), confidence), w)


def test_evaluation_value_is_equations_4_to_6():
    distance = distances(MEASURED, SIMULATED)
    np.testing.assert_array_equal(distance, [[5.0, 2.0], [0.0, np.nan]])
    np.testing.assert_array_equal(point_values(distance), [2.5, 2.0])
    assert evaluation_value(MEASURED, SIMULATED) == 2.25
    assert evaluation_value(MEASURED, SIMULATED, w=0.5) == (2.5 + 2.0 * 1.5) / 2
    assert np.isclose(rmse(distance), np.sqrt((25 + 4) / 3))
    assert tip_error(distance) == 2.0


def test_confidence_is_a_weight_and_a_point_never_measured_does_not_count():
    assert evaluation_value(MEASURED, SIMULATED, confidence=np.array([[1.0, 1.0], [3.0, 1.0]])) == 1.625
    unseen = MEASURED.copy()
    unseen[:, 2] = np.nan
    assert evaluation_value(unseen, SIMULATED) == 2.5
    assert np.isnan(evaluation_value(np.full_like(MEASURED, np.nan), SIMULATED))


def test_a_diverged_string_is_infinitely_far_and_not_skipped():
    diverged = SIMULATED.copy()
    diverged[1] = np.nan
    assert evaluation_value(MEASURED, diverged) == np.inf
    assert evaluation_value(MEASURED, diverged, confidence=np.array([[1.0, 1.0], [0.0, 0.0]])) == 3.5


def test_hand_reading_is_relative_to_the_hand():
    moved = MEASURED + np.array([0.1, -0.2])
    np.testing.assert_allclose(
        distances(moved, SIMULATED, "hand"), distances(MEASURED, SIMULATED), atol=1e-12
    )
    assert evaluation_value(moved, SIMULATED) != evaluation_value(MEASURED, SIMULATED)
