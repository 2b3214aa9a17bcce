"""SIMD vectors of candidates: the same strings for every register width and either precision."""

from dataclasses import replace

import numpy as np
import pytest
from arrays import evaluate_batch, simulate_batch

from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import minima, random_strings
from strandcast.dynamics.simulate import BLEW_UP, OK, vector_spec

MODEL = StringModel(0.4, 7)
TIME_S = np.linspace(0.0, 0.5, 126)
TURN = np.sin(2 * np.pi * 1.5 * TIME_S) * np.minimum(TIME_S / 0.2, 1.0) ** 3
POSE = np.column_stack([0.25 * TURN, 0.1 * (1 - np.cos(6 * TIME_S)) * TURN, -np.pi / 2 + 0.6 * TURN])
FRAME_S = np.arange(3, 120) / 240.0
COUNT = 21  # no multiple of any width


def strings(count=COUNT):
    """Draws of the paper's ranges that do not blow up on this hand path."""
    drawn = random_strings(10 * count, 0, np.random.default_rng(3)).parameters
    drawn[:, 0] = np.maximum(drawn[:, 0], 3e4)
    drawn[:, 2] = np.minimum(drawn[:, 2], 0.3)
    _, status = simulate_batch(MODEL, drawn, np.ones((len(drawn), 7)), TIME_S, POSE, FRAME_S)
    return drawn[status == OK][:count]


@pytest.fixture(scope="module")
def drawn():
    kept = strings()
    assert len(kept) == COUNT
    return kept


def positions(model, drawn, pose=POSE):
    points, status = simulate_batch(model, drawn, np.ones((len(drawn), 7)), TIME_S, pose, FRAME_S)
    assert set(status) == {OK}
    return points


@pytest.mark.thorough
@pytest.mark.parametrize("bits", ["256", "0"])
def test_every_register_width_gives_the_same_strings(monkeypatch, drawn, bits):
    here = positions(MODEL, drawn)
    monkeypatch.setenv("STRANDCAST_REGISTER_BITS", bits)
    assert vector_spec("f64").width == max(int(bits) // 64, 1)
    assert np.abs(positions(MODEL, drawn) - here).max() < 1e-7


def test_single_precision_is_micrometres_away(drawn):
    single = positions(replace(MODEL, precision="f32"), drawn)
    away = np.linalg.norm(single - positions(MODEL, drawn), axis=-1).max(axis=(1, 2))
    assert 0.0 < np.median(away) < 5e-6
    assert np.sort(away)[-3] < 2e-4  # a few strings of Table 2 amplify any rounding


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_each_candidate_has_its_own_hand(drawn, precision):
    model = replace(MODEL, precision=precision)
    poses = POSE * np.linspace(0.6, 1.0, COUNT)[:, None, None] + [0.0, 0.0, 0.2]
    together = positions(model, drawn, poses)
    for b in (0, 7, COUNT - 1):
        alone = positions(model, drawn[b : b + 1], poses[b])[0]
        assert np.abs(together[b] - alone).max() < (1e-12 if precision == "f64" else 1e-5)


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_E_of_the_kernel_is_that_of_the_positions(drawn, precision):
    model = replace(MODEL, precision=precision)
    rng = np.random.default_rng(5)
    measured_m = positions(MODEL, drawn[:1])[0, :, 1:] + 0.003 * rng.standard_normal((len(FRAME_S), 7, 2))
    per_metre = rng.random(measured_m.shape[:2]) / 500
    per_metre[rng.random(per_metre.shape) < 0.3] = 0.0
    measured_m[per_metre == 0.0] = np.nan
    shift = 0.01 * rng.standard_normal((COUNT, 2))
    masses = np.ones((COUNT, 7))
    values, status = evaluate_batch(
        model, drawn, masses, TIME_S, POSE, FRAME_S, measured_m, per_metre, shift_m=shift
    )
    off = np.linalg.norm(positions(model, drawn)[:, :, 1:] + shift[:, None, None] - measured_m, axis=-1)
    assert set(status) == {OK}
    np.testing.assert_allclose(values, np.nansum(off * per_metre, axis=(1, 2)), rtol=1e-4, atol=1e-7)


def test_a_string_that_blew_up_has_no_value():
    two = np.vstack([minima().parameters, np.full((1, 10), np.nan)])
    stiff = replace(MODEL, gravity_m_s2=0.0)
    measured_m, weights = np.zeros((len(FRAME_S), 7, 2)), np.ones((len(FRAME_S), 7))
    values, status = evaluate_batch(stiff, two, np.ones((2, 7)), TIME_S, POSE, FRAME_S, measured_m, weights)
    assert np.isfinite(values[0])
    assert np.isinf(values[1])
    assert status[1] == BLEW_UP


def test_dry_friction_ends_a_swing_away_from_rest():
    heavy = np.array([[1e5, 5.0, 1e-3, 1e-4, 1e-3, 1e-4, 1e-3, 1e-3, 1e-3, 1e-4]])
    still = np.tile(POSE[0], (2, 1))
    time_s = np.array([0.0, 4.0])
    frame_s = np.linspace(0.0, 4.0, 401)
    leaning = (
        np.column_stack([np.sin(0.5) * np.arange(1, 8), -np.cos(0.5) * np.arange(1, 8)]) * MODEL.spacing_m
    )
    swings = []
    for friction in (0.0, 3.0):
        points, _ = simulate_batch(
            MODEL, heavy, np.ones((1, 7)), time_s, still, frame_s, leaning, bend_friction=friction
        )
        swings.append(points[0, :, -1, 0])
    with_friction = swings[1]
    turns = [np.sum(np.diff(np.sign(np.diff(swing[100:]))) != 0) for swing in swings]
    assert turns[0] >= 3
    assert turns[1] == 0  # it only creeps on
    assert np.abs(with_friction[100]) > 0.02


def leaning_cable(dt_s, stick_rad_m):
    """Return the tip (401, 2) [m] of a cable that is let go at an angle, over four seconds."""
    model = replace(MODEL, dt_s=dt_s)
    cable = np.array([[1e5, 5.0, 1.0, 0.05, 1.0, 0.05, 5.0, 1e-3, 1.0, 0.05]])
    time_s, frame_s = np.array([0.0, 4.0]), np.linspace(0.0, 4.0, 401)
    leaning = np.column_stack([np.sin(0.5) * np.arange(1, 8), -np.cos(0.5) * np.arange(1, 8)])
    points, status = simulate_batch(
        model,
        cable,
        np.ones((1, 7)),
        time_s,
        np.tile([0.0, 0.0, -np.pi / 2], (2, 1)),
        frame_s,
        leaning * model.spacing_m,
        bend_friction=4.0,
        friction_stick_rad_m=stick_rad_m,
    )
    assert status[0] == OK
    return points[0, :, -1]


def test_friction_that_sticks_holds_a_string_where_it_stopped():
    sticking, creeping = leaning_cable(1e-3, 0.1), leaning_cable(1e-3, 0.0)
    assert np.abs(sticking[0, 0]) > 0.1
    assert sticking[-1, 0] > 0.05
    assert np.ptp(sticking[300:, 0]) < 2e-5
    assert np.ptp(creeping[300:, 0]) > 2e-3


def test_friction_that_sticks_needs_no_smaller_steps():
    """Until it slips, a joint is 1400 times stiffer here: too stiff for any step without averaging."""
    assert np.abs(leaning_cable(1e-3, 0.05) - leaning_cable(2.5e-4, 0.05)).max() < 1e-4


@pytest.mark.thorough
@pytest.mark.parametrize("bits", ["256", "0"])
def test_every_register_width_gives_the_same_friction(monkeypatch, bits):
    here = leaning_cable(1e-3, 0.1)
    monkeypatch.setenv("STRANDCAST_REGISTER_BITS", bits)
    assert np.abs(leaning_cable(1e-3, 0.1) - here).max() < 1e-7


def test_arrays_of_the_wrong_length_are_refused(drawn):
    masses, weights = np.ones((COUNT, 7)), np.ones((len(FRAME_S), 7))
    measured_m = np.zeros((len(FRAME_S), 7, 2))
    hands = np.tile(POSE, (COUNT, 1, 1))
    with pytest.raises(ValueError, match="expected an array of shape"):
        simulate_batch(MODEL, drawn, masses, TIME_S, POSE, FRAME_S, bend_factor=np.ones((1, 7)))
    with pytest.raises(ValueError, match="expected an array of shape"):
        simulate_batch(MODEL, drawn, masses, TIME_S, POSE, FRAME_S, np.zeros((3, 2)))
    with pytest.raises(ValueError, match="one path of the hand"):
        evaluate_batch(MODEL, drawn, masses, TIME_S, hands, FRAME_S, measured_m, weights)
    with pytest.raises(ValueError, match="not measured has a weight"):
        evaluate_batch(MODEL, drawn, masses, TIME_S, POSE, FRAME_S, measured_m * np.nan, weights)
