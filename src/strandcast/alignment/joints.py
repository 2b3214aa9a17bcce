"""The joints as smooth functions of time, from a log with noise, late and wrong rows, and holes."""

from dataclasses import dataclass

import numpy as np
import scipy

# Chosen.
KNOT_S = 0.010
LEAST_ROWS = 2.0  # usual rows between knots
ROUNDS = 4
OUTLIER = 6.0  # standard deviations beyond which a row is left out
RIDGE = 1e-9  # of a coefficient's weight
SMOOTHINGS = np.geomspace(1e-3, 1e9, 61)  # weights of third differences to try
SMALLEST_NOISE_RAD = 1e-6
MAD = 1.4826  # standard deviation over median absolute deviation
SLOW, FAST = 0.3, 0.5  # of the greatest speed
LEAST_ROWS_FOR_NOISE = 20
STIRRING = 0.05  # of the greatest speed: below it, joints are taken to rest
GRID = 12.0**0.5  # an encoder's step over its noise: only a row that should be farther on is stale


@dataclass(frozen=True, eq=False)
class JointPath:
    """Smoothing cubic splines through the R rows of a log that lie within the needed span.

    Attributes
    ----------
    spline
        Time [s] to (J,) angles [rad], C coefficients each.
    coefficient_covariance
        (J, C, C) [rad²].
    smoother
        (J, C, R): the coefficients from the rows.
    encoder_rad
        (J,) noise of one row.
    jitter_s
        Noise of one row's time stamp.
    speed_rad_s
        (R, J) at the rows.
    outlier
        (R,) rows that were left out.
    """

    spline: "scipy.interpolate.BSpline"
    coefficient_covariance: np.ndarray
    smoother: np.ndarray
    encoder_rad: np.ndarray
    jitter_s: float
    speed_rad_s: np.ndarray
    outlier: np.ndarray

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Return the joint angles (m, J) [rad], constant before and after the log."""
        return np.asarray(self.spline(self._within(time_s)))

    def speed(self, time_s: np.ndarray) -> np.ndarray:
        """Return the joint speeds (m, J) [rad/s]."""
        return np.asarray(self.spline(self._within(time_s), 1))

    def _within(self, time_s: np.ndarray) -> np.ndarray:
        return np.asarray(np.clip(time_s, self.spline.t[0], self.spline.t[-1]))

    def covariance(self, jacobian: np.ndarray, time_s: np.ndarray, sums: np.ndarray) -> np.ndarray:
        """Return the covariance of sums over instants that the rows' noise causes.

        Parameters
        ----------
        jacobian
            (m, c, J) derivatives of c quantities by the joints, at m instants.
        time_s
            (m,) the instants.
        sums
            (b, m) weights of the instants in b sums.

        Returns
        -------
        (c b, c b), quantity by quantity.
        """
        basis = _basis(self._within(time_s), self.spline.t)
        count, joints = jacobian.shape[1], jacobian.shape[2]
        square = np.zeros((count * len(sums),) * 2)
        late = np.zeros((len(square), self.smoother.shape[2]))
        for joint in range(joints):
            share = np.concatenate([(sums * jacobian[:, axis, joint]) @ basis for axis in range(count)])
            square += share @ self.coefficient_covariance[joint] @ share.T
            if self.jitter_s > 0.0:
                late += (share @ self.smoother[joint]) * self.speed_rad_s[:, joint]
        return square + self.jitter_s**2 * (late @ late.T)

    def spurious_motion(self, jacobian: np.ndarray, time_s: np.ndarray, sums: np.ndarray) -> np.ndarray:
        """Return the contribution of the rows' noise to the velocities of the same sums (c b, J R), by row.

        Its outer product with itself is the covariance of the part of the velocities that is not motion.
        """
        each = scipy.interpolate.BSpline(self.spline.t, np.eye(self.spline.c.shape[0]), 3)
        rates = np.asarray(each(self._within(time_s), 1))
        found = []
        for joint in range(jacobian.shape[2]):
            share = np.concatenate([(sums * axis[:, joint]) @ rates for axis in jacobian.swapaxes(0, 1)])
            noise = np.hypot(self.encoder_rad[joint], self.jitter_s * self.speed_rad_s[:, joint])
            found.append(share @ self.smoother[joint] * noise)
        return np.concatenate(found, axis=1)


def joint_path(time_s: np.ndarray, q_rad: np.ndarray, span_s: tuple[float, float]) -> JointPath:
    """Fit the joints robustly.

    Parameters
    ----------
    time_s, q_rad
        (T,) strictly rising [s], (T, J) [rad].
    span_s
        Start and end of the needed span.

    Notes
    -----
    An interpolating spline follows the rows' noise, and its wiggles would pass for motion that determines the
    offset. Penalised splines (Eilers and Marx, Statistical Science 11, 1996) are as smooth as the log allows,
    bridge gaps, and show which rows are late or wrong: those deviate by more than the noise of encoders and
    time stamps explains. Rows that repeat the one before, in motion by more than an encoder's step, are
    always late and never early: they are left out however small their deviation.
    """
    near = (time_s >= span_s[0] - 4 * KNOT_S) & (time_s <= span_s[1] + 4 * KNOT_S)
    time_s, q_rad = time_s[near], q_rad[near]
    usual_s = float(np.median(np.diff(time_s)))
    pieces = max(4, round((time_s[-1] - time_s[0]) / max(KNOT_S, LEAST_ROWS * usual_s)))
    inner = np.linspace(time_s[0], time_s[-1], pieces + 1)
    knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
    basis = _basis(time_s, knots)
    weight = np.ones(len(time_s))
    repeated = np.concatenate([[False], (np.diff(q_rad, axis=0) == 0.0).all(axis=1)])
    for _ in range(ROUNDS):
        smoother, shape, kept_share = _smoother(basis, weight, q_rad)
        spline = scipy.interpolate.BSpline(knots, np.einsum("jcr,rj->cj", smoother, q_rad), 3)
        off, speed = q_rad - basis @ spline.c, spline(time_s, 1)
        # A spline that is free to follow the rows follows their noise.
        encoder, jitter_s = row_noise(off / kept_share, speed)
        apart = np.abs(off) / kept_share
        # Where the acceleration jumps, the splines miss all rows of a precise log for some knots by more than
        # its noise.
        missed = MAD * scipy.ndimage.median_filter(
            apart, size=(2 * round(len(time_s) / pieces) + 1, 1), mode="nearest"
        )
        apart /= np.maximum(np.hypot(encoder, jitter_s * np.abs(speed)), missed)
        pace = np.abs(speed).max(axis=1)
        stirring = (pace > STIRRING * pace.max()) & (usual_s * np.abs(speed) > GRID * encoder).any(axis=1)
        outlier = (apart.max(axis=1) > OUTLIER) | (repeated & stirring)
        weight = np.where(outlier, 1e-9, 1.0)
    covariance = shape * encoder[:, None, None] ** 2
    return JointPath(spline, covariance, smoother, encoder, jitter_s, speed, outlier)


def without_row_noise(time_s: np.ndarray, q_rad: np.ndarray) -> np.ndarray:
    """Return the joints (T, J) of a log on the smoothing splines; times (T,) rise strictly [s]."""
    return joint_path(time_s, q_rad, (float(time_s[0]), float(time_s[-1]))).at(time_s)


def _smoother(
    basis: np.ndarray, weight: np.ndarray, q_rad: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smooth each joint as much as maximises its restricted likelihood.

    Third differences of the coefficients are taken as normal (Wood, Journal of the Royal Statistical Society
    B 73, 2011).

    Returns
    -------
    The coefficients from the rows (J, C, R), their covariance over the noise's variance (J, C, C), and the
    share of the noise that the residuals keep (J,).
    """
    coefficients = basis.shape[1]
    third = np.diff(np.eye(coefficients), n=3, axis=0)
    gram = basis.T @ (weight[:, None] * basis)
    gram += RIDGE * float(np.trace(gram)) / coefficients * np.eye(coefficients)
    lower = np.linalg.cholesky(gram)
    half = scipy.linalg.solve_triangular(lower, third.T, lower=True)
    rough, turn = np.linalg.eigh(half @ half.T)
    rough = np.maximum(rough, 0.0)
    rough[:3] = 0.0
    back = scipy.linalg.solve_triangular(lower, turn, lower=True, trans="T")
    projected = back.T @ (basis.T @ (weight[:, None] * q_rad))
    counted = float((weight > 0.5).sum())
    power = (weight[:, None] * q_rad**2).sum(axis=0)
    kept = 1.0 / (1.0 + SMOOTHINGS[:, None] * rough)
    left = np.maximum(power - kept @ projected**2, 1e-15 * power)
    cost = (counted - 3.0) * np.log(left) - np.log(kept).sum(axis=1)[:, None]
    cost -= (coefficients - 3.0) * np.log(SMOOTHINGS)[:, None]
    best = kept[np.argmin(cost, axis=0)]
    shape = np.stack([(back * one) @ back.T for one in best])
    free = np.sqrt(np.maximum(1.0 - best.sum(axis=1) / counted, 0.1))
    return shape @ (basis.T * weight), shape, free


def _basis(time_s: np.ndarray, knots: np.ndarray) -> np.ndarray:
    return np.asarray(scipy.interpolate.BSpline.design_matrix(time_s, knots, 3).toarray())


def row_noise(off_rad: np.ndarray, speed_rad_s: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the noise of encoders (J,) [rad] and time stamps [s], from rows (R, J) at rest and in motion.

    At rest, a quantised encoder reports one constant value; slow rows show the noise of its steps as well.
    """
    pace = np.abs(speed_rad_s)
    most = pace.max(axis=1)
    top = max(float(most.max()), 1e-9)
    parts = [
        off_rad[some] for some in (most < STIRRING * top, (most >= STIRRING * top) & (most < SLOW * top))
    ]
    sizes = [MAD * np.median(np.abs(part), axis=0) for part in parts if len(part) >= LEAST_ROWS_FOR_NOISE]
    encoder = np.max(sizes or [MAD * np.median(np.abs(off_rad), axis=0)], axis=0)
    encoder = np.maximum(encoder, SMALLEST_NOISE_RAD)
    fast = pace > FAST * top
    late = MAD * float(np.median(np.abs(off_rad[fast]) / np.maximum(pace[fast], 1e-9)))
    square = late**2 - float(np.mean((encoder / np.maximum(pace, 1e-9))[fast] ** 2))
    return encoder, float(np.sqrt(max(square, 0.0)))
