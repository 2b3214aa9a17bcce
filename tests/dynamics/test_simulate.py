"""What callers of the simulator rely on besides the physics: batches, statuses, paths between samples."""

import numpy as np
import pytest
from arrays import simulate, simulate_batch, start_shape
from proofs_dynamics import hand_path
from proofs_references import GROWING_STIFF, MASSES
from scipy.interpolate import CubicSpline

from strandcast.core.strings import PARAMETERS
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import minima
from strandcast.dynamics.simulate import (
    BLEW_UP,
    COLLAPSED,
    NO_REST_SHAPE,
    OK,
    OVERSTRETCHED,
    STATUS,
)
from strandcast.threads import threads

MODEL = StringModel(length_m=0.2, points=5)
TIME_S = np.arange(0.0, 0.4001, 0.0005)
OUT_S = np.linspace(0.0, 0.4, 41)
POSE = hand_path(TIME_S)


def batch_of(size):
    rng = np.random.default_rng(1)
    return GROWING_STIFF * rng.uniform(0.5, 2.0, (size, 10)), MASSES * rng.uniform(0.5, 2.0, (size, 5))


def test_same_bytes_on_one_thread_and_in_any_batch():
    parameters, masses = batch_of(21)
    batch, status = simulate_batch(MODEL, parameters, masses, TIME_S, POSE, OUT_S)
    with threads(1):
        single, _ = simulate_batch(MODEL, parameters, masses, TIME_S, POSE, OUT_S)
    with threads(3):
        several, _ = simulate_batch(MODEL, parameters, masses, TIME_S, POSE, OUT_S)
    assert batch.tobytes() == several.tobytes()
    assert batch.tobytes() == single.tobytes()
    alone, _ = simulate(MODEL, parameters[3], masses[3], TIME_S, POSE, OUT_S)
    assert alone.tobytes() == batch[3].tobytes()
    each, _ = simulate_batch(MODEL, parameters, masses, TIME_S, np.tile(POSE, (21, 1, 1)), OUT_S)
    assert each.tobytes() == batch.tobytes()
    assert set(status) == {OK}


def test_no_strings_have_no_results():
    parameters, masses = batch_of(0)
    batch, status = simulate_batch(MODEL, parameters, masses, TIME_S, POSE, OUT_S)
    assert batch.shape == (0, len(OUT_S), 6, 2)
    assert status.shape == (0,)


def test_each_candidate_has_its_own_hand_curl_clamp_and_factors():
    parameters, masses = batch_of(3)
    hands = POSE + np.array([0.0, 0.05, -0.1])[:, None, None] * np.sin(5 * TIME_S)[:, None]
    curls, clamps = np.array([0.0, 2.0, -3.0]), np.array([0.1, 0.0, -0.2])
    factors = np.array([[1.0, 1.0, 1.0, 1.0, 1.0], [2.0, 1.0, 3.0, 1.0, 1.0], [1.0, 0.5, 1.0, 4.0, 2.0]])
    batch, _ = simulate_batch(
        MODEL,
        parameters,
        masses,
        TIME_S,
        hands,
        OUT_S,
        rest_curl_rad_m=curls,
        clamp_offset_rad=clamps,
        bend_factor=factors,
    )
    for c in range(3):
        alone, _ = simulate(
            MODEL,
            parameters[c],
            masses[c],
            TIME_S,
            hands[c],
            OUT_S,
            rest_curl_rad_m=curls[c],
            clamp_offset_rad=clamps[c],
            bend_factor=factors[c],
        )
        np.testing.assert_allclose(batch[c], alone, atol=1e-12)


def test_one_bad_candidate_leaves_the_others_alone():
    parameters, masses = batch_of(11)
    whole, _ = simulate_batch(MODEL, parameters, masses, TIME_S, POSE, OUT_S)
    broken = parameters.copy()
    broken[4] = np.nan
    simulated, status = simulate_batch(MODEL, broken, masses, TIME_S, POSE, OUT_S)
    assert status[4] == BLEW_UP
    others = np.arange(11) != 4
    assert simulated[others].tobytes() == whole[others].tobytes()
    assert set(status[others]) == {OK}


def test_failures_are_reported_as_a_status():
    # Drag that adds energy.
    driven = np.where(np.arange(10) == PARAMETERS.index("C_c2"), -1e3, GROWING_STIFF)
    simulated, status = simulate(MODEL, driven, MASSES, TIME_S, POSE, OUT_S)
    assert status == BLEW_UP
    assert np.isfinite(simulated[0]).all()
    assert np.isnan(simulated[-1]).all()
    _, status = simulate(MODEL, np.full(10, np.nan), MASSES, TIME_S, POSE, OUT_S)
    assert status == BLEW_UP
    ten = StringModel(0.3, 10)
    _, status = simulate(ten, minima().parameters[0], np.ones(10), TIME_S, POSE, OUT_S)
    assert status == OVERSTRETCHED
    assert {OK, BLEW_UP, OVERSTRETCHED, COLLAPSED, NO_REST_SHAPE} == set(STATUS)


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_impossible_lengths_are_reported_as_a_status(precision):
    model = StringModel(0.04, 1, precision=precision, gravity_m_s2=0.0)
    spring = np.where(np.arange(10) == 0, 1e3, 0.0)
    for lengths, expected in ((0.35, OK), (0.25, COLLAPSED), (1.6, OK), (3.1, OVERSTRETCHED)):
        start = np.array([[0.0, -0.04 * lengths]])
        hand = np.array([0.0, 1.0]), np.zeros((2, 3))
        simulated, status = simulate(model, spring, np.ones(1), *hand, OUT_S[:2], start, respace=False)
        assert status == expected
        assert np.isfinite(simulated).all()


def test_stiff_corners_stay_finite():
    corner = np.array([1e8, 1e3, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0])
    cable = np.array([1e6, 100.0, 1e3, 10.0, 1e3, 10.0, 0.1, 0.1, 1e3, 10.0])
    for parameters in (corner, cable):
        simulated, status = simulate(MODEL, parameters, MASSES, TIME_S, POSE, OUT_S)
        assert status == OK
        reach = np.linalg.norm(simulated[:, -1] - simulated[:, 0], axis=1)
        assert reach.max() < 0.202


def test_hand_path_between_samples_is_cubic():
    coarse = np.arange(0.0, 0.4001, 0.01)
    finer, _ = simulate(MODEL, GROWING_STIFF, MASSES, TIME_S, POSE, OUT_S)
    simulated, _ = simulate(MODEL, GROWING_STIFF, MASSES, coarse, hand_path(coarse), OUT_S)
    assert np.abs(simulated - finer).max() < 3e-5


def test_hand_is_where_its_path_is():
    simulated, _ = simulate(MODEL, GROWING_STIFF, MASSES, TIME_S, POSE, OUT_S)
    np.testing.assert_allclose(simulated[:, 0], hand_path(OUT_S)[:, :2], atol=1e-9)
    late, _ = simulate(MODEL, GROWING_STIFF, MASSES, TIME_S, POSE, np.array([0.4, 0.45, 0.6]))
    np.testing.assert_allclose(late[:, 0], np.tile(POSE[-1, :2], (3, 1)), atol=1e-9)


def test_outputs_between_steps_lie_on_the_curve_through_them():
    steps = np.arange(401) * MODEL.dt_s
    on, _ = simulate(MODEL, GROWING_STIFF, MASSES, TIME_S, POSE, steps)
    between, _ = simulate(MODEL, GROWING_STIFF, MASSES, TIME_S, POSE, steps[:-1] + 0.3 * MODEL.dt_s)
    expected = CubicSpline(steps, on, axis=0)(steps[:-1] + 0.3 * MODEL.dt_s)
    straight = 0.7 * on[:-1] + 0.3 * on[1:]
    assert np.abs(straight - expected).max() > 1e-6
    assert np.abs(between - expected).max() < 4e-7


def test_start_keeps_directions_and_takes_the_lengths_of_rest():
    pose = np.array([0.1, 0.2, -0.5])
    was = np.array([[0.03, -0.02], [0.05, -0.01], [0.02, -0.04], [0.0, -0.03], [0.01, -0.06]])
    points = start_shape(MODEL, GROWING_STIFF, MASSES, pose, pose[:2] + np.cumsum(was, axis=0))
    d = np.diff(points, axis=0)
    np.testing.assert_allclose(np.arctan2(d[:, 1], d[:, 0]), np.arctan2(was[:, 1], was[:, 0]), atol=1e-9)
    below = np.cumsum(MASSES[::-1])[::-1] * 9.81
    along = -was[:, 1] / np.linalg.norm(was, axis=1)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 0.04 + below * along / GROWING_STIFF[0], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_s": np.array([0.0, 0.0])}, "must increase"),
        ({"out_s": np.array([-0.1])}, "output times"),
        ({"masses": np.ones((1, 4))}, r"shape \(1, 5\)"),
        ({"parameters": np.ones((2, 10))}, r"shape \(2, 5\)"),
        ({"pose": np.zeros((3, 2, 3))}, "do not fit"),
    ],
)
def test_inconsistent_arrays_are_refused(change, message):
    given = {
        "parameters": GROWING_STIFF[None],
        "masses": MASSES[None],
        "time_s": np.array([0.0, 1.0]),
        "pose": np.zeros((2, 3)),
        "out_s": OUT_S,
    }
    with pytest.raises(ValueError, match=message):
        simulate_batch(MODEL, **{**given, **change})
