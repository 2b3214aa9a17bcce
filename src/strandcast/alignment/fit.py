"""The fine fit: clocks and the rig's constant errors from all sightings, robustly; certainty by `noise`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.alignment.joints import MAD, JointPath
from strandcast.alignment.noise import Summary, certainty
from strandcast.alignment.problem import OFFSET_UNIT_S, Event, Priors, Problem
from strandcast.alignment.rig import Misfit, Rig, Seen

ROUNDS = 4
MOST_STEPS = 25
SMALLEST_STEP = 1e-6  # of a prior's standard deviation, or of 1 ms
LOSS_SCALE = 3.0  # standard deviations beyond which a sighting loses weight
WRONG = 6.0  # beyond which it counts for nothing
SHIFT_S, LEAST_SHAPE_M = 0.025, 0.001
LEAST_TRUE_SHARE = 0.8
MOST_WRONG = 0.25  # of the sightings
WIDER = 10.0  # how much wider priors must not matter to an offset that the motion tells


@dataclass(frozen=True, eq=False)
class ClockFit:
    """robot_time = middle_robot_s + (1 + drift) · (camera_time − middle_camera_s).

    Attributes
    ----------
    middle_se_s, drift_se
        Standard errors of `middle_robot_s` and `drift`; `middle_drift_cov_s` their covariance.
    unaided_se_s
        What `middle_se_s` would be were the rig's constants known ten times less: the motion's own word.
    true_share
        How much of what is known of the offset the motion tells, and not the log's noise.
    misfit, misfit_se
        The rig's constant errors, and their standard errors as a vector.
    residual
        (m, 3) seen minus told by the joints [m, m, rad].
    wrong
        (m,) sightings that were left out.
    spread
        (K, 2) noise of each marker over what was said of it, of place and angle.
    slow_m, slow_rad, slow_reach_m
        Size of the errors that change slowly, and over which way of the hand.
    """

    middle_camera_s: float
    middle_robot_s: float
    drift: float
    middle_se_s: float
    drift_se: float
    middle_drift_cov_s: float
    unaided_se_s: float
    true_share: float
    misfit: Misfit
    misfit_se: np.ndarray
    residual: np.ndarray
    wrong: np.ndarray
    spread: np.ndarray
    slow_m: float
    slow_rad: float
    slow_reach_m: float

    def offset_s(self) -> float:
        """Return the offset at camera time zero."""
        return self.middle_robot_s - (1.0 + self.drift) * self.middle_camera_s

    def offset_se_s(self) -> float:
        """Return its standard error."""
        return self.told_se_s(0.0)

    def told_s(self, camera_s: float) -> float:
        """Return the robot's time at a camera's time."""
        return self.middle_robot_s + (1.0 + self.drift) * (camera_s - self.middle_camera_s)

    def told_se_s(self, camera_s: float) -> float:
        """Return its standard error."""
        reach = camera_s - self.middle_camera_s
        variance = self.middle_se_s**2 + 2 * reach * self.middle_drift_cov_s + (reach * self.drift_se) ** 2
        return float(np.sqrt(max(variance, 0.0)))


@dataclass(frozen=True, eq=False)
class Candidate:
    """One offset's fit, the sightings that it used, and its residual in motion [m].

    `shape_m` is how much `SHIFT_S` of offset change the shape of the hand's path.
    """

    fit: ClockFit
    covered: Seen
    path: JointPath
    residual_m: float
    shape_m: float

    @property
    def told(self) -> bool:
        """Whether the motion tells the offset, and neither trust in places nor the log's noise does."""
        return self.shape_m >= LEAST_SHAPE_M and self.fit.true_share >= LEAST_TRUE_SHARE


def fit_clock(
    rig: Rig,
    path: JointPath,
    seen: Seen,
    offset_s: float,
    priors: Priors,
    events: tuple[Event, ...] = (),
) -> ClockFit:
    """Fit the clocks from a start near the truth.

    Parameters
    ----------
    rig
        Arm and markers.
    path
        The joints, over all the time of the sightings.
    seen
        Marker sightings, ordered in time, all within the log.
    offset_s
        From the coarse search.
    priors
        Of drift and of the rig's constant errors.
    events
        Seen by both clocks.
    """
    problem, x, sigma, spread = robust_fit(rig, path, seen, offset_s, priors, events)
    wrong = wrong_of(problem.residual(x), sigma)
    kept = replace(problem, seen=seen.where(~wrong))
    x = _descend(kept, x, sigma[~wrong])
    summary = certainty(kept, x, sigma[~wrong], WIDER)
    return _told(problem, summary, wrong, spread)


def robust_fit(
    rig: Rig,
    path: JointPath,
    seen: Seen,
    offset_s: float,
    priors: Priors,
    events: tuple[Event, ...] = (),
) -> tuple[Problem, np.ndarray, np.ndarray, np.ndarray]:
    """Fit without saying how sure it is.

    Returns
    -------
    problem, x
        What was fitted, and what was found.
    sigma
        (m, 3) noise of the sightings, by marker and speed.
    spread
        (K, 2) noise of each marker over what was said of it, of place and angle.
    """
    problem = Problem(
        rig, path, seen, events, priors.scales(rig), priors.expected(rig), float(seen.time_s.mean()), offset_s
    )
    markers, speed = len(rig.place_m), seen.speed_m_s()
    x, said = problem.expected.copy(), _said(rig, seen)
    sigma = spread = said * 5.0
    for _ in range(ROUNDS):
        x = _descend(problem, x, sigma)
        spread = _spreads(problem.residual(x) / said, seen.marker, speed, markers)
        sigma = said * spread
    return problem, x, sigma, _marker_spread(spread, seen.marker, markers)


def wrong_of(residual: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return which sightings (m,) lie further off than noise of (m, 3) explains."""
    return np.asarray((np.abs(residual) > WRONG * sigma).any(axis=1))


def moving_rms_m(residual: np.ndarray, seen: Seen, wrong: np.ndarray) -> float:
    """Return the rms of residuals (m, 3) where the hand is fast, without what is wrong (m,) [m].

    Frames at rest fit any log; single misread markers should not condemn a good one. But no more than
    `MOST_WRONG` of the sightings are left out: a fit that calls more of them wrong is wrong itself.
    """
    speed = seen.speed_m_s()
    moving = speed >= 0.2 * np.quantile(speed, 0.98)
    left_out = min(max(0.05, float(wrong[moving].mean())), MOST_WRONG)
    square = np.sort((residual[moving, :2] ** 2).sum(axis=1))
    return float(np.sqrt(square[: max(1, int((1.0 - left_out) * len(square)))].mean()))


def _told(problem: Problem, found: Summary, wrong: np.ndarray, spread: np.ndarray) -> ClockFit:
    full, scales = found.x * problem.scales, problem.scales
    errors = found.covariance * scales[:, None] * scales
    return ClockFit(
        middle_camera_s=problem.middle_s,
        middle_robot_s=problem.middle_s + problem.offset_s + float(full[0]),
        drift=float(full[1]),
        middle_se_s=float(np.sqrt(errors[0, 0])),
        drift_se=float(np.sqrt(errors[1, 1])),
        middle_drift_cov_s=float(errors[0, 1]),
        unaided_se_s=found.unaided_se * OFFSET_UNIT_S,
        true_share=found.true_share,
        misfit=problem.misfit(found.x),
        misfit_se=np.sqrt(np.diag(errors))[2:],
        residual=problem.residual(found.x),
        wrong=wrong,
        spread=spread,
        slow_m=found.slow_m,
        slow_rad=found.slow_rad,
        slow_reach_m=found.reach_m,
    )


def _said(rig: Rig, seen: Seen) -> np.ndarray:
    """Return the standard errors (m, 3) of x, y and angle; four corners tell the angle to √2 σ / side."""
    return np.column_stack(
        [seen.sigma_m, seen.sigma_m, np.sqrt(2.0) * seen.sigma_m / rig.size_m[seen.marker]]
    )


def _spreads(off: np.ndarray, marker: np.ndarray, speed: np.ndarray, markers: int) -> np.ndarray:
    """Return how much larger than said the errors are (m, 3): by marker, of place and angle, with the speed.

    Blur and late rows make errors that grow with the speed: judged by the frames at rest, all frames in
    motion would seem wrong.
    """
    spread = np.ones(off.shape)
    fast = speed > 0.3 * np.quantile(speed, 0.98)
    for index in range(markers):
        mine = marker == index
        for columns in (slice(0, 2), slice(2, 3)):
            still, moving = (_median_spread(off[mine & some, columns]) for some in (~fast, fast))
            more = max(moving**2 - still**2, 0.0)
            usual = float(np.median(speed[mine & fast])) if (mine & fast).any() else 1.0
            size = np.sqrt(still**2 + more * (speed[mine] / max(usual, 1e-9)) ** 2)
            spread[mine, columns] = np.maximum(size, 1e-3)[:, None]
    return spread


def _median_spread(off: np.ndarray) -> float:
    return MAD * float(np.median(np.abs(off))) if len(off) >= 5 else 1.0


def _marker_spread(spread: np.ndarray, marker: np.ndarray, markers: int) -> np.ndarray:
    mine = [spread[marker == index] for index in range(markers)]
    return np.array(
        [[np.median(some[:, 0]), np.median(some[:, 2])] if len(some) else [np.nan] * 2 for some in mine]
    )


def _descend(problem: Problem, x: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return the x of least cost: Gauss–Newton under soft-l1 weights, steps halved where they overshoot."""
    cost = _cost(problem, x, sigma)
    for _ in range(MOST_STEPS):
        off = problem.residual(x) / sigma
        slope = problem.slopes(x)[1] / sigma[:, :, None]
        weight = 1.0 / np.sqrt(1.0 + (off / LOSS_SCALE) ** 2)
        more, more_slope = problem.event_rows(x)
        flat = slope.reshape(-1, len(x))
        step = np.linalg.solve(
            flat.T @ (weight.reshape(-1, 1) * flat) + more_slope.T @ more_slope + np.diag(problem.prior()),
            flat.T @ (weight * off).ravel() + more_slope.T @ more - problem.prior() * (x - problem.expected),
        )
        while (moved := _cost(problem, x + step, sigma)) > cost and np.abs(step).max() > SMALLEST_STEP:
            step *= 0.5
        if moved <= cost:
            x, cost = x + step, moved
        if np.abs(step).max() <= SMALLEST_STEP:
            break
    return x


def _cost(problem: Problem, x: np.ndarray, sigma: np.ndarray) -> float:
    off = problem.residual(x) / sigma
    loss = LOSS_SCALE**2 * (np.sqrt(1.0 + (off / LOSS_SCALE) ** 2) - 1.0)
    more = problem.event_rows(x)[0]
    away = problem.prior() * (x - problem.expected) ** 2
    return float(loss.sum() + 0.5 * (away.sum() + more @ more))
