"""Mass points with a tracker's noise, as from motion capture."""

import numpy as np
import pytest

from strandcast.lab.swing import LabSwing
from strandcast.lab.tracked_points import TrackerNoise, points_at, with_tracker_noise

NOTHING = np.zeros((3, 1))


@pytest.fixture
def swing() -> LabSwing:
    """Three nodes, 0.1 m apart, that bend into an L while they fall at 1 m/s."""
    time_s = np.array([0.0, 0.5, 1.0])
    first = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0]])
    bent = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]])
    nodes = np.array([first, bent - [0.0, 0.5], bent - [0.0, 1.0]])
    return LabSwing(time_s, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, nodes, np.array([0.0, 0.1, 0.2]))


def test_points_are_interpolated_in_position_and_time(swing: LabSwing) -> None:
    found = points_at(swing, np.array([0.0, 0.15, 0.2]), np.array([0.0, 0.25, 0.75]))
    np.testing.assert_allclose(found[0], [[0.0, 0.0], [0.15, 0.0], [0.2, 0.0]], atol=1e-12)
    # Half-way in time, the last node is half-way between its two places.
    np.testing.assert_allclose(found[1, -1], [0.15, 0.05 - 0.25], atol=1e-12)
    np.testing.assert_allclose(found[2], [[0.0, -0.75], [0.1, -0.70], [0.1, -0.65]], atol=1e-12)


def test_the_last_point_is_the_tip_of_a_longer_string(swing: LabSwing) -> None:
    np.testing.assert_allclose(points_at(swing, np.array([0.0, 0.18]), np.array([0.0]))[0, -1], [0.2, 0.0])


def test_noise_has_the_given_size_and_correlation_time() -> None:
    noise = TrackerNoise(white_m=1e-4, slow_m=5e-4, slow_s=0.02, lost=0.0)
    error = with_tracker_noise(np.zeros((20_000, 3, 2)), 0.002, noise, np.random.default_rng(0))
    np.testing.assert_allclose(error.std(), np.hypot(1e-4, 5e-4), rtol=0.03)
    covariance = (error[10:] * error[:-10]).mean()  # 20 ms apart
    np.testing.assert_allclose(covariance, 5e-4**2 * np.exp(-1.0), rtol=0.1)


def test_lost_frames_lose_all_points_and_come_in_runs() -> None:
    noise = TrackerNoise(lost=0.02, lost_run=4)
    found = with_tracker_noise(np.zeros((20_000, 2, 2)), 0.002, noise, np.random.default_rng(1))
    lost = np.isnan(found).all(axis=(1, 2))
    np.testing.assert_array_equal(lost, np.isnan(found).any(axis=(1, 2)))
    assert 0.015 < lost.mean() < 0.025
    begins = np.flatnonzero(lost[1:] & ~lost[:-1]) + 1
    assert all(lost[k : k + 4].all() for k in begins[begins < len(lost) - 4])
