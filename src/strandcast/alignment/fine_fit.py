"""The fine fit: clocks and rig errors from all detections, robustly; its uncertainty comes from `noise`."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from strandcast.alignment.joints import MAD, JointPath
from strandcast.alignment.noise import refine
from strandcast.alignment.problem import OFFSET_UNIT_S, ClockProblem
from strandcast.rig.model import Detections, Rig, RigError

# Chosen.
ROUNDS = 4
MOST_STEPS = 25
SMALLEST_STEP = 1e-6  # of a prior's standard deviation, or of 1 ms
LOSS_SCALE = 3.0  # standard deviations beyond which a detection loses weight
OUTLIER = 6.0  # standard deviations beyond which a detection is left out
SHIFT_S, LEAST_SHAPE_M = 0.025, 0.001
LEAST_TRUE_SHARE = 0.8
MOST_OUTLIERS = 0.25  # of the detections


@dataclass(frozen=True, eq=False)
class ClockFit:
    """robot_time = middle_robot_s + (1 + drift) · (camera_time − middle_camera_s).

    Attributes
    ----------
    middle_se_s, drift_se, middle_drift_cov_s
        Standard errors of `middle_robot_s` and `drift`, and their covariance.
    drift_prior
        Standard deviation of the drift's prior: wider than the settings' where that contradicts the motion.
    unaided_se_s
        `middle_se_s` if the rig's constants were known ten times less well, hence from the motion alone.
    true_share
        Share of the information on the offset that comes from motion, not from the log's noise.
    rig_error, rig_error_se
        The rig's constant errors, and their standard errors as a vector.
    residual
        (m, 3) measured minus predicted marker poses [m, m, rad].
    outlier
        (m,) detections that were left out.
    noise_scale
        (K, 2) noise of each marker's position and angle over its nominal standard error.
    slow_m
        Size of slowly changing errors of position.
    """

    middle_camera_s: float
    middle_robot_s: float
    drift: float
    middle_se_s: float
    drift_se: float
    middle_drift_cov_s: float
    drift_prior: float
    unaided_se_s: float
    true_share: float
    rig_error: RigError
    rig_error_se: np.ndarray
    residual: np.ndarray
    outlier: np.ndarray
    noise_scale: np.ndarray
    slow_m: float

    def offset_s(self) -> float:
        """Return the offset at camera time zero."""
        return self.middle_robot_s - (1.0 + self.drift) * self.middle_camera_s

    def robot_s(self, camera_s: float) -> float:
        """Return the robot time at a camera time."""
        return self.middle_robot_s + (1.0 + self.drift) * (camera_s - self.middle_camera_s)

    def robot_se_s(self, camera_s: float) -> float:
        """Return the standard error of the robot time at a camera time."""
        reach = camera_s - self.middle_camera_s
        variance = self.middle_se_s**2 + 2 * reach * self.middle_drift_cov_s + (reach * self.drift_se) ** 2
        return float(np.sqrt(max(variance, 0.0)))


@dataclass(frozen=True, eq=False)
class Candidate:
    """The fit from one start offset.

    Attributes
    ----------
    fit, covered, path
        The fit, the detections that the log covers, the joints.
    residual_m
        Rms residual in motion [m].
    shape_m
        How much `SHIFT_S` of offset change the shape of the hand's path [m].
    """

    fit: ClockFit
    covered: Detections
    path: JointPath
    residual_m: float
    shape_m: float

    @property
    def determined(self) -> bool:
        """Whether the motion determines the offset, not the priors or the log's noise."""
        return self.shape_m >= LEAST_SHAPE_M and self.fit.true_share >= LEAST_TRUE_SHARE


class RobustFit(NamedTuple):
    """A fit without its uncertainty: the solution x (p,), and the noise of detections and markers.

    sigma is (m, 3), by marker and speed; noise_scale (K, 2) is the noise of each marker's position and angle
    over its nominal standard error.
    """

    x: np.ndarray
    sigma: np.ndarray
    noise_scale: np.ndarray


def fitted(problem: ClockProblem, shape_m: float) -> Candidate:
    """Return the fit of a problem with a path that changes its shape by `shape_m`."""
    fit = fit_clock(problem)
    residual_m = moving_rms_m(fit.residual, problem.detections, fit.outlier)
    return Candidate(fit, problem.detections, problem.path, residual_m, shape_m)


def fit_clock(problem: ClockProblem) -> ClockFit:
    """Fit the clocks, and estimate the uncertainty."""
    robust = robust_fit(problem)
    sigma = robust.sigma
    outlier = outliers(problem.residual(robust.x), sigma)
    kept = replace(problem, detections=problem.detections.where(~outlier))
    found = refine(kept, _minimise(kept, robust.x, sigma[~outlier]), sigma[~outlier])
    full, scales = found.x * problem.scales, problem.scales
    errors = found.covariance * scales[:, None] * scales
    return ClockFit(
        middle_camera_s=problem.middle_s,
        middle_robot_s=problem.middle_s + problem.offset_s + float(full[0]),
        drift=float(full[1]),
        middle_se_s=float(np.sqrt(errors[0, 0])),
        drift_se=float(np.sqrt(errors[1, 1])),
        middle_drift_cov_s=float(errors[0, 1]),
        drift_prior=float(scales[1]),
        unaided_se_s=found.unaided_se * OFFSET_UNIT_S,
        true_share=found.true_share,
        rig_error=problem.rig_error(found.x),
        rig_error_se=np.sqrt(np.diag(errors))[2:],
        residual=problem.residual(found.x),
        outlier=outlier,
        noise_scale=robust.noise_scale,
        slow_m=found.slow_m,
    )


def robust_fit(problem: ClockProblem) -> RobustFit:
    """Fit the clocks without their uncertainty."""
    rig, detections = problem.rig, problem.detections
    markers = len(rig.place_m)
    x, nominal = problem.expected.copy(), _nominal_sigma(rig, detections)
    sigma = scale = nominal * 5.0
    for _ in range(ROUNDS):
        x = _minimise(problem, x, sigma)
        scale = _noise_scales(problem.residual(x) / nominal, detections, markers)
        sigma = nominal * scale
    return RobustFit(x, sigma, _scale_by_marker(scale, detections.marker, markers))


def outliers(residual: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return which detections (m,) deviate more than noise of (m, 3) explains."""
    return np.asarray((np.abs(residual) > OUTLIER * sigma).any(axis=1))


def moving_rms_m(residual: np.ndarray, detections: Detections, outlier: np.ndarray) -> float:
    """Return the rms of residuals (m, 3) where the hand is fast, without outliers (m,) [m].

    Frames at rest fit any log, and single misread markers should not discredit a good one. But at most
    `MOST_OUTLIERS` of the detections are left out: a fit that rejects more is wrong itself.
    """
    speed = detections.speed_m_s()
    moving = speed >= 0.2 * detections.top_speed_m_s()
    left_out = min(max(0.05, float(outlier[moving].mean())), MOST_OUTLIERS)
    square = np.sort((residual[moving, :2] ** 2).sum(axis=1))
    return float(np.sqrt(square[: max(1, int((1.0 - left_out) * len(square)))].mean()))


def _nominal_sigma(rig: Rig, detections: Detections) -> np.ndarray:
    """Return the standard errors (m, 3) of x, y and angle; four corners give the angle to √2 σ / side."""
    sigma_m = detections.sigma_m
    return np.column_stack([sigma_m, sigma_m, np.sqrt(2.0) * sigma_m / rig.size_m[detections.marker]])


def _noise_scales(off: np.ndarray, detections: Detections, markers: int) -> np.ndarray:
    """Return the noise over its nominal size (m, 3): by marker, for position and angle, with the speed.

    Blur and late rows cause errors that grow with the speed: by the noise at rest, all frames in motion would
    be outliers.
    """
    scale = np.ones(off.shape)
    speed = detections.speed_m_s()
    fast = speed > 0.3 * detections.top_speed_m_s()
    for index in range(markers):
        mine = detections.marker == index
        for columns in (slice(0, 2), slice(2, 3)):
            still, moving = (_median_scale(off[mine & some, columns]) for some in (~fast, fast))
            more = max(moving**2 - still**2, 0.0)
            usual = float(np.median(speed[mine & fast])) if (mine & fast).any() else 1.0
            size = np.sqrt(still**2 + more * (speed[mine] / max(usual, 1e-9)) ** 2)
            scale[mine, columns] = np.maximum(size, 1e-3)[:, None]
    return scale


def _median_scale(off: np.ndarray) -> float:
    return MAD * float(np.median(np.abs(off))) if len(off) >= 5 else 1.0


def _scale_by_marker(scale: np.ndarray, marker: np.ndarray, markers: int) -> np.ndarray:
    mine = [scale[marker == index] for index in range(markers)]
    return np.array(
        [[np.median(some[:, 0]), np.median(some[:, 2])] if len(some) else [np.nan] * 2 for some in mine]
    )


def _minimise(problem: ClockProblem, x: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return the x of least cost: Gauss-Newton with soft-l1 weights; steps that overshoot are halved."""
    cost, off = _cost(problem, x, sigma)
    for _ in range(MOST_STEPS):
        slope = problem.jacobian(x)[1] / sigma[:, :, None]
        weight = 1.0 / np.sqrt(1.0 + (off / LOSS_SCALE) ** 2)
        more, more_slope = problem.event_residual(x)
        flat = slope.reshape(-1, len(x))
        step = np.linalg.solve(
            flat.T @ (weight.reshape(-1, 1) * flat) + more_slope.T @ more_slope + np.diag(problem.prior()),
            flat.T @ (weight * off).ravel() + more_slope.T @ more - problem.prior() * (x - problem.expected),
        )
        moved, there = _cost(problem, x + step, sigma)
        while moved > cost and np.abs(step).max() > SMALLEST_STEP:
            step *= 0.5
            moved, there = _cost(problem, x + step, sigma)
        if moved <= cost:
            x, cost, off = x + step, moved, there
        if np.abs(step).max() <= SMALLEST_STEP:
            break
    return x


def _cost(problem: ClockProblem, x: np.ndarray, sigma: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the cost, and the residuals (m, 3) in standard deviations."""
    off = problem.residual(x) / sigma
    loss = LOSS_SCALE**2 * (np.sqrt(1.0 + (off / LOSS_SCALE) ** 2) - 1.0)
    more = problem.event_residual(x)[0]
    away = problem.prior() * (x - problem.expected) ** 2
    return float(loss.sum() + 0.5 * (away.sum() + more @ more)), off
