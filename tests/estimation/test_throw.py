"""Where a throw begins, and the shape with which the string starts."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.estimation.measured import Throw, motion_start_s, observed_start, prepare

from .motion_capture import throw_from_markers

PLACES = np.linspace(0.0, 0.3, 11)
TIME_S = np.arange(0.0, 0.6, 0.002)


def swaying(rate=0.08, moves_s=0.3, noise=0.0):
    """A straight string turning slowly about a hand that jerks sideways at `moves_s`."""
    pose = np.zeros((len(TIME_S), 3))
    pose[:, 0] = np.clip(TIME_S - moves_s, 0.0, None) ** 2 * 20.0
    pose[:, 2] = -np.pi / 2
    angle = -np.pi / 2 + 0.02 + rate * (TIME_S - moves_s)
    points = pose[:, None, :2] + PLACES[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, None]
    points += noise * np.random.default_rng(0).standard_normal(points.shape)
    return Throw(TIME_S, points, TIME_S, pose, TIME_S < 0.5)


def test_starts_shortly_before_the_hand_moves():
    prepared = prepare(swaying(), PLACES)
    moved_s = 0.3 + np.sqrt(0.002 / 20.0)
    assert prepared.time_s[0] == pytest.approx(moved_s - 0.03, abs=0.004)
    assert prepared.hand.time_s[0] == prepared.time_s[0]
    assert prepared.weight.any(axis=1).sum() == np.sum(prepared.time_s < 0.5)
    assert prepare(swaying(), PLACES, "hanging").start.points_m is None


@pytest.mark.parametrize(("noise", "tolerance"), [(0.0, 2e-5), (0.0007, 6e-4)])
def test_observed_start_has_the_shape_and_the_sway(noise, tolerance):
    prepared = prepare(swaying(noise=noise), PLACES)
    angle = -np.pi / 2 + 0.02 + 0.08 * (prepared.time_s[0] - 0.3)
    truth = PLACES[1:, None] * [np.cos(angle), np.sin(angle)]
    across = 0.08 * PLACES[1:, None] * [-np.sin(angle), np.cos(angle)]
    assert np.abs(prepared.start.points_m - truth).max() < tolerance
    np.testing.assert_allclose(prepared.start.velocity_m_s, across, atol=max(1e-4, 12 * noise))


def test_the_shape_may_begin_at_the_hand_as_seen():
    straight = prepare(swaying(), PLACES)
    throw = swaying()
    off = replace(throw, points_m=throw.points_m + np.array([0.02, -0.01]))
    moved_m = prepare(off, PLACES).start.points_m - straight.start.points_m
    np.testing.assert_allclose(moved_m, [[0.02, -0.01]] * 10, atol=3e-4)
    again = prepare(off, PLACES, from_measured_hand=True)
    np.testing.assert_allclose(again.start.points_m, straight.start.points_m, atol=1e-12)
    np.testing.assert_array_equal(again.points_m, prepare(off, PLACES).points_m)


def test_a_string_that_moves_first_is_not_cut():
    throw = swaying(rate=1.0)
    assert motion_start_s(throw) < 0.05
    velocity = prepare(throw, PLACES).start.velocity_m_s
    assert np.linalg.norm(velocity[-1]) == pytest.approx(0.3, rel=0.05)


@pytest.mark.parametrize(("seen", "off_m"), [([5, 10], 3e-3), ([1, 2, 3, 5, 6, 7, 8, 9, 10], 1e-3)])
def test_points_not_seen_lie_on_the_curve_of_the_others(seen, off_m):
    bend = -np.pi / 2 + 2.0 * PLACES
    shape = np.cumsum(np.column_stack([np.cos(bend), np.sin(bend)]) * 0.03, axis=0)
    shape -= shape[0]
    time = np.arange(0.0, 0.4, 0.02)
    pose = np.tile([0.0, 0.0, -np.pi / 2], (len(time), 1))
    pose[:, 0] = 0.3 * time
    markers = {PLACES[k]: shape[k] + pose[:, :2] for k in seen}
    throw = throw_from_markers(time, pose, markers, 0.3, 10)
    assert np.isnan(throw.points_m).any()
    start = observed_start(throw, PLACES, 0.04)
    assert np.abs(start.points_m - [0.3 * 0.04, 0.0] - shape[1:]).max() < off_m
    np.testing.assert_allclose(start.velocity_m_s, [[0.3, 0.0]] * 10, atol=1e-3)


def test_no_used_frame_is_an_error():
    throw = swaying()
    with pytest.raises(StrandcastError, match="SC-E002"):
        prepare(Throw(throw.time_s, throw.points_m, throw.hand_time_s, throw.hand_pose, TIME_S < 0), PLACES)


def test_parts_of_a_throw_are_spans_of_its_used_frames():
    prepared = prepare(swaying(), PLACES)
    parts = [prepared.part(k, 4) for k in range(4)]
    np.testing.assert_array_equal(sum(part.weight for part in parts), prepared.weight)
    used = [np.flatnonzero(part.weight.any(axis=1)) for part in parts]
    assert all(np.all(np.diff(span) == 1) for span in used)
    assert used[0][-1] + 1 == used[1][0]
    thin = prepared.thinned(40)
    assert 30 < len(thin.time_s) <= 40
    assert np.all(np.isin(thin.time_s, prepared.time_s))
    assert thin.weight.shape == (len(thin.time_s), 10)
