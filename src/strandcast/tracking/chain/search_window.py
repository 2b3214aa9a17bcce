"""The search window of one frame: pixels, the empty scene behind them, the plane of motion, the hand."""

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.pixel_map import PixelMap, to_pixel

CAMOUFLAGE_SHARE = 0.4  # chosen: of the contrast, by which the background must differ from the string
GAP_PX = 1.0  # chosen: between a line's core and its flanks, for the lens blur
COVER_NOISES = 3.0  # chosen: change of both flanks, in noise sigmas, that means something covers the string
LEAST_COVER = 5.0  # chosen: and in grey levels


class HandBox(NamedTuple):
    """Where visible lines are not string: the hand's pose, and a box around it in its own frame."""

    x_m: float
    y_m: float
    angle_rad: float
    low_x_m: float
    low_y_m: float
    high_x_m: float
    high_y_m: float


class SearchWindow(NamedTuple):
    """The part of a frame in which the string is searched, as kernels take it."""

    image: np.ndarray  # grey pixels
    left: int  # where the first one lies in the whole frame
    top: int
    background: np.ndarray  # the whole scene without arm and string
    plane: PixelMap  # the string's plane in the whole frame
    hand_box: HandBox


@njit(cache=True)
def levels_at(window: SearchWindow, u: float, v: float) -> tuple[float, float]:
    """Return the bilinear grey levels of image and background; outside, those of the nearest edge."""
    image, background = window.image, window.background
    rows, columns = image.shape
    u = min(max(u - window.left, 0.0), columns - 1.001)
    v = min(max(v - window.top, 0.0), rows - 1.001)
    i, j = int(v), int(u)
    fv, fu = v - i, u - j
    w00, w01, w10, w11 = (1 - fv) * (1 - fu), (1 - fv) * fu, fv * (1 - fu), fv * fu
    # Unsigned: numba checks signed indices for counts from the end.
    one = np.uintp(1)
    a, b = np.uintp(i), np.uintp(j)
    now = w00 * image[a, b] + w01 * image[a, b + one]
    now = now + w10 * image[a + one, b] + w11 * image[a + one, b + one]
    a, b = np.uintp(i + window.top), np.uintp(j + window.left)
    was = w00 * background[a, b] + w01 * background[a, b + one]
    was += w10 * background[a + one, b] + w11 * background[a + one, b + one]
    return now, was


@njit(cache=True)
def corner_levels(window: SearchWindow, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return room (4, count) for the grey levels around places, in image and background."""
    return np.empty((4, count), dtype=window.image.dtype), np.empty((4, count), dtype=window.background.dtype)


@njit(cache=True)
def add_levels(
    window: SearchWindow,
    u: np.ndarray,
    v: np.ndarray,
    share: float,
    now: np.ndarray,
    was: np.ndarray,
    corners: tuple[np.ndarray, np.ndarray],
) -> None:
    """Add a share of the `levels_at` of many pixels (K,) to now and was (K,); u and v are used up.

    Step by step, so that all but the reading of pixels takes many places at a time.
    """
    image, background, left, top = window.image, window.background, window.left, window.top
    rows, columns = image.shape
    of_image, of_background = corners
    one = np.uintp(1)
    for k in range(len(u)):
        u[k] = min(max(u[k] - left, 0.0), columns - 1.001)
        v[k] = min(max(v[k] - top, 0.0), rows - 1.001)
    for k in range(len(u)):
        i, j = int(v[k]), int(u[k])
        a, b = np.uintp(i), np.uintp(j)
        of_image[0, k], of_image[1, k] = image[a, b], image[a, b + one]
        of_image[2, k], of_image[3, k] = image[a + one, b], image[a + one, b + one]
        a, b = np.uintp(i + top), np.uintp(j + left)
        of_background[0, k], of_background[1, k] = background[a, b], background[a, b + one]
        of_background[2, k], of_background[3, k] = background[a + one, b], background[a + one, b + one]
    for k in range(len(u)):
        fv, fu = v[k] - np.int32(v[k]), u[k] - np.int32(u[k])
        w00, w01, w10, w11 = (1 - fv) * (1 - fu), (1 - fv) * fu, fv * (1 - fu), fv * fu
        level = w00 * of_image[0, k] + w01 * of_image[1, k] + w10 * of_image[2, k] + w11 * of_image[3, k]
        behind = w00 * of_background[0, k] + w01 * of_background[1, k]
        behind += w10 * of_background[2, k] + w11 * of_background[3, k]
        now[k] += share * level
        was[k] += share * behind


@njit(cache=True)
def is_outside(window: SearchWindow, u: float, v: float, margin: float) -> bool:
    """Return whether a pixel is outside the window, or closer than `margin` to its edge."""
    rows, columns = window.image.shape
    j, i = u - window.left, v - window.top
    return not (margin <= j < columns - 1 - margin and margin <= i < rows - 1 - margin)


@njit(cache=True)
def near_box(x: float, y: float, box: HandBox, margin_m: float) -> bool:
    """Return whether a place (m) may be within `margin_m` of a box; faster than `inside_box`."""
    reach = np.hypot(max(-box.low_x_m, box.high_x_m), max(-box.low_y_m, box.high_y_m)) + margin_m
    return bool((x - box.x_m) ** 2 + (y - box.y_m) ** 2 <= reach * reach)


@njit(cache=True)
def inside_box(x: float, y: float, box: HandBox) -> bool:
    """Return whether a place (m) lies in a box.

    The hand's markers are full of thin lines, and the hand hides the string: lines there are not the string.
    """
    cosine, sine = np.cos(box.angle_rad), np.sin(box.angle_rad)
    dx, dy = x - box.x_m, y - box.y_m
    along, left = cosine * dx + sine * dy, -sine * dx + cosine * dy
    return bool(box.low_x_m <= along <= box.high_x_m and box.low_y_m <= left <= box.high_y_m)


@njit(cache=True)
def is_covered(
    window: SearchWindow, u: float, v: float, nu: float, nv: float, half_px: float, noise: float
) -> bool:
    """Return whether both flanks of a line at a pixel, with normal (nu, nv), differ from the background."""
    least = max(COVER_NOISES * noise, LEAST_COVER)
    for side in (-1.0, 1.0):
        changed = 0.0
        for a in range(3):
            d = side * (half_px + GAP_PX + 1.0 + a)
            now, was = levels_at(window, u + d * nu, v + d * nv)
            changed += (now - was) / 3.0
        if abs(changed) < least:
            return False
    return True


@njit(cache=True)
def is_camouflaged(window: SearchWindow, u: float, v: float, appearance: Appearance) -> bool:
    """Return whether the background at a pixel is so similar to the string that it would not be visible."""
    if not np.isfinite(appearance.level):
        return False
    was = levels_at(window, u, v)[1]
    spare = CAMOUFLAGE_SHARE * appearance.contrast
    low = -np.inf if appearance.polarity < 0 else appearance.level - spare
    high = np.inf if appearance.polarity > 0 else appearance.level + spare
    return bool(low <= was <= high)


@njit(cache=True)
def hidden_nodes(
    window: SearchWindow, nodes: np.ndarray, normals: np.ndarray, half_px: np.ndarray, appearance: Appearance
) -> np.ndarray:
    """Return which nodes (K,) cannot be visible: behind hand or arm, camouflaged, or outside the window.

    The arm has changed the image on both sides of the place where the string would be.
    """
    plane = window.plane
    offset_m = 0.5 * plane.metre_per_pixel
    hidden = np.zeros(len(nodes), dtype=np.bool_)
    for k in range(len(nodes)):
        x, y = nodes[k]
        u, v = to_pixel(x, y, plane)
        hidden[k] = inside_box(x, y, window.hand_box) or is_outside(window, u, v, 1.0)
        if not hidden[k]:
            u1, v1 = to_pixel(x + offset_m * normals[k, 0], y + offset_m * normals[k, 1], plane)
            hidden[k] = is_covered(window, u, v, 2 * (u1 - u), 2 * (v1 - v), half_px[k], appearance.noise)
            hidden[k] |= is_camouflaged(window, u, v, appearance)
    return hidden
