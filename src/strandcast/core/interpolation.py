"""Interpolation in time."""

import numpy as np


def resampled(time_s: np.ndarray, known_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return columns (R, C) of values at other times (...), linear between samples and held at the ends."""
    return np.stack([np.interp(time_s, known_s, column) for column in values.T], axis=-1)


def lagrange_weights(time_s: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    """Return the weights (G, k) of samples at times (G, k) in the polynomial through them at times (G,)."""
    count = time_s.shape[1]
    weights = np.ones_like(time_s)
    for k in range(count):
        for other in set(range(count)) - {k}:
            weights[:, k] *= (wanted_s - time_s[:, other]) / (time_s[:, k] - time_s[:, other])
    return weights
