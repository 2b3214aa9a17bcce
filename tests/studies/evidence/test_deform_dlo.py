"""Baselines for cables driven at both ends in space."""

import numpy as np
import pytest

from strandcast_studies.evidence import deform_dlo


def translated(frames: int = 20) -> np.ndarray:
    rng = np.random.default_rng(3)
    cable = np.cumsum(rng.uniform(0.02, 0.1, (13, 3)), axis=0)
    return np.stack([cable + k * np.array([1e-3, -2e-3, 5e-4]) for k in range(frames)])[None]


def test_carried_is_exact_for_a_cable_moved_as_a_whole():
    moved = translated()
    assert deform_dlo.mean_error_m(deform_dlo.carried, moved) < 1e-9
    expected_m = 9.5 * (1e-3 + 2e-3 + 5e-4) / 3
    assert deform_dlo.mean_error_m(deform_dlo.held, moved) == pytest.approx(expected_m)


def test_a_glitch_is_not_counted():
    jumping = translated()
    jumping[0, 7, 5] += 0.3
    assert deform_dlo.mean_error_m(deform_dlo.carried, jumping) < 1e-9


def test_baselines_on_real_data(real_data):
    figures = {f.name: f.value for f in deform_dlo.measure(real_data / "deform_dlo")}
    assert figures["deform_dlo.coordinate.DLO1.carried_by_the_ends"] == pytest.approx(47.8, abs=0.2)
    assert figures["deform_dlo.coordinate.DLO1.shape_held"] == pytest.approx(81.7, abs=0.2)
