"""A place that its neighbours in time do not lead to is doubted; a fast one is not."""

from __future__ import annotations

import numpy as np

from strandcast.records.track import UNSURE
from strandcast.tracking.jumps import doubt_jumps


def test_one_wrong_frame_is_doubted_and_a_fast_tip_is_not():
    points = np.zeros((9, 2, 2))
    points[:, 1, 0] = 0.02 * np.arange(9)  # 10 m/s at 500 Hz
    points[4, 0, 1] = 0.017
    points[7, 1] = np.nan
    sigma, flags = np.full((9, 2), 3e-4), np.zeros((9, 2), np.int32)
    doubt_jumps(points, sigma, flags, 0.002)
    np.testing.assert_array_equal(flags[:, 0], UNSURE * np.array([0, 0, 0, 1, 1, 1, 0, 0, 0]))
    assert not flags[:, 1].any()
    assert sigma[4, 0] == 0.003


def test_the_same_step_is_more_of_a_jump_at_a_higher_rate():
    points = np.zeros((9, 2, 2))
    points[4, 1, 0] = 0.01
    for interval_s, doubted in ((1 / 240, False), (1 / 1000, True)):
        flags = np.zeros((9, 2), np.int32)
        doubt_jumps(points, np.full((9, 2), 3e-4), flags, interval_s)
        assert flags[4, 1].any() == doubted


def test_a_wrong_place_beside_a_gap_is_doubted():
    points = np.zeros((9, 2, 2))
    points[4, 1, 0] = 0.03
    points[5:7, 1] = np.nan
    points[7, 1, 0] = -0.03
    flags = np.zeros((9, 2), np.int32)
    doubt_jumps(points, np.full((9, 2), 3e-4), flags, 0.002)
    assert flags[4, 1] == UNSURE
    assert not flags[:, 0].any()
