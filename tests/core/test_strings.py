"""Batches of strings: numbers that follow from their fields."""

import numpy as np

from strandcast.core.strings import TAPER, StringBatch


def test_taper_multiplies_bending_from_joint_to_joint():
    strings = StringBatch(
        np.ones((2, 10)),
        np.ones((2, 3)),
        bend_factor=np.array([[1.0, 1.0, 5.0]] * 2),
        taper=np.array([0.0, np.log(4.0)]),
    )
    np.testing.assert_allclose(strings.bend_factors(), [[1.0, 1.0, 5.0], [0.5, 1.0, 10.0]])
    again = StringBatch.from_options(
        strings.parameters, strings.masses, strings.free_masses, strings.options(), np.zeros(3, dtype=bool)
    )
    np.testing.assert_allclose(again.taper, strings.options()[TAPER])
