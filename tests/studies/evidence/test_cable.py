"""A cable simulated as a string: masses, statics, delay of the hand, dry friction."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast_studies.evidence import cable
from strandcast_studies.evidence.cable import Series, play

LENGTH_M, CABLE_KG, FITTING_KG = 0.6, 0.6, 0.03
STIFF = {"log_stiffness": np.log(0.15), "log_damping": np.log(0.02)}


def hanging(duration_s: float, hand=None) -> Series:
    """Return a straight cable at rest under a hand that moves by `hand` (time to x) or not at all."""
    time_s = np.arange(0.0, duration_s, 1 / 30)
    n = cable.points_of(LENGTH_M)
    pose = np.zeros((len(time_s), 3))
    pose[:, 2] = -0.5 * np.pi
    if hand is not None:
        pose[:, 0] = hand(time_s)
    start = np.column_stack([np.full(n, pose[0, 0]), -np.arange(1, n + 1) * LENGTH_M / n])
    markers = np.zeros((len(time_s), 2, 2))
    return Series("cable", "made", LENGTH_M, CABLE_KG, FITTING_KG, time_s, pose, markers, start, 0.0 * start)


def pushed(duration_s: float) -> Series:
    """Return a hanging cable that turns about the hand at 1 rad/s."""
    series = hanging(duration_s)
    return replace(series, start_velocity_m_s=series.start_m[:, ::-1] * [-1.0, 0.0])


def test_mass_and_first_moment_equal_those_of_cable_fitting_and_weight():
    series, weight_kg = hanging(0.1), 0.2
    masses = cable._masses(series, np.array([weight_kg]))[0]
    place_m = LENGTH_M / series.points * np.arange(1, len(masses) + 1)
    on_the_hand_kg = 0.5 * CABLE_KG / series.points
    assert masses.sum() + on_the_hand_kg == pytest.approx(CABLE_KG + FITTING_KG + weight_kg)
    moment = CABLE_KG * LENGTH_M / 2 + (FITTING_KG + weight_kg) * LENGTH_M
    assert masses @ place_m == pytest.approx(moment)


def test_a_clamped_cable_bends_under_its_weight_as_a_cantilever_does():
    """Nearly level and stiff: the sag of the end is w L^4 / (8 EI) + F L^3 / (3 EI)."""
    series = hanging(4.0)
    n = series.points
    level = np.column_stack([np.arange(1, n + 1) * LENGTH_M / n, np.zeros(n)])
    pose = np.zeros_like(series.hand_pose)
    series = replace(series, hand_pose=pose, start_m=level)
    stiffness = 12.0
    simulated = play(series, {"log_stiffness": np.log(stiffness), "log_damping": np.log(2.0)})[0]
    weight_n = 9.81 * CABLE_KG
    sag_m = weight_n * LENGTH_M**3 / (8 * stiffness) + 9.81 * FITTING_KG * LENGTH_M**3 / (3 * stiffness)
    assert -simulated[-1, 1, 1] == pytest.approx(sag_m, rel=0.02)


def test_delaying_the_hand_equals_moving_it_later():
    def hand(time_s):
        return 0.05 * np.sin(2 * np.pi * np.clip(time_s - 0.3, 0.0, 1.0))

    series = hanging(1.2, hand)
    later = play(hanging(1.2, lambda time_s: hand(time_s - 0.1)), STIFF)[0, :, 1]
    assert play(series, STIFF | {"delay_s": 0.1})[0, :, 1] == pytest.approx(later, abs=1e-3)
    assert np.abs(play(series, STIFF)[0, :, 1] - later).max() > 0.01


def test_dry_friction_stops_a_swing_that_damping_does_not():
    damped = {"log_stiffness": np.log(0.15), "log_damping": np.log(0.001)}
    with_friction = damped | {"log_friction": np.log(0.1)}
    last_second = slice(-30, None)
    assert np.ptp(play(pushed(4.0), damped)[0, last_second, 1, 0]) > 0.05
    assert np.ptp(play(pushed(4.0), with_friction)[0, last_second, 1, 0]) < 0.005
