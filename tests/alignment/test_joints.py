import numpy as np
import pytest

from strandcast.alignment.joints import joint_path

NOISE_RAD = 5e-4


def angles(time_s):
    """Two joints that rest, move within half a second, and rest."""
    s = np.clip((time_s - 0.4) / 0.5, 0, 1)[:, None]
    return (10 * s**3 - 15 * s**4 + 6 * s**5) * [1.0, -0.6] + [0.2, 0.1]


@pytest.fixture
def log():
    time_s = np.arange(0.0, 1.3, 0.002)
    noise = np.random.default_rng(0).normal(0, NOISE_RAD, (len(time_s), 2))
    return time_s, angles(time_s) + noise


def test_noise_is_smoothed_and_estimated(log):
    time_s, q = log
    path = joint_path(time_s, q, (0.1, 1.2))
    assert path.encoder_rad == pytest.approx(NOISE_RAD, rel=0.2)
    assert path.jitter_s < 1e-4
    between = np.arange(0.2, 1.1, 0.0013)
    off = path.at(between) - angles(between)
    assert np.sqrt((off**2).mean()) < 0.4 * NOISE_RAD
    claimed = path.covariance(np.ones((len(between), 1, 2)), between, np.eye(len(between)))
    assert (off.sum(axis=1) ** 2).mean() == pytest.approx(np.diag(claimed).mean(), rel=0.8)


def test_time_stamp_jitter_is_separated_from_encoder_noise(log):
    time_s, _ = log
    draw = np.random.default_rng(1)
    late = np.clip(draw.normal(0, 5e-4, len(time_s)), -9e-4, 9e-4)
    path = joint_path(time_s + late, angles(time_s) + draw.normal(0, 1e-4, (len(time_s), 2)), (0.1, 1.2))
    assert path.jitter_s == pytest.approx(4.6e-4, rel=0.3)


def test_quantised_encoders_are_not_taken_for_perfect(log):
    """At rest they report one value; in motion, none of their rows is wrong."""
    time_s, _ = log
    step = 2e-4
    path = joint_path(time_s, np.round(angles(time_s) / step) * step, (0.0, 1.3))
    assert not path.outlier.any()  # nor where the motion begins and ends, by less than a step in a row
    assert 0.1 * step < path.encoder_rad.max() < step


def test_wrong_and_repeated_rows_are_left_out(log):
    time_s, q = log
    q[300] += 0.05
    q[331] = q[330]
    path = joint_path(time_s, q, (0.0, 1.3))
    assert np.flatnonzero(path.outlier).tolist() == [300, 331]
    assert np.abs(path.at(time_s[[300, 331]]) - angles(time_s[[300, 331]])).max() < 1e-3


@pytest.mark.parametrize("noise_rad", [0.0, 2e-6])
def test_no_row_of_a_precise_log_is_wrong_where_the_acceleration_jumps(noise_rad):
    """The splines miss such rows by more than the noise of these encoders."""
    time_s = np.arange(0.0, 1.3, 0.002)
    pushes_rad_s2 = np.where((time_s >= 0.4) & (time_s < 0.6), 25.0, 0.0)
    pushes_rad_s2[(time_s >= 0.6) & (time_s < 0.8)] = -25.0
    q = np.cumsum(np.cumsum(pushes_rad_s2) * 0.002)[:, None] * [0.002, -0.001]
    path = joint_path(time_s, q + np.random.default_rng(2).normal(0, noise_rad or 1e-12, q.shape), (0.0, 1.3))
    assert not path.outlier.any()
    assert np.abs(path.at(time_s) - q).max() < 2e-4  # 0.2 mm at a metre


def test_a_gap_of_20_ms_is_bridged(log):
    time_s, q = log
    kept = np.abs(time_s - 0.6) > 0.01
    path = joint_path(time_s[kept], q[kept], (0.0, 1.3))
    inside = np.linspace(0.592, 0.608, 9)
    assert np.abs(path.at(inside) - angles(inside)).max() < 2e-3


def test_the_joints_are_constant_before_and_after_the_log(log):
    path = joint_path(*log, (0.0, 1.3))
    np.testing.assert_array_equal(path.at(np.array([-1.0, 0.0]))[0], path.at(np.array([-1.0, 0.0]))[1])
