"""The acceleration gate flags a place to which its neighbours in time do not lead, but not a fast one."""

import numpy as np

from strandcast.records.track import UNSURE
from strandcast.tracking.chain.point_uncertainty import gate_accelerations


def gate(points, interval_s):
    return gate_accelerations(points, np.full((9, 2), 3e-4), np.zeros((9, 2), np.int32), interval_s)


def test_one_wrong_frame_is_flagged_and_a_fast_tip_is_not():
    points = np.zeros((9, 2, 2))
    points[:, 1, 0] = 0.02 * np.arange(9)  # 10 m/s at 500 Hz
    points[4, 0, 1] = 0.017
    points[7, 1] = np.nan
    sigma, flags = gate(points, 0.002)
    np.testing.assert_array_equal(flags[:, 0], UNSURE * np.array([0, 0, 0, 1, 1, 1, 0, 0, 0]))
    assert not flags[:, 1].any()
    assert sigma[4, 0] == 0.003


def test_the_same_step_is_a_larger_acceleration_at_a_higher_rate():
    points = np.zeros((9, 2, 2))
    points[4, 1, 0] = 0.01
    for interval_s, flagged in ((1 / 240, False), (1 / 1000, True)):
        _, flags = gate(points, interval_s)
        assert flags[4, 1].any() == flagged


def test_a_wrong_place_next_to_a_gap_is_flagged():
    points = np.zeros((9, 2, 2))
    points[4, 1, 0] = 0.03
    points[5:7, 1] = np.nan
    points[7, 1, 0] = -0.03
    _, flags = gate(points, 0.002)
    assert flags[4, 1] == UNSURE
    assert not flags[:, 0].any()
