"""A marker tracked by its square: corners and black border, without decoding it."""

import numpy as np
from numba import njit

from strandcast.camera.marker_sides import bilinear, refine_square

CELLS = 6  # along the side of a 4x4 marker, border included
BORDER_PLACES = 8  # chosen: along each side, where the border is sampled
LEAST_BORDER = 25.0  # chosen: grey levels between a marker's black border and the white around it


@njit(cache=True, nogil=True)
def follow_square(crop: np.ndarray, corners_px: np.ndarray, cells: int) -> np.ndarray:
    """Return a marker's corners (4, 2) near the expected ones; NaN if it is not there."""
    refined: np.ndarray = refine_square(crop, corners_px, cells)
    if np.isfinite(refined).all() and has_border(crop, refined):
        return refined
    return np.full((4, 2), np.nan)


@njit(cache=True)
def has_border(crop: np.ndarray, corners_px: np.ndarray) -> bool:
    """Return whether a marker's black border and the white around it show along most of its sides."""
    centre_u, centre_v = corners_px[:, 0].mean(), corners_px[:, 1].mean()
    shown = 0
    for side in range(4):
        start, end = corners_px[side], corners_px[(side + 1) % 4]
        for k in range(BORDER_PLACES):
            share = (k + 0.5) / BORDER_PLACES
            u, v = start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])
            in_u, in_v = (centre_u - u) / (0.5 * CELLS), (centre_v - v) / (0.5 * CELLS)  # a cell, mid-side
            black = bilinear(crop, u + 0.5 * in_u, v + 0.5 * in_v)
            shown += bilinear(crop, u - 0.4 * in_u, v - 0.4 * in_v) - black > LEAST_BORDER
    return shown > 0.8 * 4 * BORDER_PLACES
