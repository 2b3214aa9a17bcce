"""Drawn strings in the fit's model explain their own recordings, by which others are judged."""

import numpy as np
import pytest

from strandcast.estimation.excitation import WIDER
from strandcast.estimation.fit_objective import FitObjective
from strandcast_studies.evidence.captured_weights import drawn
from strandcast_studies.evidence.left_open import advised, true_string


@pytest.mark.parametrize("axes", [2, 3], ids=["plane", "space"])
def test_the_drawn_string_explains_its_recording(axes):
    capture, (recording, *_) = drawn(404, axes)
    model, space = (problem := capture.problem([recording])).model, problem.space
    (parts, *_) = problem.parts.values()
    objective = FitObjective(model, space, parts.throws, parts.shares(1.0), "world", axes == 3)
    true = space.chi_of(true_string(capture, problem))
    lighter = true - 0.1 * (np.array(space.names) == "weight_1")
    cost_m, other_m = objective.evaluate(np.vstack([true, lighter]))
    assert cost_m < 8e-3
    assert other_m > 1.5 * cost_m


def test_an_advised_motion_is_recorded_after_a_rest():
    capture, (recording, *_) = drawn(404, 2)
    time_s, hand_m, _, _ = advised(capture, recording, "a wider motion", np.random.default_rng(1))
    assert np.ptp(hand_m[:, 0]) == pytest.approx(WIDER * np.ptp(recording[1][:, 0]), rel=0.02)
    assert np.ptp(hand_m[time_s < 0.6], axis=0).max() < 2e-3
