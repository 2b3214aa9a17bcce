"""Short gaps in time are bridged by a cubic, and places that contradict it are replaced, if doubtful."""

import numpy as np
import pytest

from strandcast.records.track import PREDICTED, UNSURE
from strandcast.tracking.chain.bridge import LONGEST_BRIDGE, bridge_points

TIME_S = np.arange(40) / 500.0


@pytest.fixture
def track():
    x_m = 2.0 * TIME_S + 40.0 * TIME_S**2
    points_m = np.stack([np.column_stack([x_m, 0.5 * x_m])] * 2, axis=1)
    return points_m, np.full((40, 2), 2e-4), np.zeros((40, 2), np.int32)


def test_a_gap_is_filled_and_flagged(track):
    true_m, sigma_m, flags = track
    points_m = true_m.copy()
    points_m[10:14, 1] = np.nan
    sigma_m[14, 1] = 2e-3  # a neighbour's
    bridged_m, bridged_sigma_m, bridged_flags = bridge_points(TIME_S, points_m, sigma_m, flags)
    np.testing.assert_allclose(bridged_m, true_m, atol=1e-12)
    assert (bridged_flags[10:14, 1] == PREDICTED).all()
    assert (bridged_flags != 0).sum() == 4
    assert (bridged_sigma_m[10:14, 1] > 2e-3).all()
    assert np.isnan(points_m[10:14, 1]).all()


def test_a_long_gap_and_the_ends_stay_open(track):
    points_m, sigma_m, flags = track
    points_m[5 : 6 + LONGEST_BRIDGE, 0] = np.nan
    points_m[:1, 1] = points_m[-1:, 1] = np.nan
    bridged_m, _, _ = bridge_points(TIME_S, points_m, sigma_m, flags)
    np.testing.assert_array_equal(bridged_m, points_m)


def test_a_doubtful_place_is_replaced_only_where_its_neighbours_contradict_it(track):
    true_m, sigma_m, flags = track
    points_m = true_m.copy()
    points_m[10, 0, 1] += 0.02
    flags[[10, 20], 0] = UNSURE
    points_m[30, 0, 1] += 0.02  # without a flag, it is believed
    bridged_m, _, bridged_flags = bridge_points(TIME_S, points_m, sigma_m, flags)
    np.testing.assert_allclose(bridged_m[:25], true_m[:25], atol=1e-12)
    assert bridged_flags[10, 0] == PREDICTED
    assert bridged_flags[20, 0] == UNSURE
    assert bridged_m[30, 0, 1] == points_m[30, 0, 1]
