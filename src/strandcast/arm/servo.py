"""How the joints follow a command: gain, transport delay and a second-order lag, joint by joint."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numba import njit


@dataclass(frozen=True, eq=False)
class Servo:
    """Response of the joints: q'' = w^2 (gain * c(t - delay) - q) - 2 z w q', c and q counted from the start.

    Attributes
    ----------
    delay_s, natural_frequency_rad_s, damping_ratio, gain
        (J,) each.
    """

    delay_s: np.ndarray
    natural_frequency_rad_s: np.ndarray
    damping_ratio: np.ndarray
    gain: np.ndarray

    @property
    def time_constant_s(self) -> np.ndarray:
        """(J,) lag behind a command of constant speed, without the delay [s]."""
        return np.asarray(2.0 * self.damping_ratio / self.natural_frequency_rad_s)

    @property
    def lag_s(self) -> np.ndarray:
        """(J,) lag behind a command of constant speed [s]."""
        return np.asarray(self.delay_s + self.time_constant_s)

    def matrix(self) -> np.ndarray:
        """(J, 4) delay [s], natural frequency [rad/s], damping ratio, gain."""
        return np.stack([self.delay_s, self.natural_frequency_rad_s, self.damping_ratio, self.gain], axis=1)


def respond(servo: Servo, time_s: np.ndarray, q_command: np.ndarray) -> np.ndarray:
    """Return the joint angles that follow a command, from rest at its first sample.

    Parameters
    ----------
    time_s
        (T,) evenly spaced [s].
    q_command
        (T, J) or (B, T, J) commanded angles [rad], linear between samples.

    Returns
    -------
    Array of the shape of `q_command` [rad].
    """
    commands = np.ascontiguousarray(q_command, float)
    batch = commands.reshape(-1, *commands.shape[-2:])
    step_s = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    joints = servo.matrix()
    decays, forces = zip(*(_transition(w, z, float(step_s)) for _, w, z, _ in joints.tolist()), strict=True)
    delays, gains = joints[:, 0] / step_s, joints[:, 3].copy()
    answer = _respond(delays, gains, np.array(decays), np.array(forces), batch)
    return answer.reshape(commands.shape)


@njit(cache=True)
def _respond(
    delays: np.ndarray, gains: np.ndarray, decays: np.ndarray, forces: np.ndarray, commands: np.ndarray
) -> np.ndarray:
    """Exact response to a command that is linear between samples (first-order hold); delays in samples."""
    motions, samples, count = commands.shape
    answer = np.empty(commands.shape)
    for j in range(count):
        gain, decay, force = gains[j], decays[j], forces[j]
        for b in range(motions):
            start = commands[b, 0, j]
            x, v = 0.0, 0.0
            before = 0.0
            answer[b, 0, j] = start
            for k in range(1, samples):
                now = gain * (command_at(commands, b, j, k - delays[j]) - start)
                x, v = (
                    decay[0, 0] * x + decay[0, 1] * v + force[0, 0] * before + force[0, 1] * now,
                    decay[1, 0] * x + decay[1, 1] * v + force[1, 0] * before + force[1, 1] * now,
                )
                answer[b, k, j] = start + x
                before = now
    return answer


@njit(cache=True)
def command_at(commands: np.ndarray, b: int, j: int, place: float) -> float:
    """Command of a joint at a fractional index, the first one before the first sample."""
    last = commands.shape[1] - 1
    k = min(max(int(place), 0), last)
    here: float = commands[b, k, j]
    if place <= 0.0 or k == last:
        return here
    after: float = commands[b, k + 1, j]
    between: float = here + (place - k) * (after - here)
    return between


@lru_cache(maxsize=64)
def _transition(w: float, z: float, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """(2, 2) transition of x'' = w^2 (u - x) - 2 z w x' over a step; (2, 2) weights of u before and after.

    The exponential of the (x, x', u, u') system: a series after scaling, then squaring.
    """
    system = np.zeros((4, 4))
    system[0, 1] = 1.0
    system[1, 0], system[1, 1], system[1, 2] = -w * w, -2.0 * z * w, w * w
    system[2, 3] = 1.0
    halvings = 0
    scale = step_s * max(1.0, w) * (1.0 + 2.0 * z)
    while scale > 0.25:
        scale *= 0.5
        halvings += 1
    small = system * (step_s / 2.0**halvings)
    total = np.eye(4)
    term = np.eye(4)
    for k in range(1, 16):
        term = term @ small / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    force = np.empty((2, 2))
    for row in range(2):
        force[row, 0] = total[row, 2] - total[row, 3] / step_s
        force[row, 1] = total[row, 3] / step_s
    return total[:2, :2].copy(), force


def identify(
    time_s: np.ndarray, q_command: np.ndarray, q: np.ndarray, start: Servo, fit_gain: bool = False
) -> tuple[Servo, np.ndarray]:
    """Fit the response of each joint to one or more logged throws.

    Parameters
    ----------
    time_s
        (T,) evenly spaced [s].
    q_command, q
        (T, J) or (B, T, J) commanded and measured angles [rad]; NaN in `q` where nothing was measured.
    start
        Start of the search; its gain is kept unless `fit_gain`.

    Returns
    -------
    The servo, and (J,) the rms of its residual without a constant offset [rad].
    """
    commands = np.asarray(q_command, float).reshape(-1, *np.shape(q_command)[-2:])
    measured = np.asarray(q, float).reshape(commands.shape)
    free = 4 if fit_gain else 3
    rows, rms = [], []
    for j, row in enumerate(start.matrix()):
        fit = scipy.optimize.least_squares(
            _residual,
            np.clip(row[:free], [1e-4, 11.0, 0.06, 0.81][:free], [0.19, 990.0, 4.9, 1.19][:free]),
            bounds=([0.0, 10.0, 0.05, 0.8][:free], [0.2, 1000.0, 5.0, 1.2][:free]),
            x_scale=[0.005, 50.0, 0.5, 0.01][:free],
            args=(row, time_s, commands[:, :, [j]], measured[:, :, [j]]),
        )
        rows.append(np.concatenate([fit.x, row[free:]]))
        rms.append(np.sqrt(np.mean(fit.fun**2)))
    return Servo(*np.array(rows).T), np.array(rms)


def _residual(
    free: np.ndarray, row: np.ndarray, time_s: np.ndarray, commands: np.ndarray, measured: np.ndarray
) -> np.ndarray:
    servo = Servo(*np.concatenate([free, row[len(free) :]])[:, None])
    difference = respond(servo, time_s, commands) - measured
    difference = difference - np.nanmean(difference, axis=1, keepdims=True)
    return np.asarray(difference[np.isfinite(measured)])
