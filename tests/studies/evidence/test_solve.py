"""Least squares with a Jacobian from one batch."""

import numpy as np
import pytest

from strandcast_studies.evidence.solve import FreeParameter, solve


def decay(candidates):
    time_s = np.linspace(0.0, 3.0, 40)
    return candidates[:, :1] * np.exp(-candidates[:, 1:] * time_s) - 2.0 * np.exp(-0.7 * time_s)


def test_a_decay_is_fitted():
    found = solve(
        decay, [FreeParameter("height", 1.0, 0.0, 5.0, 1e-4), FreeParameter("rate", 0.1, 0.0, 5.0, 1e-4)]
    )
    assert found.values == pytest.approx([2.0, 0.7], abs=1e-4)
    assert found.sum_of_squares < 1e-8


def test_bounds_are_kept():
    found = solve(
        decay, [FreeParameter("height", 1.0, 0.0, 1.5, 1e-4), FreeParameter("rate", 0.1, 0.0, 5.0, 1e-4)]
    )
    assert found.values[0] == pytest.approx(1.5, abs=1e-3)
    assert found.sum_of_squares == pytest.approx(float(np.sum(found.residuals**2)))


def test_failed_simulations_are_avoided():
    def residuals(candidates):
        return np.where(candidates < 0.5, np.nan, candidates - 0.8)

    assert solve(residuals, [FreeParameter("x", 0.9, 0.0, 1.0, 1e-4)]).values == pytest.approx(
        [0.8], abs=1e-4
    )
