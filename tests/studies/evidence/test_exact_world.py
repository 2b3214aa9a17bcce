"""The exact world: nothing but noise lies between a throw and the string that made it."""

import numpy as np
import pytest

from strandcast_studies.evidence.exact_world import cases
from strandcast_studies.evidence.lab_throws import TRACKED_M


@pytest.mark.thorough
def test_the_true_string_leaves_nothing_but_the_noise():
    name, objective, truth = next(cases())
    assert name == "paper-1.1.1"
    difference, weight = objective.residuals(truth)
    rms_m = np.sqrt((weight[:, None] * difference[0] ** 2).sum() / (2.0 * weight.sum()))
    assert rms_m == pytest.approx(TRACKED_M, rel=0.1)
    assert objective.cost(np.clip(truth + 0.05, 0.0, 1.0))[0] > 1.5 * objective.cost(truth)[0]
