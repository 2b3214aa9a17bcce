"""A marker's corners from its four sides: a line is known better than a corner."""

from __future__ import annotations

import numpy as np
from numba import njit

from strandcast.camera.sampling import bilinear

PLACES = 24  # along each side
SPARE = 0.12  # of a side at either end, where the corner rounds the edge
REACH_CELLS = 0.5  # to either side of an edge, in cells
PITCH_PX = 0.25
OUTLIER_PX = 0.6


@njit(cache=True)
def refine_square(image: np.ndarray, corners: np.ndarray, cells: int) -> np.ndarray:
    """Return the corners (4, 2) px of a dark square on white, from lines fitted to its sides.

    Parameters
    ----------
    image
        Grey picture.
    corners
        Corners to a pixel or two, in order around the square, (4, 2).
    cells
        Cells along a side: the edge is looked for within half a cell.

    Returns
    -------
    ndarray (4, 2)
        NaN where a side is not seen.
    """
    refined = corners.copy()
    for _ in range(2):
        centre = np.array([refined[:, 0].mean(), refined[:, 1].mean()])
        lines = np.empty((4, 3))  # u cos + v sin = distance
        for side in range(4):
            lines[side] = fit_side(image, refined[side], refined[(side + 1) % 4], centre, cells)
        for corner in range(4):
            a, b = lines[corner - 1], lines[corner]
            determinant = a[0] * b[1] - a[1] * b[0]
            refined[corner, 0] = (a[2] * b[1] - b[2] * a[1]) / determinant
            refined[corner, 1] = (a[0] * b[2] - b[0] * a[2]) / determinant
        if not np.isfinite(refined).all():
            break
    return refined


@njit(cache=True)
def fit_side(
    image: np.ndarray, start: np.ndarray, end: np.ndarray, centre: np.ndarray, cells: int
) -> np.ndarray:
    """Return the line (normal u, normal v, distance) of one side; NaN where most of it is not seen."""
    length = np.hypot(end[0] - start[0], end[1] - start[1])
    du, dv = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    nu, nv = dv, -du
    if (start[0] - centre[0]) * nu + (start[1] - centre[1]) * nv < 0:
        nu, nv = -nu, -nv
    reach = max(1.5, REACH_CELLS * length / cells)
    along = np.empty(PLACES)
    off = np.empty(PLACES)
    count = 0
    for i in range(PLACES):
        share = SPARE + (1 - 2 * SPARE) * i / (PLACES - 1)
        u, v = start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])
        edge = edge_across(image, u, v, nu, nv, reach)
        if np.isfinite(edge):
            along[count], off[count] = share * length, edge
            count += 1
    if count < PLACES // 2:
        return np.full(3, np.nan)
    place, slope = 0.0, 0.0
    kept = np.ones(count, dtype=np.bool_)
    for _ in range(3):
        place, slope = line_through(along[:count][kept], off[:count][kept])
        kept = np.abs(off[:count] - place - slope * along[:count]) < OUTLIER_PX
        if kept.sum() < PLACES // 2:
            return np.full(3, np.nan)
    u0, v0 = start[0] + place * nu, start[1] + place * nv
    tu, tv = du + slope * nu, dv + slope * nv
    norm = np.hypot(tu, tv)
    return np.array([tv / norm, -tu / norm, (tv * u0 - tu * v0) / norm])


@njit(cache=True)
def edge_across(image: np.ndarray, u: float, v: float, nu: float, nv: float, reach: float) -> float:
    """Return how far outwards (px) the level crosses half way from dark to white; NaN where it does not."""
    steps = int(reach / PITCH_PX)
    inner = (
        bilinear(image, u - reach * nu, v - reach * nv)
        + bilinear(image, u - 0.8 * reach * nu, v - 0.8 * reach * nv)
    ) / 2
    outer = (
        bilinear(image, u + reach * nu, v + reach * nv)
        + bilinear(image, u + 0.8 * reach * nu, v + 0.8 * reach * nv)
    ) / 2
    half = 0.5 * (inner + outer)
    if outer - inner < 25.0:
        return np.nan
    before = inner
    for k in range(-steps, steps + 1):
        now = bilinear(image, u + k * PITCH_PX * nu, v + k * PITCH_PX * nv)
        if now >= half > before:
            return (k - (now - half) / (now - before)) * PITCH_PX
        before = now
    return np.nan


@njit(cache=True)
def line_through(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return place and slope of the least-squares line."""
    mean_x, mean_y = x.mean(), y.mean()
    slope = ((x - mean_x) * (y - mean_y)).sum() / max(((x - mean_x) ** 2).sum(), 1e-12)
    return mean_y - slope * mean_x, slope
