"""The noise of a tracked hand: white, and a part that neighbouring frames share, as residuals show it."""

from collections.abc import Iterator

import numpy as np
import scipy

# Tried: shares of the variance that frames share, and for how long. The shortest is the tracker's
# (docs/explanation/tracking.md); slow errors, of the lens or of a marker that turns, pass for a wrong arm.
SHARES = (0.3, 0.6, 0.9, 0.98)
TIMES_S = (0.016, 0.05, 0.15, 0.4)
LEAST_POINT_M = 1e-4  # a marker's place is no better, whatever the residuals say; chosen


def noise_root(off_m: np.ndarray, columns: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return L (F, F) of the noise's covariance L Lᵀ [m²], the same along x and y.

    Share and time are those of the largest restricted likelihood, which counts what the fit absorbs.

    Parameters
    ----------
    off_m, columns
        (F, 2) deviations, and (F, 2, c) what may explain them: the noise is what it leaves.
    time_s
        (F,) of the frames.
    """
    frames = len(time_s)
    norms = np.sqrt((columns**2).sum(axis=(0, 1)))
    norms = np.where(norms > 0.0, norms, 1.0)
    basis, size, _ = np.linalg.svd(columns.reshape(2 * frames, -1) / norms, full_matrices=False)
    basis = basis[:, size > 1e-9 * size[0]]
    free = 2 * frames - basis.shape[1]
    best, found = -np.inf, np.zeros((frames, frames))
    for root in _roots(time_s):
        known, off = whitened(root, basis.reshape(frames, 2, -1)), whitened(root, off_m[:, :, None])[:, 0]
        square, target = known.T @ known, known.T @ off
        left = max(float(off @ off - target @ np.linalg.solve(square, target)) / free, 1e-30)
        log = -2.0 * float(np.log(np.diag(root)).sum())  # of both axes
        log -= 0.5 * (float(np.linalg.slogdet(square)[1]) + free * np.log(left))
        if log > best:
            best, found = log, root * max(np.sqrt(left), LEAST_POINT_M)
    return found


def whitened(root: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values (F, 2, c) over the noise, as rows (2 F, c)."""
    rows = scipy.linalg.solve_triangular(root, values.reshape(len(values), -1), lower=True)
    return np.asarray(rows.reshape(2 * len(values), -1))


def _roots(time_s: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the roots of correlations (F, F): white, and each share and time."""
    apart_s = np.abs(time_s[:, None] - time_s)
    for shared_s in TIMES_S:
        alike = np.exp(-apart_s / shared_s)
        for share in SHARES:
            yield np.linalg.cholesky(share * alike + (1.0 - share) * np.eye(len(time_s)))
