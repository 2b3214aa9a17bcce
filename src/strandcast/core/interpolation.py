"""Interpolation in time."""

import numpy as np


def lagrange_weights(time_s: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    """Return the weights (G, k) of samples at times (G, k) in the polynomial through them at times (G,)."""
    count = time_s.shape[1]
    weights = np.ones_like(time_s)
    for k in range(count):
        for other in set(range(count)) - {k}:
            weights[:, k] *= (wanted_s - time_s[:, other]) / (time_s[:, k] - time_s[:, other])
    return weights
