"""Uncertainty of an identified servo: standard deviations, and its error on held-out motion."""

from dataclasses import dataclass

import numpy as np

from strandcast.arm.servo import Servo, identify, respond

NEXT_TRIAL = "the newest trial, from a fit to the ones before"
SECOND_HALF = "the second half of the trial's travel, from a fit to the first"
STEPS = np.array([1e-2, 1e-4, 1e-5])  # of frequency, damping ratio and gain, for finite differences


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A prediction of held-out joint angles.

    Attributes
    ----------
    predicted_rad, measured_rad
        (T, J) the held-out part alone; constant offsets as in the fitted part.
    """

    what: str
    predicted_rad: np.ndarray
    measured_rad: np.ndarray

    @property
    def error_rad(self) -> np.ndarray:
        """(J,) root mean square error [rad]."""
        return np.asarray(np.sqrt(np.nanmean((self.predicted_rad - self.measured_rad) ** 2, axis=0)))


@dataclass(frozen=True, eq=False)
class Response:
    """An identified servo: its parameters (J,), their standard deviations, and its residual.

    Attributes
    ----------
    servo, residual_rad
        The response with the given gain, and its rms residual.
    delay_sd_s, time_constant_sd_s, lag_sd_s
        Delay and time constant compensate each other: their sum, the lag, is known best.
    gain, gain_sd
        Of a second fit, with the gain free. It is reported, not used: half a motion hardly determines it, and
        predicts the other half worse with it.
    held_out
        A prediction with the given gain.
    """

    servo: Servo
    residual_rad: np.ndarray
    delay_sd_s: np.ndarray
    time_constant_sd_s: np.ndarray
    lag_sd_s: np.ndarray
    gain: np.ndarray
    gain_sd: np.ndarray
    held_out: HeldOut | None


def identify_response(time_s: np.ndarray, q_command: np.ndarray, q: np.ndarray, start: Servo) -> Response:
    """Fit the response of each joint to logged motions, and estimate its uncertainty.

    Parameters
    ----------
    time_s
        (T,) evenly spaced [s].
    q_command, q
        (B, T, J) commanded and measured angles [rad], the newest motion last; NaN in `q` where nothing was
        measured.
    start
        Start of the search; its gain is that of the response.
    """
    servo, residual_rad = identify(time_s, q_command, q, start)
    covariance = _covariance(time_s, q_command, q, servo, 3)
    with_gain, _ = identify(time_s, q_command, q, servo, fit_gain=True)
    gain_variance = _covariance(time_s, q_command, q, with_gain, 4)[:, 3, 3]
    w, z = servo.natural_frequency_rad_s, servo.damping_ratio
    delay = np.broadcast_to([1.0, 0.0, 0.0], (len(w), 3))
    constant = np.stack([np.zeros_like(w), -2.0 * z / w**2, 2.0 / w], axis=1)

    def sd(slope: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt(np.einsum("ja,jab,jb->j", slope, covariance, slope)))

    return Response(
        servo,
        residual_rad,
        sd(delay),
        sd(constant),
        sd(delay + constant),
        with_gain.gain,
        np.sqrt(gain_variance),
        predict_held_out(time_s, q_command, q, start),
    )


def predict_held_out(
    time_s: np.ndarray, q_command: np.ndarray, q: np.ndarray, start: Servo
) -> HeldOut | None:
    """Predict the newest motion from the others, or the second half of the only one from its first.

    Halves of the commanded travel; None if no travel was commanded.
    """
    if len(q) > 1:
        servo, _ = identify(time_s, q_command[:-1], q[:-1], start)
        past, rest = slice(None, -1), slice(None)
        fitted = q
    else:
        travel = np.abs(np.diff(q_command[0], axis=0)).sum(axis=1).cumsum()
        if not travel[-1] > 0.0:
            return None
        half = int(np.searchsorted(travel, 0.5 * travel[-1])) + 1
        fitted = q.copy()
        fitted[:, half:] = np.nan
        servo, _ = identify(time_s, q_command, fitted, start)
        past, rest = slice(None), slice(half, None)
    answer = respond(servo, time_s, q_command)
    offset = np.nanmean((fitted - answer)[past], axis=(0, 1))
    what = NEXT_TRIAL if len(q) > 1 else SECOND_HALF
    return HeldOut(what, answer[-1, rest] + offset, q[-1, rest])


def _covariance(
    time_s: np.ndarray, q_command: np.ndarray, q: np.ndarray, servo: Servo, free: int
) -> np.ndarray:
    """(J, free, free) covariance of the first `free` columns of `Servo.matrix`, the others held."""
    matrix = servo.matrix()

    def difference(change: np.ndarray) -> np.ndarray:
        apart = respond(Servo(*(matrix + change).T), time_s, q_command) - q
        return np.asarray(apart - np.nanmean(apart, axis=1, keepdims=True))

    left = difference(np.zeros(4))
    # The delay's step is a whole sample: within one, the corners of the command distort the derivative.
    steps = np.array([time_s[1] - time_s[0], *STEPS])
    slopes = np.stack([(difference(step) - left) / step.max() for step in np.diag(steps)[:free]])
    covariance = np.empty((len(matrix), free, free))
    for j in range(len(matrix)):
        measured = np.isfinite(left[..., j])
        slope, residual = slopes[..., j][:, measured], left[..., j][measured]
        power = (residual**2).sum() / max(len(residual) - free, 1)
        size = np.linalg.norm(slope, axis=1)
        if len(residual) <= free or not size.min() > 0.0:
            covariance[j] = np.full((free, free), np.nan)  # a joint that stood still, or was not measured
            continue
        alike = np.linalg.pinv((slope / size[:, None]) @ (slope / size[:, None]).T, hermitian=True)
        covariance[j] = alike / np.outer(size, size) * power * _correlated_samples(left[..., j])
    return covariance


def _correlated_samples(residual: np.ndarray) -> float:
    """Return how many samples of (B, T) residuals count as one, because neighbours are correlated."""
    known = np.nan_to_num(residual)
    power = (known**2).sum()
    total = 1.0
    for lag in range(1, known.shape[1] // 2):
        alike = (known[:, lag:] * known[:, :-lag]).sum() / max(power, 1e-300)
        if alike <= 0.0:
            break
        total += 2.0 * alike
    return total
