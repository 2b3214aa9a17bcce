"""The fine fit: offset, drift and the rig's constant errors, robustly, with an honest standard error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from strandcast.alignment.rig import Misfit, Rig, Seen, marker_poses

ROUNDS = 3
MOST_STEPS = 25
SMOOTHING_S = 0.008  # half the window over which the joints are smoothed
SMALLEST_STEP = 1e-6  # of a prior's standard deviation, or of 1 ms
LOSS_SCALE = 3.0  # standard deviations beyond which a sighting loses weight

Residual = Callable[[np.ndarray], np.ndarray]  # x (p,) -> (m, 3)


@dataclass(frozen=True)
class Priors:
    """Standard deviations of what the fit frees beside the offset; 0 holds a value at its nominal one.

    A rig's constant errors look like a time shift while the hand moves one way: free, they cost some
    certainty; held, they would turn up as a wrong offset (1 mm at 2 m/s: 0.5 ms).
    """

    drift: float = 5e-5
    marker_shift_m: float = 3e-3
    marker_turn_rad: float = 0.02
    base_shift_m: float = 1e-3
    joint_zero_rad: float = 1e-3


@dataclass(frozen=True)
class ClockFit:
    """robot_time = middle_robot_s + (1 + drift) · (camera_time − middle_camera_s).

    Attributes
    ----------
    middle_se_s, drift_se
        Standard errors of `middle_robot_s` and `drift`; `middle_drift_cov_s` their covariance.
    misfit
        The rig's constant errors.
    residual
        (m, 3) seen minus told by the joints [m, m, rad].
    """

    middle_camera_s: float
    middle_robot_s: float
    drift: float
    middle_se_s: float
    drift_se: float
    middle_drift_cov_s: float
    misfit: Misfit
    residual: np.ndarray

    def offset_s(self) -> float:
        """Return the offset at camera time zero."""
        return self.middle_robot_s - (1.0 + self.drift) * self.middle_camera_s

    def offset_se_s(self) -> float:
        """Return its standard error."""
        reach = self.middle_camera_s
        variance = self.middle_se_s**2 - 2 * reach * self.middle_drift_cov_s + (reach * self.drift_se) ** 2
        return float(np.sqrt(max(variance, 0.0)))


def fit_clock(
    rig: Rig, log_time_s: np.ndarray, q_rad: np.ndarray, seen: Seen, offset_s: float, priors: Priors
) -> ClockFit:
    """Fit the clocks from a start near the truth.

    Parameters
    ----------
    rig
        Arm and markers.
    log_time_s, q_rad
        (T,) strictly rising [s], (T, J) [rad].
    seen
        Marker sightings, ordered in time, all within the log.
    offset_s
        From the coarse search.
    priors
        Of drift and of the rig's constant errors.
    """
    joints = smooth_joints(log_time_s, q_rad)
    middle = float(seen.time_s.mean())
    scales = _scales(priors, q_rad.shape[1])
    free = scales > 0
    sigma = _sigmas(rig, seen)

    def unpack(x: np.ndarray) -> np.ndarray:
        full = np.zeros(len(scales))
        full[free] = x * scales[free]
        return full

    def residual(x: np.ndarray) -> np.ndarray:
        full = unpack(x)
        robot_s = middle + offset_s + full[0] + (1.0 + full[1]) * (seen.time_s - middle)
        off = seen.pose - marker_poses(rig, joints(robot_s), seen.marker, _misfit(full))
        off[:, 2] = _wrap(off[:, 2])
        return off

    x, spread = np.zeros(int(free.sum())), np.full(3, 5.0)
    for _ in range(ROUNDS):
        x = _descend(residual, x, sigma * spread)
        spread = _spread(residual(x) / sigma)
    covariance = _covariance(residual, x, sigma * spread, seen.time_s)
    full = unpack(x)
    steps = scales[free]
    errors = np.zeros((len(scales), len(scales)))
    errors[np.ix_(free, free)] = covariance * steps[:, None] * steps
    return ClockFit(
        middle_camera_s=middle,
        middle_robot_s=middle + offset_s + full[0],
        drift=float(full[1]),
        middle_se_s=float(np.sqrt(errors[0, 0])),
        drift_se=float(np.sqrt(errors[1, 1])),
        middle_drift_cov_s=float(errors[0, 1]),
        misfit=_misfit(full),
        residual=residual(x),
    )


def smooth_joints(log_time_s: np.ndarray, q_rad: np.ndarray) -> CubicSpline:
    """Return the joints as a function of time, encoder noise smoothed (Savitzky–Golay, cubic).

    Unsmoothed, a spline through noisy rows is quietest half-way between them, and the fit would be drawn to
    offsets that put the frames there: up to 0.1 ms for 0.5 mrad of noise at 500 Hz.
    """
    step_s = float(np.median(np.diff(log_time_s)))
    half = int(SMOOTHING_S / step_s)
    if half < 2:
        return CubicSpline(log_time_s, q_rad)
    even_s = np.arange(log_time_s[0], log_time_s[-1], step_s)
    even = np.stack([np.interp(even_s, log_time_s, column) for column in q_rad.T], axis=1)
    return CubicSpline(even_s, savgol_filter(even, 2 * half + 1, 3, axis=0, mode="nearest"))


def _scales(priors: Priors, joints: int) -> np.ndarray:
    """Return the unit of each parameter: 1 ms for the offset (no prior), then the priors."""
    return np.array(
        [
            1e-3,
            priors.drift,
            priors.marker_shift_m,
            priors.marker_shift_m,
            priors.marker_turn_rad,
            priors.base_shift_m,
            priors.base_shift_m,
            *[priors.joint_zero_rad] * joints,
        ]
    )


def _misfit(full: np.ndarray) -> Misfit:
    return Misfit(full[2:4], float(full[4]), full[5:7], full[7:])


def _sigmas(rig: Rig, seen: Seen) -> np.ndarray:
    """Return the standard errors (m, 3) of x, y and angle; four corners tell the angle to √2 σ / side."""
    return np.column_stack(
        [seen.sigma_m, seen.sigma_m, np.sqrt(2.0) * seen.sigma_m / rig.size_m[seen.marker]]
    )


def _spread(standardised: np.ndarray) -> np.ndarray:
    """Return how much larger than said the errors of place and of angle are, by the median: (3,)."""
    place = 1.4826 * np.median(np.abs(standardised[:, :2]))
    angle = 1.4826 * np.median(np.abs(standardised[:, 2]))
    return np.maximum([place, place, angle], 1e-3)


def _descend(residual: Residual, x: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return the x of least cost: Gauss–Newton under soft-l1 weights, steps halved where they overshoot."""
    prior = _prior(len(x))
    cost = _cost(residual(x) / sigma, x)
    for _ in range(MOST_STEPS):
        off, slope = _linearised(residual, x, sigma)
        weight = _weight(off)
        step = -np.linalg.solve(
            np.einsum("mc,mci,mcj->ij", weight, slope, slope) + np.diag(prior),
            np.einsum("mc,mci->i", weight * off, slope) + prior * x,
        )
        while (moved := _cost(residual(x + step) / sigma, x + step)) > cost and np.abs(
            step
        ).max() > SMALLEST_STEP:
            step *= 0.5
        if moved <= cost:
            x, cost = x + step, moved
        if np.abs(step).max() <= SMALLEST_STEP:
            break
    return x


def _linearised(residual: Residual, x: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the standardised residual (m, 3) and its slope (m, 3, p) by forward differences."""
    off = residual(x) / sigma
    small = 1e-5 * np.eye(len(x))
    return off, np.stack([(residual(x + step) / sigma - off) / 1e-5 for step in small], axis=-1)


def _weight(off: np.ndarray) -> np.ndarray:
    """Return soft-l1 weights: a sighting loses weight beyond `LOSS_SCALE` standard deviations."""
    return 1.0 / np.sqrt(1.0 + (off / LOSS_SCALE) ** 2)


def _cost(off: np.ndarray, x: np.ndarray) -> float:
    loss = LOSS_SCALE**2 * (np.sqrt(1.0 + (off / LOSS_SCALE) ** 2) - 1.0)
    return float(loss.sum() + 0.5 * (_prior(len(x)) * x**2).sum())


def _prior(count: int) -> np.ndarray:
    """Return the priors' information: one in the units of `_scales`, none on the offset."""
    return np.concatenate([[0.0], np.ones(count - 1)])


def _covariance(residual: Residual, x: np.ndarray, sigma: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return the sandwich covariance of x: A⁻¹ B A⁻¹ with B summed over lags, as residuals follow each other.

    Newey and West's estimator (Econometrica 55, 1987) with Andrews' bandwidth for an AR(1) (Econometrica 59,
    1991, eqs. 6.2 and 6.4) or more, enlarged for the few independent frames there are, and never below the
    plain covariance scaled by the residual.
    """
    off, slope = _linearised(residual, x, sigma)
    weight, prior = _weight(off), np.diag(_prior(len(x)))
    information = np.einsum("mc,mci,mcj->ij", weight, slope, slope)
    bread = np.linalg.inv(information + prior)
    frame = np.unique(time_s, return_inverse=True)[1]
    scores = np.einsum("mc,mci->mi", weight * off, slope)
    scores = np.stack([np.bincount(frame, column) for column in scores.T], axis=1)
    told = np.bincount(frame, (weight * slope[:, :, 0] ** 2).sum(axis=1))
    frames = told.sum() ** 2 / (told @ told)  # that tell of the offset: those in motion
    long_run = _long_run(scores, frames)
    independent = frames / max(1.0, long_run[0, 0] / float(scores[:, 0] @ scores[:, 0]))
    used = float(np.trace(bread @ information))
    followed = bread @ (long_run * max(independent, used + 2) / max(independent - used, 2.0) + prior) @ bread
    plain = bread * max(1.0, float((weight * off**2).sum()) / max(off.size - used, 1.0))
    return followed if followed[0, 0] >= plain[0, 0] else plain


def _long_run(scores: np.ndarray, telling: float) -> np.ndarray:
    """Return the long-run covariance (p, p) of a series of scores (frames, p), Bartlett weights.

    At the best fit the scores add up to zero, which takes the share reach / telling off; it is put back.
    """
    count = len(scores)
    series = scores[:, 0]
    power = float(series @ series)
    follow = float(np.clip(series[1:] @ series[:-1] / power, 0.0, 0.97)) if power > 0 else 0.0
    reach = 1.1447 * (4.0 * follow**2 / (1.0 - follow**2) ** 2 * count) ** (1.0 / 3.0)
    # A tenth of the telling frames at least: noise part white, part slow looks white to the first lag.
    reach = min(max(reach, telling / 10.0), telling / 3.0)
    total = scores.T @ scores
    for lag in range(1, int(reach) + 1):
        lagged = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (reach + 1.0)) * (lagged + lagged.T)
    return total / (1.0 - reach / telling)


def _wrap(angle_rad: np.ndarray) -> np.ndarray:
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi
