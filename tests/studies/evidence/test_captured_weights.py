"""Weights of known mass in captures: a drawn one is within its interval, as one of a real cable is."""

import json

import numpy as np
import pytest

from strandcast_studies.evidence import captured_weights


def test_drawn_recordings_are_of_a_string_that_hangs_at_first():
    capture, recordings = captured_weights.drawn(201, 3)
    for _, hand_m, direction, seen in recordings:
        assert seen.shape[1:] == (len(capture.places), 3)
        off_m = np.nanmedian(seen[:10, -1] - hand_m[:10], axis=0) - capture.true["length_m"] * direction[0]
        assert np.linalg.norm(off_m) < 0.3 * capture.true["length_m"]
    assert len(recordings) == len(capture.true["motions"])


@pytest.mark.thorough
def test_a_drawn_weight_is_within_its_interval(capsys):
    captured_weights.main(["--seeds", "201"])
    for line in capsys.readouterr().out.splitlines():
        row = json.loads(line)
        low, high = row["interval_kg"]
        assert low < row["weight_kg"] < high


@pytest.mark.thorough
def test_the_weight_of_a_real_cable_is_within_its_interval(real_data):
    figure = captured_weights._cable(real_data / "pac_cable", "black_weighted", 1)
    low, high = figure.detail["interval_kg"]
    assert (low or 0.0) < figure.detail["true_kg"] < (high or np.inf)
