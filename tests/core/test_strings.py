"""Batches of strings: numbers that follow from their fields."""

import numpy as np

from strandcast.core.strings import TAPER, StringBatch


def test_taper_multiplies_bending_from_joint_to_joint():
    strings = StringBatch(
        np.ones((2, 10)),
        np.ones((2, 3)),
        {TAPER: np.array([0.0, np.log(4.0)])},
        bend_factor=np.array([[1.0, 1.0, 5.0]] * 2),
    )
    np.testing.assert_allclose(strings.applied().bend_factor, [[1.0, 1.0, 5.0], [0.5, 1.0, 10.0]])
    again = StringBatch(strings.parameters, strings.masses, strings.options())
    np.testing.assert_allclose(again[TAPER], strings.options()[TAPER])
