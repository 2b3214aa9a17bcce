"""Grey levels between pixels."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def bilinear(image: np.ndarray, u: float, v: float) -> float:
    """Return the grey level at a place between pixels; the nearest edge's outside the picture."""
    rows, columns = image.shape
    u = min(max(u, 0.0), columns - 1.001)
    v = min(max(v, 0.0), rows - 1.001)
    i, j = int(v), int(u)
    fv, fu = v - i, u - j
    top = (1 - fu) * image[i, j] + fu * image[i, j + 1]
    bottom = (1 - fu) * image[i + 1, j] + fu * image[i + 1, j + 1]
    return (1 - fv) * top + fv * bottom
