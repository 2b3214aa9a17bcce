"""Distance between simulated and measured string: eqs. (4) to (6) of the paper.

Eq. (4) is read as x_r - x_s and y_r - y_s; its print pairs x with y. Points not measured have no weight.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
W = 0.1  # eq. 6, of strings in the plane; chosen, not sensitive: the search's end counts for more


def differences(measured: Array, simulated: Array, reading: str = "world") -> Array:
    """Measured minus simulated points in every frame (..., F, n+1, 2 or 3) [m].

    Parameters
    ----------
    measured
        (F, n+1, 2 or 3) measured points [m], NaN where not measured.
    simulated
        (..., F, n+1, 2 or 3) simulated points [m].
    reading
        ``world``, or ``hand``: both relative to their own hand, as the paper centres its images. A frame
        whose hand was not measured is compared in the world.
    """
    difference = measured - simulated
    if reading == "hand":
        difference = difference - np.where(np.isnan(difference[..., :1, :]), 0.0, difference[..., :1, :])
    return difference


def distances(measured: Array, simulated: Array, reading: str = "world") -> Array:
    """Distance of every free point in every frame, eq. (4); see `differences`.

    Returns
    -------
    (..., F, n) distances of points 1…n [m], NaN where not measured, infinite where measured but not
    simulated (a blow-up).
    """
    distance = lengths(differences(measured, simulated, reading)[..., 1:, :])
    lost = np.isnan(distance) & ~np.isnan(measured[:, 1:]).any(axis=-1)
    return np.asarray(np.where(lost, np.inf, distance))


def lengths(vectors: Array) -> Array:
    """Return the lengths (...) of vectors (..., 2 or 3)."""
    length = np.hypot(vectors[..., 0], vectors[..., 1])
    for axis in range(2, vectors.shape[-1]):
        length = np.hypot(length, vectors[..., axis])
    return np.asarray(length)


def point_values(distance: Array, confidence: Array | None = None) -> Array:
    """Mean distance of each point over the frames, E_i of eq. (5).

    Parameters
    ----------
    distance
        (..., F, n) [m], NaN where not measured.
    confidence
        (F, n) weights of the measurements, None for equal ones.

    Returns
    -------
    (..., n) [m]; NaN for a point never measured.
    """
    weight = np.ones(distance.shape[-2:]) if confidence is None else confidence
    weights = np.where(np.isnan(distance), 0.0, weight)
    total = weights.sum(axis=-2)
    summed = (weights * np.where(weights > 0, distance, 0.0)).sum(axis=-2)
    return np.asarray(np.divide(summed, total, out=np.full_like(summed, np.nan), where=total > 0))


def evaluation_of_points(values: Array, w: float = 0.0) -> Array:
    """E of eq. (6) from the E_i: weighted by 1 + w (i - 1), mean over the measured points.

    Parameters
    ----------
    values
        (..., n) E_i of points 1…n [m], NaN for points never measured.
    w
        Weight towards the tip; the paper does not print it. Reported values use 0.
    """
    factor = 1.0 + w * np.arange(values.shape[-1])
    measured = ~np.isnan(values)
    count = measured.sum(axis=-1)
    summed = np.where(measured, values * factor, 0.0).sum(axis=-1)
    return np.asarray(np.divide(summed, count, out=np.full(np.shape(summed), np.nan), where=count > 0))


def rmse(distance: Array) -> float:
    """Root mean square of all measured distances, each with the same weight [m]."""
    return float(np.sqrt(np.nanmean(distance**2)))


def tip_error(distance: Array) -> float:
    """Mean distance of the tip over the frames in which it was measured [m]; NaN if there are none."""
    tip = distance[:, -1][~np.isnan(distance[:, -1])]
    return float(tip.mean()) if len(tip) else float("nan")
