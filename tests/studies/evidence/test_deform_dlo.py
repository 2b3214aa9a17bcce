"""Cables driven at both ends in space: baselines, and the fitted string on real data."""

import numpy as np
import pytest

from strandcast_studies.evidence import deform_dlo


def translated(frames: int = 20) -> np.ndarray:
    rng = np.random.default_rng(3)
    cable = np.cumsum(rng.uniform(0.02, 0.1, (13, 3)), axis=0)
    return np.stack([cable + k * np.array([1e-3, -2e-3, 5e-4]) for k in range(frames)])[None]


def test_carried_is_exact_for_a_cable_moved_as_a_whole():
    moved = translated()
    assert max(deform_dlo.errors_m(deform_dlo.carried, moved)) < 1e-9
    coordinate_m = 9.5 * (1e-3 + 2e-3 + 5e-4) / 3 * 9 / 13
    distance_m = 9.5 * np.linalg.norm([1e-3, 2e-3, 5e-4])
    assert deform_dlo.errors_m(deform_dlo.held, moved) == pytest.approx((coordinate_m, distance_m))


def test_a_glitch_is_not_counted():
    jumping = translated()
    jumping[0, 7, 5] += 0.3
    assert max(deform_dlo.errors_m(deform_dlo.carried, jumping)) < 1e-9


@pytest.mark.slow
def test_fitted_string_on_real_data(real_data):
    figures = {f.name: f for f in deform_dlo.measure(real_data / "deform_dlo")}
    name = "deform_dlo.coordinate.{}.{}".format
    assert figures[name("DLO1", "carried_by_the_ends")].value == pytest.approx(33.1, abs=0.2)
    assert figures[name("DLO1", "shape_held")].value == pytest.approx(56.6, abs=0.2)
    assert figures[name("DLO1", "string")].value < 9.9
    assert figures[name("DLO4", "string")].value < 5.5
    assert len(figures[name("DLO4", "string")].detail["unknowns"]) <= 10
