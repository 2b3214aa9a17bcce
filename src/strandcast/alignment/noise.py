"""Uncertainty of the fit: correlated errors along the hand's path, the log's noise, the priors."""

from dataclasses import dataclass

import numpy as np
import scipy

from strandcast.alignment.hand_bins import Binned, bin_hand
from strandcast.alignment.problem import ClockProblem

# Chosen.
REACH_M = 0.15  # prior mean of the path length over which slow errors change
REACH_FACTOR = 3.0  # one standard deviation of that prior, as a factor
SIZE_FACTOR = 10.0  # the same for the size of slow errors
EVALUATIONS = 120
LEAST_SHARE = 0.01
WIDER = 10.0  # factor on the priors that must not matter to an offset determined by the motion


@dataclass(frozen=True, eq=False)
class Refined:
    """The refined fit and its uncertainty, in units of x.

    Attributes
    ----------
    x, covariance
        (p,) and (p, p).
    unaided_se
        The offset's standard error if the rig's constants were known less well.
    true_share
        Share of the information on the offset that comes from motion, not from the log's noise.
    slow_m
        Size of slow errors of position.
    """

    x: np.ndarray
    covariance: np.ndarray
    unaided_se: float
    true_share: float
    slow_m: float


def refine(problem: ClockProblem, x: np.ndarray, sigma: np.ndarray) -> Refined:
    """Refine a robust fit x without outliers by generalised least squares, and estimate its uncertainty.

    Parameters
    ----------
    sigma
        (m, 3) noise of the detections.

    Notes
    -----
    Errors of the camera map, the lens and the marker corners are alike in neighbouring frames. They are
    modelled as processes along the hand's path with exponential correlation. Their size and reach maximise
    the restricted likelihood (Patterson and Thompson, Biometrika 58, 1971) under wide priors, which accounts
    for the part of the errors that the fit absorbs; an estimate from the residuals alone would not.
    """
    binned, inner = bin_hand(problem, x, sigma)
    more, more_slope = (np.concatenate(pair) for pair in zip(problem.event_residual(x), inner, strict=True))
    prior = problem.prior()
    expected = prior * (problem.expected - x) + more_slope.T @ more
    information = np.diag(prior) + more_slope.T @ more_slope
    grain = float(np.sqrt(np.median(np.diag(binned.noise))))
    start = np.log([grain, grain, REACH_M])

    def cost(logs: np.ndarray) -> float:
        away = (logs - start) / np.log([SIZE_FACTOR, SIZE_FACTOR, REACH_FACTOR])
        return 0.5 * float(away @ away) - restricted(binned, logs, information, expected)[0]

    best = scipy.optimize.minimize(
        cost, start, method="Nelder-Mead", options={"maxfev": EVALUATIONS, "xatol": 0.05, "fatol": 0.02}
    ).x
    _, step, covariance = restricted(binned, best, information, expected)
    share = _true_share(binned, best, information, covariance)
    covariance = covariance / share
    loose = np.diag(problem.prior(WIDER)) + more_slope.T @ more_slope
    unaided = restricted(binned, best, loose, expected)[2]
    unaided = unaided / _true_share(binned, best, loose, unaided)
    return Refined(
        x + step,
        covariance,
        float(np.sqrt(unaided[0, 0])),
        share,
        float(np.exp(best[0])),
    )


def _true_share(binned: Binned, logs: np.ndarray, information: np.ndarray, covariance: np.ndarray) -> float:
    """Return the share of the information on the offset that comes from motion, not from the log's noise.

    The noise of the log's rows wiggles the predicted path, and wiggles that are no motion add information on
    the offset in the formulas only (errors in variables: Fuller, Measurement Error Models, 1987). They matter
    where the hand moves evenly.
    """
    lower = scipy.linalg.cho_factor(noise_of(binned, logs), lower=True)
    false = scipy.linalg.cho_solve(lower, binned.spurious)
    others = binned.slope[:, 1:]
    weighted = scipy.linalg.cho_solve(lower, others)
    normal = information[1:, 1:] + others.T @ weighted
    pull = weighted.T @ binned.spurious
    spurious = (binned.spurious * false).sum() - (pull * np.linalg.solve(normal, pull)).sum()
    return float(max(1.0 - spurious * covariance[0, 0], LEAST_SHARE))


def restricted(
    binned: Binned, logs: np.ndarray, information: np.ndarray, expected: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Return restricted log likelihood, step of x (p,) and covariance (p, p) for given slow errors.

    Parameters
    ----------
    logs
        Logarithms of the size of position errors [m], angle errors [m at the lever], and their reach [m].
    information, expected
        (p, p) information of priors and events, and (p,) their gradient.
    """
    lower = scipy.linalg.cho_factor(noise_of(binned, logs), lower=True)
    weighted = scipy.linalg.cho_solve(lower, np.column_stack([binned.slope, binned.off]))
    normal = information + binned.slope.T @ weighted[:, :-1]
    pull = expected + binned.slope.T @ weighted[:, -1]
    covariance = np.linalg.inv(normal)
    step = covariance @ pull
    likelihood = (
        -np.log(np.diag(lower[0])).sum()
        - 0.5 * np.linalg.slogdet(normal)[1]
        - 0.5 * (binned.off @ weighted[:, -1] - pull @ step)
    )
    return float(likelihood), step, covariance


def noise_of(binned: Binned, logs: np.ndarray) -> np.ndarray:
    """Return the covariance (3 b, 3 b) of the binned residual, slow errors included."""
    place, turn, reach = np.exp(logs)
    bins = len(binned.path_m)
    alike = np.exp(-np.abs(binned.path_m[:, None] - binned.path_m) / reach)
    noise = binned.noise.copy()
    for axis, size in enumerate((place, place, turn)):
        block = slice(axis * bins, (axis + 1) * bins)
        noise[block, block] += size**2 * alike
    return noise
