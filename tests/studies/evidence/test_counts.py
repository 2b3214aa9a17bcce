"""Counts of recordings: none of those that are held out is fitted."""

import numpy as np

from strandcast_studies.evidence import counts


def test_pieces_of_both_motions_are_fitted_and_others_held_out(real_data):
    cable = counts.single_ended(real_data / "pac_cable", "black_weighted")
    fitted, held_out = ([next(iter(each.values())) for each in some] for some in cable[2:])
    assert len(fitted) == max(counts.COUNTS)
    assert len(held_out) == 2
    for other in held_out:
        assert not any(np.array_equal(each.vertices_m, other.vertices_m) for each in fitted)
    assert all(each.vertices_m.shape[1:] == (2, 3) for each in (*fitted, *held_out))
