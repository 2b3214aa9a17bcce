"""The covariance of the lens parameters that the board photos leave."""

from collections.abc import Sequence

import numpy as np

from strandcast.camera.distortion import LensFit
from strandcast.camera.projection import project_points
from strandcast.camera.views import BoardCorners

ALWAYS_FREE = ("k1", "k2", "p1", "p2")
# Chosen weak priors, one standard deviation: focal length relative to itself, centre to the picture's width.
FOCAL_SD, CENTRE_SD = 0.3, 0.05
PRIOR_SD = {"k1": 0.3, "k2": 0.5, "p1": 3e-3, "p2": 3e-3, "k3": 1.0, "k4": 1.0, "k5": 1.0, "k6": 1.0}


def lens_covariance(
    views: Sequence[BoardCorners], fit: LensFit, size: tuple[int, int], groups: np.ndarray | None = None
) -> np.ndarray:
    """Return the covariance of fx, fy, cx, cy and the distortion, a square with a side of 8, 9 or 12.

    k1, k2, p1 and p2 are free here even if the fit has fewer: a coefficient that was not worth fitting is
    not known to be zero. Weak priors keep undetermined parameters finite. Photos of one pose, by `groups`
    (`views.pose_groups`), count as one.
    """
    names = fit.names()
    free = np.array([name in ALWAYS_FREE + fit.free() for name in names])
    information = _information(views, fit, groups)[np.ix_(free, free)]
    information += np.diag(1.0 / _prior_sd(fit, names, size)[free] ** 2)
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_(free, free)] = np.linalg.inv(information)
    return covariance


def repeat_inflation(views: Sequence[BoardCorners], fit: LensFit, groups: np.ndarray) -> np.ndarray:
    """Return the factors on the standard errors of a fit (n,) because photos of one pose count as one.

    Such photos share the errors of board and model, so that their mean is no better than one of them.
    """
    factors = np.ones(len(fit.standard_errors))
    if groups.max() + 1 < len(groups):
        free = np.isin(fit.names(), fit.free())
        each, once = (
            np.diag(np.linalg.pinv(_information(views, fit, by)[np.ix_(free, free)])) for by in (None, groups)
        )
        factors[free] = np.sqrt(once / each)
    return factors


def _information(views: Sequence[BoardCorners], fit: LensFit, groups: np.ndarray | None) -> np.ndarray:
    """Return the normal equations of all corners with the boards' poses eliminated (Schur complement)."""
    count = len(fit.names())
    weights = np.ones(len(views)) if groups is None else 1.0 / np.bincount(groups)[groups]
    information = np.zeros((count, count))
    poses = zip(views, fit.rotations, fit.translations_m, weights, strict=True)
    for corners, rotation, translation, weight in poses:
        _, jacobian = project_points(corners.board_m, rotation, translation, fit.matrix, fit.distortion)
        pose, lens = jacobian[:, :6], jacobian[:, 6:]
        cross = pose.T @ lens
        information += weight * (lens.T @ lens - cross.T @ np.linalg.solve(pose.T @ pose, cross))
    return information / corner_variance(fit)


def corner_variance(fit: LensFit) -> float:
    """Return the variance [px²] of a corner in u or v, from residuals and degrees of freedom."""
    residuals = np.concatenate(fit.residuals_px)
    fitted = len(fit.free()) + 6 * len(fit.residuals_px)
    return float((residuals**2).sum() / max(residuals.size - fitted, 1))


def _prior_sd(fit: LensFit, names: tuple[str, ...], size: tuple[int, int]) -> np.ndarray:
    pinhole = {
        "fx": FOCAL_SD * fit.matrix[0, 0],
        "fy": FOCAL_SD * fit.matrix[1, 1],
        "cx": CENTRE_SD * size[0],
        "cy": CENTRE_SD * size[0],
    }
    return np.array([(pinhole | PRIOR_SD)[name] for name in names])
