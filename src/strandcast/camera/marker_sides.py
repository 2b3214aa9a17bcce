"""A marker's corners from lines fitted to its four sides: more precise than detecting the corners."""

import numpy as np
from numba import njit

POINTS_PER_SIDE = 24  # chosen
END_SHARE = 0.12  # chosen: share of a side at each end that blur at the corner rounds
REACH_CELLS = 0.5  # chosen: to each side of an edge, in cells
PITCH_PX = 0.25  # chosen: between samples across an edge
MIN_CONTRAST = 25.0  # chosen: grey levels between dark and white
OUTLIER_PX = 0.6  # chosen: distance of an edge point from the fitted line


@njit(cache=True)
def refine_square(image: np.ndarray, corners: np.ndarray, cells: int) -> np.ndarray:
    """Return the corners (4, 2) [px] of a dark square on white from lines fitted to its sides.

    The given `corners` (4, 2) are accurate to a pixel or two, in order around the square. Along a side lie so
    many `cells`: the edge is searched within half of one. NaN if a side is not visible.
    """
    refined = corners.copy()
    for _ in range(2):
        centre = np.array([refined[:, 0].mean(), refined[:, 1].mean()])
        lines = np.empty((4, 3))  # u cos + v sin = distance
        for side in range(4):
            line = fit_side(image, refined[side], refined[(side + 1) % 4], centre, cells)
            lines[side, 0], lines[side, 1], lines[side, 2] = line
        for corner in range(4):
            a, b = lines[corner - 1], lines[corner]
            determinant = a[0] * b[1] - a[1] * b[0]
            refined[corner, 0] = (a[2] * b[1] - b[2] * a[1]) / determinant
            refined[corner, 1] = (a[0] * b[2] - b[0] * a[2]) / determinant
        if not np.isfinite(refined).all():
            break
    return refined


@njit(cache=True, inline="always")
def fit_side(
    image: np.ndarray, start: np.ndarray, end: np.ndarray, centre: np.ndarray, cells: int
) -> tuple[float, float, float]:
    """Return the line (normal u, normal v, distance) of one side; NaN if most of it is not visible."""
    length = np.hypot(end[0] - start[0], end[1] - start[1])
    du, dv = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    nu, nv = dv, -du
    if (start[0] - centre[0]) * nu + (start[1] - centre[1]) * nv < 0:
        nu, nv = -nu, -nv
    reach = max(1.5, REACH_CELLS * length / cells)
    along = np.empty(POINTS_PER_SIDE)
    off = np.empty(POINTS_PER_SIDE)
    count = 0
    for i in range(POINTS_PER_SIDE):
        share = END_SHARE + (1 - 2 * END_SHARE) * i / (POINTS_PER_SIDE - 1)
        u, v = start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])
        edge = edge_across(image, u, v, nu, nv, reach)
        if np.isfinite(edge):
            along[count], off[count] = share * length, edge
            count += 1
    if count < POINTS_PER_SIDE // 2:
        return np.nan, np.nan, np.nan
    place, slope = 0.0, 0.0
    kept = np.ones(count, dtype=np.bool_)
    for _ in range(3):
        place, slope = line_through(along[:count][kept], off[:count][kept])
        kept = np.abs(off[:count] - place - slope * along[:count]) < OUTLIER_PX
        if kept.sum() < POINTS_PER_SIDE // 2:
            return np.nan, np.nan, np.nan
    u0, v0 = start[0] + place * nu, start[1] + place * nv
    tu, tv = du + slope * nu, dv + slope * nv
    norm = np.hypot(tu, tv)
    return tv / norm, -tu / norm, (tv * u0 - tu * v0) / norm


@njit(cache=True)
def edge_across(image: np.ndarray, u: float, v: float, nu: float, nv: float, reach: float) -> float:
    """Return the outward offset [px] at which the level crosses the middle between dark and white, or NaN."""
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
    if outer - inner < MIN_CONTRAST:
        return np.nan
    before = inner
    for k in range(-steps, steps + 1):
        now = bilinear(image, u + k * PITCH_PX * nu, v + k * PITCH_PX * nv)
        if now >= half > before:
            return (k - (now - half) / (now - before)) * PITCH_PX
        before = now
    return np.nan


@njit(cache=True, inline="always")
def line_through(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return intercept and slope of the least-squares line."""
    mean_x, mean_y = x.mean(), y.mean()
    slope = ((x - mean_x) * (y - mean_y)).sum() / max(((x - mean_x) ** 2).sum(), 1e-12)
    return mean_y - slope * mean_x, slope


@njit(cache=True)
def bilinear(image: np.ndarray, u: float, v: float) -> float:
    """Return the interpolated grey level at (u, v); outside the picture, that of the nearest edge."""
    rows, columns = image.shape
    u = min(max(u, 0.0), columns - 1.001)
    v = min(max(v, 0.0), rows - 1.001)
    i, j = int(v), int(u)
    fv, fu = v - i, u - j
    top = (1 - fu) * image[i, j] + fu * image[i, j + 1]
    bottom = (1 - fu) * image[i + 1, j] + fu * image[i + 1, j + 1]
    return float((1 - fv) * top + fv * bottom)
