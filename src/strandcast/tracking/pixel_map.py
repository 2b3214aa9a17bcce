"""Fast projection from the string's plane to pixels: the camera's map tabulated on a grid."""

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.camera.mapping import metre_to_pixel, pixel_to_metre
from strandcast.records.camera import Camera

# Between grid points the map is bilinear; with 20 mm and a lens of k1 = -0.12 accurate to 0.01 px (tested).
GRID_M = 0.02


class PixelMap(NamedTuple):
    """A camera's map from the string's plane to pixels."""

    origin_m: np.ndarray  # world position of the grid's first point, (2,)
    step_m: float  # spacing of the grid
    uv: np.ndarray  # pixel of each grid point, (rows, columns, 2)
    metre_per_pixel: float  # at the centre of the image


def tabulate(camera: Camera, offset_m: float) -> PixelMap:
    """Tabulate a camera's map over the part of a plane that the image shows.

    `offset_m` is the height of the plane above that of the board's markers, towards the camera.
    """
    width, height = camera.lens.width_px, camera.lens.height_px
    u, v = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9))
    shown_m = pixel_to_metre(camera, np.stack([u.ravel(), v.ravel()], axis=1), offset_m)
    low = shown_m.min(axis=0) - 2 * GRID_M
    high = shown_m.max(axis=0) + 2 * GRID_M
    x = np.arange(low[0], high[0] + GRID_M, GRID_M)
    y = np.arange(low[1], high[1] + GRID_M, GRID_M)
    grid_m = np.stack(np.meshgrid(x, y), axis=2)
    uv = metre_to_pixel(camera, grid_m.reshape(-1, 2), offset_m).reshape(grid_m.shape)
    middle = np.array([[width / 2, height / 2], [width / 2 + 1, height / 2]])
    across_m = pixel_to_metre(camera, middle, offset_m)
    scale = float(np.linalg.norm(across_m[1] - across_m[0]))
    return PixelMap(np.ascontiguousarray(low), GRID_M, np.ascontiguousarray(uv), scale)


@njit(cache=True)
def to_pixel(x: float, y: float, plane: PixelMap) -> tuple[float, float]:
    """Return the pixel (u, v) of a world point (m); (-1e3, -1e3) far outside the image."""
    uv = plane.uv
    rows, columns = uv.shape[0], uv.shape[1]
    gx = (x - plane.origin_m[0]) / plane.step_m
    gy = (y - plane.origin_m[1]) / plane.step_m
    if not (gx >= 0.0 and gy >= 0.0 and gx < columns - 1 and gy < rows - 1):
        return -1e3, -1e3
    i, j = int(gy), int(gx)
    fy, fx = gy - i, gx - j
    w00, w01, w10, w11 = (1 - fy) * (1 - fx), (1 - fy) * fx, fy * (1 - fx), fy * fx
    u = w00 * uv[i, j, 0] + w01 * uv[i, j + 1, 0] + w10 * uv[i + 1, j, 0] + w11 * uv[i + 1, j + 1, 0]
    v = w00 * uv[i, j, 1] + w01 * uv[i, j + 1, 1] + w10 * uv[i + 1, j, 1] + w11 * uv[i + 1, j + 1, 1]
    return u, v


@njit(cache=True)
def from_pixel(u: float, v: float, near: np.ndarray, plane: PixelMap) -> tuple[float, float]:
    """Return the world point (m) of a pixel, by Newton's method from the world point `near` (2,)."""
    x, y = near[0], near[1]
    small = 0.1 * plane.step_m
    for _ in range(5):
        u0, v0 = to_pixel(x, y, plane)
        ux, vx = to_pixel(x + small, y, plane)
        uy, vy = to_pixel(x, y + small, plane)
        a, b, c, d = (ux - u0) / small, (uy - u0) / small, (vx - v0) / small, (vy - v0) / small
        determinant = a * d - b * c
        x += (d * (u - u0) - b * (v - v0)) / determinant
        y += (a * (v - v0) - c * (u - u0)) / determinant
    return x, y


@njit(cache=True)
def all_from_pixel(places_px: np.ndarray, near: np.ndarray, plane: PixelMap) -> np.ndarray:
    """Return the world points (K, 2) (m) of pixels (K, 2), all near one world point."""
    points = np.empty_like(places_px)
    for k in range(len(places_px)):
        points[k, 0], points[k, 1] = from_pixel(places_px[k, 0], places_px[k, 1], near, plane)
    return points
