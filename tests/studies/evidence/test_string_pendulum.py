"""Pendulums against the elliptic integral, and real ones with length and drag from other data."""

import numpy as np
import pytest
from scipy.special import ellipk

from strandcast_studies.evidence import string_pendulum as pendulum

TIME_S = np.arange(0.0, 40.0, 1 / 30)


def test_a_large_swing_has_the_period_of_the_elliptic_integral():
    angle = pendulum.swing(np.array([1.2, 0.6, 0.0, 0.0]), np.array([1e-9, 1e-9]), TIME_S)
    exact_s = 4.0 * np.sqrt(1.2 / pendulum.GRAVITY_M_S2) * ellipk(np.sin(0.3) ** 2)
    assert pendulum.period_s(TIME_S, angle) == pytest.approx(exact_s, rel=1e-4)


def test_amplitude_decays_at_half_the_linear_drag_per_mass():
    angle = pendulum.swing(np.array([1.0, 0.1, 0.0, 0.02]), np.array([0.04, 1e-9]), TIME_S)
    amplitude = [pendulum.amplitude_rad(TIME_S, angle, at_s, 2.007) for at_s in (5.0, 35.0)]
    assert amplitude[1] / amplitude[0] == pytest.approx(np.exp(-0.5 * 0.04 * 30.0), rel=2e-3)


def test_length_and_tilt_are_found():
    truth = np.array([0.95, 0.28, -0.1, 0.01])
    measured = pendulum.PendulumSwing(TIME_S, pendulum.swing(truth, np.array([1e-9, 0.02]), TIME_S))
    assert pendulum.fit_state(measured.until(10.0), np.array([1e-9, 0.02])) == pytest.approx(truth, abs=1e-4)


def test_drag_of_one_file_predicts_the_swing_of_another(real_data):
    source, other = (
        pendulum.read(real_data / "string_pendulum" / f"{name}.csv") for name in ("8051", "8047")
    )
    drag, rms_rad = pendulum.fit_drag(source, (True, True))
    assert rms_rad < 2e-3
    state = pendulum.fit_state(other.until(pendulum.FIT_S), drag)
    period, amplitude = pendulum.errors_percent(other, state, drag)
    assert abs(period) < 0.05
    assert abs(amplitude) < 5.0
    assert abs(pendulum.errors_percent(other, state, np.array([1e-9, 1e-9]))[1]) > 40.0
