"""The string against an independent integration and against analysis."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
from scipy.special import ellipk

from strandcast.string.integrators import BLEW_UP, OK, OVERSTRETCHED
from strandcast.string.model import StringModel
from strandcast.string.parameters import minima
from strandcast.string.simulate import simulate, simulate_batch, start_shape

_spec = importlib.util.spec_from_file_location("string_reference", Path(__file__).with_name("reference.py"))
assert _spec is not None
assert _spec.loader is not None
reference = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(reference)

MODEL = StringModel(length_m=0.2, points=5)
MASSES = np.array([1.0, 1.0, 3.0, 1.0, 8.0])
GROWING_STIFF = np.array([2e4, 5.0, 0.5, 0.02, 0.2, 0.01, 0.1, 0.3, 2.0, 0.02])
STRAIGHTENING_STIFF = np.array([2e4, 5.0, 0.2, 0.02, 0.5, 0.1, 0.1, 0.3, 2.0, 0.02])
TIME_S = np.arange(0.0, 0.4001, 0.0005)
OUT_S = np.linspace(0.0, 0.4, 41)
FREE = np.array([1e7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def swing(t):
    pose = np.array([0.1 * np.sin(6 * t) ** 2, 0.05 * np.sin(4 * t) ** 2, -1.2 + np.sin(5 * t) ** 2])
    return pose, np.array([0.6 * np.sin(12 * t), 0.2 * np.sin(8 * t), 5.0 * np.sin(10 * t)])


POSE = np.array([swing(t)[0] for t in TIME_S])
STILL = np.tile([0.0, 0.0, -np.pi / 2], (2, 1))


def error_m(model, parameters, truth, start):
    seen, status = simulate(model, parameters, MASSES, TIME_S, POSE, OUT_S, start, respace=False)
    assert status == OK
    return np.sqrt(((seen[:, 1:] - truth) ** 2).sum(-1).mean())


@pytest.mark.parametrize("parameters", [GROWING_STIFF, STRAIGHTENING_STIFF], ids=["h", "sh"])
@pytest.mark.parametrize("reading", ["rate", "sign", "strain"])
def test_agrees_with_an_independent_integration_to_second_order(reading, parameters):
    model = replace(MODEL, reading=reading, rest_curl_rad_m=2.0)
    start = start_shape(model, parameters, MASSES, POSE[0])[1:]
    truth = reference.integrate(
        swing, start, parameters, MASSES, model.spacing_m, reading, model.switch(), OUT_S, curl=2.0
    )
    assert np.ptp(truth[:, -1, 0]) > 0.1  # the tip does travel
    fine, finer = (error_m(replace(model, dt_s=dt), parameters, truth, start) for dt in (1e-3, 5e-4))
    assert fine < 3e-6
    assert 3.0 < fine / finer < 5.5
    semi_implicit = replace(model, integrator="semi_implicit", dt_s=1e-4)
    assert error_m(semi_implicit, parameters, truth, start) < 1e-5


@pytest.mark.parametrize("reading", ["rate", "sign", "strain"])
def test_rests_where_the_forces_balance(reading):
    pose = np.array([0.3, 0.2, 0.4])
    model = replace(MODEL, reading=reading, rest_curl_rad_m=-1.5)
    points = start_shape(model, GROWING_STIFF, MASSES, pose)
    left = reference.accelerations(
        points, np.zeros((6, 2)), pose[2], 0.0, GROWING_STIFF, MASSES, 0.04, reading, model.switch(), -1.5
    )
    assert np.abs(left).max() < 1e-9
    assert np.degrees(np.arctan2(*np.diff(points, axis=0)[0][::-1])) > -89.0  # the clamp bends it


def test_hangs_with_the_stretch_of_the_weight_below():
    points = start_shape(MODEL, GROWING_STIFF, MASSES, STILL[0])
    below = np.cumsum(MASSES[::-1])[::-1]
    np.testing.assert_allclose(-np.diff(points[:, 1]), 0.04 + below * 9.81 / 2e4, rtol=1e-12)


@pytest.mark.parametrize("amplitude", [0.05, 1.5])
def test_one_point_is_a_pendulum(amplitude):
    model = StringModel(length_m=0.3, points=1)
    period = 4 * np.sqrt(0.3 / 9.81) * ellipk(np.sin(amplitude / 2) ** 2)
    start = 0.3 * np.array([[np.sin(amplitude), -np.cos(amplitude)]])
    times = np.array([period / 4, period / 2, period])
    seen, _ = simulate(model, FREE, np.ones(1), np.array([0, 2.0]), STILL, times, start, respace=False)
    angle = np.arctan2(seen[:, 1, 0], -seen[:, 1, 1])
    np.testing.assert_allclose(angle, [0.0, -amplitude, amplitude], atol=2e-4 * amplitude + 1e-5)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_hanging_chain_swings_in_its_modes(mode):
    n, spacing, masses = 8, 0.05, np.r_[np.ones(7), 5.0]
    tension = np.cumsum(masses[::-1])[::-1] * 9.81
    below = np.r_[tension[1:], 0.0]
    stiffness = (np.diag(tension + below) - np.diag(tension[1:], 1) - np.diag(tension[1:], -1)) / spacing
    square, shapes = np.linalg.eigh(stiffness / np.sqrt(np.outer(masses, masses)))
    shape = shapes[:, mode] / np.sqrt(masses)
    shape *= 1e-3 / np.abs(shape).max()
    start = np.column_stack([shape, -spacing * np.arange(1, n + 1)])
    half = np.pi / np.sqrt(square[mode])
    model = StringModel(length_m=0.4, points=n, dt_s=5e-4)
    seen, _ = simulate(model, FREE, masses, np.array([0, 9.0]), STILL, np.array([half / 2, half]), start)
    np.testing.assert_allclose(seen[:, 1:, 0], np.outer([0.0, -1.0], shape), atol=1.5e-5)


def test_energy_stays_without_dampers():
    parameters = np.array([2e5, 0.0, 0.3, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    model = replace(MODEL, dt_s=2.5e-4)
    start = np.cumsum(
        0.04 * np.array([[np.cos(a), np.sin(a)] for a in (0.2, -0.1, -0.5, -0.9, -1.2)]), axis=0
    )
    times = np.arange(0.0, 1.0, 2.5e-4)
    x, _ = simulate(model, parameters, MASSES, np.array([0, 2.0]), STILL, times, start, respace=False)
    v = (x[2:] - x[:-2]) / 5e-4
    x = x[1:-1]
    d = np.diff(x, axis=1)
    bend = np.diff(np.unwrap(np.arctan2(d[..., 1], d[..., 0]), axis=1), axis=1)
    stretch = np.linalg.norm(d, axis=2) - 0.04
    kinetic = 0.5 * (v[:, 1:] ** 2).sum(-1) @ MASSES
    energy = kinetic + 9.81 * x[:, 1:, 1] @ MASSES + 1e5 * (stretch**2).sum(1) + 0.15 * (bend**2).sum(1)
    assert kinetic.max() > 5.0
    assert np.ptp(energy) < 0.01 * kinetic.max()


@pytest.mark.parametrize("reading", ["rate", "sign", "strain"])
def test_scaling_masses_and_coefficients_changes_nothing(reading):
    model = replace(MODEL, reading=reading)
    one, _ = simulate(model, GROWING_STIFF, MASSES, TIME_S, POSE, OUT_S)
    seven, _ = simulate(model, 7 * GROWING_STIFF, 7 * MASSES, TIME_S, POSE, OUT_S)
    np.testing.assert_allclose(seven, one, atol=1e-9)


@pytest.mark.parametrize("reading", ["rate", "sign", "strain"])
def test_mirrored_hand_gives_the_mirrored_string(reading):
    model = replace(MODEL, reading=reading)
    swapped = GROWING_STIFF[[0, 1, 4, 5, 2, 3, 6, 7, 8, 9]] if reading == "sign" else GROWING_STIFF
    mirrored = POSE * [-1.0, 1.0, -1.0] + [0.0, 0.0, np.pi]
    left, _ = simulate(model, GROWING_STIFF, MASSES, TIME_S, POSE, OUT_S)
    right, _ = simulate(model, swapped, MASSES, TIME_S, mirrored, OUT_S)
    np.testing.assert_allclose(right * [-1.0, 1.0], left, atol=1e-7)


def test_same_bytes_on_one_thread_and_in_any_batch():
    rng = np.random.default_rng(1)
    parameters = GROWING_STIFF * rng.uniform(0.5, 2.0, (7, 10))
    masses = np.tile(MASSES, (7, 1))
    batch, status = simulate_batch(MODEL, parameters, masses, TIME_S, POSE, OUT_S)
    numba.set_num_threads(1)
    try:
        single, _ = simulate_batch(MODEL, parameters, masses, TIME_S, POSE, OUT_S)
    finally:
        numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    assert batch.tobytes() == single.tobytes()
    alone, _ = simulate(MODEL, parameters[3], MASSES, TIME_S, POSE, OUT_S)
    assert alone.tobytes() == batch[3].tobytes()
    each, _ = simulate_batch(MODEL, parameters, masses, TIME_S, np.tile(POSE, (7, 1, 1)), OUT_S)
    assert each.tobytes() == batch.tobytes()
    assert set(status) == {OK}


def test_what_goes_wrong_is_a_status():
    stiff = np.where(np.arange(10) == 0, 1e6, GROWING_STIFF)
    seen, status = simulate(replace(MODEL, integrator="euler"), stiff, MASSES, TIME_S, POSE, OUT_S)
    assert status == BLEW_UP
    assert np.isfinite(seen[0]).all()
    assert np.isnan(seen[-1]).all()
    _, status = simulate(MODEL, np.full(10, np.nan), MASSES, TIME_S, POSE, OUT_S)
    assert status == BLEW_UP
    ten = StringModel(0.3, 10)
    _, status = simulate(ten, minima().parameters[0], np.ones(10), TIME_S, POSE, OUT_S)
    assert status == OVERSTRETCHED


def test_stiff_corners_stay_finite():
    corner = np.array([1e8, 1e3, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0])
    cable = np.array([1e6, 100.0, 1e3, 10.0, 1e3, 10.0, 0.1, 0.1, 1e3, 10.0])
    for parameters in (corner, cable):
        seen, status = simulate(MODEL, parameters, MASSES, TIME_S, POSE, OUT_S)
        assert status == OK
        reach = np.linalg.norm(seen[:, -1] - seen[:, 0], axis=1)
        assert reach.max() < 0.202


def test_hand_path_between_samples_is_cubic():
    coarse = np.arange(0.0, 0.4001, 0.01)
    finer, _ = simulate(MODEL, GROWING_STIFF, MASSES, TIME_S, POSE, OUT_S)
    seen, _ = simulate(MODEL, GROWING_STIFF, MASSES, coarse, np.array([swing(t)[0] for t in coarse]), OUT_S)
    assert np.abs(seen - finer).max() < 3e-5
