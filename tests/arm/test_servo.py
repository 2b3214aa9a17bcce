"""The servo's response against closed forms, and the search for it."""

import numpy as np
from scipy.signal import lsim

from strandcast.arm.servo import Servo, identify, respond

TIME_S = np.arange(0.0, 1.0, 0.002)


def servo(delay: float = 0.004, w: float = 60.0, z: float = 0.9, gain: float = 1.0, joints: int = 2) -> Servo:
    return Servo(*(np.full(joints, value) for value in (delay, w, z, gain)))


def test_step_response_is_the_textbooks() -> None:
    step = np.concatenate([[[0.0]], np.ones((len(TIME_S) - 1, 1))])
    w, z = 40.0, 0.5
    answer = respond(servo(0.0, w, z, joints=1), TIME_S, step)[:, 0]
    # The first-order hold makes the step a ramp of one sample: its middle is the step's time.
    t = np.maximum(TIME_S - 0.001, 0.0)
    wd = w * np.sqrt(1 - z * z)
    exact = 1 - np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t))
    np.testing.assert_allclose(answer[5:], exact[5:], atol=2e-4)


def test_agrees_with_scipy_on_a_swing() -> None:
    command = 0.4 * np.sin(5 * TIME_S) ** 2
    answer = respond(servo(0.0, 60.0, 0.7, joints=1), TIME_S, command[:, None])[:, 0]
    _, expected, _ = lsim(([3600.0], [1.0, 84.0, 3600.0]), command, TIME_S)
    np.testing.assert_allclose(answer, expected, atol=1e-9)


def test_constant_speed_is_trailed_by_the_lag() -> None:
    one = servo(0.006, 60.0, 0.9, joints=1)
    answer = respond(one, TIME_S, TIME_S[:, None])[:, 0]
    np.testing.assert_allclose(one.lag_s, 0.006 + 0.03)
    np.testing.assert_allclose(TIME_S[-1] - answer[-1], 0.036, atol=1e-9)


def test_a_batch_is_its_members() -> None:
    commands = np.random.default_rng(0).normal(size=(3, len(TIME_S), 2)).cumsum(axis=1) * 0.01
    together = respond(servo(), TIME_S, commands)
    np.testing.assert_array_equal(together[1], respond(servo(), TIME_S, commands[1]))


def test_identify_finds_the_response_through_noise_and_zero_error() -> None:
    rng = np.random.default_rng(1)
    command = np.stack([0.6 * np.sin(6 * TIME_S) ** 2, 0.8 * (1 - np.cos(4 * TIME_S))], axis=1)
    true = Servo(np.array([0.010, 0.004]), np.array([45.0, 80.0]), np.array([0.7, 1.1]), np.ones(2))
    measured = respond(true, TIME_S, command) + rng.normal(0, 5e-4, command.shape) + [0.002, -0.001]
    found, residual = identify(TIME_S, command, measured, servo())
    # Delay and lag of the filter trade against each other; only their sum matters in a throw.
    np.testing.assert_allclose(found.lag_s, true.lag_s, atol=3e-4)
    np.testing.assert_allclose(residual, 5e-4, rtol=0.1)
    np.testing.assert_allclose(respond(found, TIME_S, command), respond(true, TIME_S, command), atol=5e-4)


def test_identify_ignores_what_was_not_measured() -> None:
    command = 0.6 * np.sin(6 * TIME_S)[:, None] ** 2
    measured = respond(servo(joints=1), TIME_S, command)
    measured[100:150] = np.nan
    found, residual = identify(TIME_S, command, measured, servo(0.0, 100.0, 0.7, joints=1))
    np.testing.assert_allclose(found.natural_frequency_rad_s, 60.0, rtol=1e-3)
    assert residual[0] < 1e-6


def test_gain_is_fitted_on_request() -> None:
    command = 0.6 * np.sin(6 * TIME_S)[:, None] ** 2
    measured = respond(servo(gain=0.97, joints=1), TIME_S, command)
    found, _ = identify(TIME_S, command, measured, servo(joints=1), fit_gain=True)
    np.testing.assert_allclose(found.gain, 0.97, atol=1e-4)
