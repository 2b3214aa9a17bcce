"""The weight at a cable's end, from simulated and from real swings."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast_studies.evidence import pac_cable, pac_mass
from strandcast_studies.evidence.cable import play


@pytest.fixture
def simulated(real_data):
    """Joint fit of the short pair, its markers replaced by a simulation of known weight and noise of 2 mm."""
    problem = pac_mass.joint_fit(real_data / "pac_cable", pac_cable.PAIRS[1], (pac_cable.FREE,), "lever_m")
    truth = {
        "log_stiffness": np.log(0.12),
        "log_damping": np.log(0.01),
        "curl_rad_m": -1.5,
        "clamp_rad": 0.02,
        "log_friction": np.log(0.05),
        "log_stick": np.log(0.1),
    }
    rng = np.random.default_rng(5)
    series = []
    for one, weighted in zip(problem.series, problem.weighted, strict=True):
        markers = play(one, truth | {"weight_kg": 0.2 * weighted})[0]
        series.append(replace(one, markers_m=markers + 2e-3 * rng.standard_normal(markers.shape)))
    return replace(problem, series=series)


def test_a_known_weight_is_found_within_its_interval(simulated):
    best = simulated.solve()
    low, high = pac_mass.interval_kg(simulated, best)
    assert best.values[-1] == pytest.approx(0.2, rel=0.04)
    assert low < 0.2 < high
    assert high - low < 0.02


def test_correlation_times_of_white_and_of_slow_noise():
    rng = np.random.default_rng(1)
    white = rng.standard_normal(40000)
    slow = np.empty_like(white)
    slow[0] = white[0]
    for k in range(1, len(white)):
        slow[k] = 0.9 * slow[k - 1] + white[k]
    assert pac_mass.correlation_frames(white) < 1.2
    assert pac_mass.correlation_frames(slow) == pytest.approx(19.0, rel=0.15)  # (1 + rho) / (1 - rho)


@pytest.mark.thorough
def test_the_weight_of_the_real_cables_is_within_its_interval(real_data):
    """Without the lever the weight would be 50 % too large; the stiffness is that of both lengths."""
    folder = real_data / "pac_cable"
    problem = pac_mass.joint_fit(folder, pac_cable.CABLES, (pac_cable.FREE,))
    best = problem.solve()
    found = best.values
    low, high = pac_mass.interval_kg(problem, best)
    assert found[-1] == pytest.approx(0.2, rel=0.05)
    assert low < 0.2 < high
    assert high - low < 0.03
    sensed_n = [
        pac_mass.rest_force_n(folder, a) - pac_mass.rest_force_n(folder, b) for a, b in pac_cable.PAIRS
    ]
    assert found[-1] == pytest.approx(np.mean(sensed_n) / 9.81, rel=0.15)
    assert np.exp(found[0]) == pytest.approx(0.145, rel=0.1)


def test_the_force_sensor_measures_the_weight(real_data):
    heavy, light = (pac_mass.rest_force_n(real_data / "pac_cable", cable) for cable in pac_cable.PAIRS[0])
    assert (heavy - light) / 9.81 == pytest.approx(0.2, abs=0.03)
