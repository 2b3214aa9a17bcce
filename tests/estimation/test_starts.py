"""How a captured string starts: from noisy markers, and from markers beside the string."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import strandcast
from strandcast.dynamics.spatial.clamps import clamp_poses
from strandcast.estimation.cable_series import CableSeries, smoothest
from strandcast.estimation.measured import Throw, observed_start

DOWN = np.array([0.0, 0.0, -1.0])


def resting(noise_m: float, rate_hz: float = 60.0, seed: int = 3) -> CableSeries:
    """Return two markers of a string of 1.5 m that hangs still for a second, then moves away."""
    time_s = np.arange(0.0, 2.0, 1.0 / rate_hz)
    away = np.clip(time_s - 1.0, 0.0, None) ** 2
    place = np.column_stack([away, np.zeros((len(time_s), 2))])
    markers = np.stack([place + 0.75 * DOWN, place + 1.5 * DOWN], axis=1)
    noise = np.random.default_rng(seed).normal(0.0, noise_m, markers.shape)
    pose = clamp_poses(place, np.broadcast_to(DOWN, place.shape))
    return CableSeries(time_s, pose, markers + noise, np.array([0.5, 1.0]))


@pytest.mark.parametrize("rate_hz", [30.0, 60.0, 240.0])
def test_noise_at_rest_is_no_velocity(rate_hz):
    """In the plane 0.02 m/s would swing a heavy end of 1.5 m by 8 mm; by eight draws it is 0.002 to 0.006."""
    for seed in range(4):
        start = resting(5e-4, rate_hz, seed).start(0, 20)
        assert np.abs(start.velocity_m_s).max() < 0.012
        assert start.settle


def test_a_start_in_motion_keeps_its_velocity():
    series = resting(5e-4)
    frame = int(np.searchsorted(series.time_s, 1.5))
    start = series.start(frame, 20)
    np.testing.assert_allclose(start.velocity_m_s[-1], [1.0, 0.0, 0.0], atol=0.05)


def test_markers_side_by_side_make_a_small_kink():
    """Two markers 5 mm apart, each 2 mm to another side of a straight string of 0.5 m.

    A curve through them bends twice as sharply.
    """
    places, beside = np.array([0.0, 0.3, 0.31, 0.6, 1.0]), np.array([0.0, 0.002, -0.002, 0.0, 0.0])
    through = CubicSpline(places, beside, bc_type="natural")(np.linspace(0.0, 1.0, 21))
    shape = smoothest(places, 20, two_ends=False) @ beside
    assert np.abs(np.diff(shape, 2)).max() < 0.6 * np.abs(np.diff(through, 2)).max()


def test_a_smooth_shape_is_kept():
    along = np.linspace(0.0, 1.0, 21)
    arc = np.column_stack([np.sin(1.5 * along), np.cos(1.5 * along) - 1.0]) / 1.5
    places = along[[0, 3, 7, 10, 14, 17, 20]]
    for two_ends in (False, True):
        shape = smoothest(places, 20, two_ends) @ arc[[0, 3, 7, 10, 14, 17, 20]]
        np.testing.assert_allclose(shape, arc, atol=0.01 if two_ends is False else 0.004)


def test_a_capture_in_the_plane_starts_as_in_space():
    time_s = np.arange(0.0, 1.5, 0.01)
    place = np.column_stack([0.2 * np.sin(3.0 * time_s), np.zeros_like(time_s)])
    path = strandcast.simulate(time_s, place, length_m=0.5, direction=np.array([0.0, -1.0]), points=20)
    points_m = np.full_like(path, np.nan)
    seen = [0, 5, 10, 15, 20]
    points_m[:, seen] = path[:, seen]
    pose = np.column_stack([place, np.full(len(time_s), -0.5 * np.pi)])
    later = slice(88, None)  # recorded in motion
    throw = Throw(time_s[later], points_m[later], time_s, pose, np.ones(len(time_s[later]), dtype=bool))
    start = observed_start(throw, np.linspace(0.0, 0.5, 21), 0.905)
    rate = (path[91, 1:] - path[90, 1:]) / 0.01
    np.testing.assert_allclose(start.points_m, 0.5 * (path[90, 1:] + path[91, 1:]), atol=2e-3)
    assert np.sqrt(np.mean((start.velocity_m_s - rate) ** 2)) < 0.12  # of 0.5 m/s
