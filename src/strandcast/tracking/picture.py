"""What of one frame the string is looked for in, and what is known of its looks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.pixelmap import PixelMap, to_pixel

BLIND_SHARE = 0.4  # of the contrast, that the background must differ from the string for it to be seen
GAP_PX = 1.0  # between a line's middle and its flanks: the lens's blur
COVER_NOISES = 3.0  # a change of both flanks, in noises, from which something lies before the string
LEAST_COVER = 5.0  # grey levels


class Picture(NamedTuple):
    """What of one frame the string is looked for in, as kernels take it.

    Attributes
    ----------
    image, left, top
        The grey picture, or a part of it, and where its first pixel is in the whole.
    background
        The whole scene without arm and string.
    plane
        The string's plane in the whole picture.
    hand_box
        x, y and angle of the hand, and low x, low y, high x, high y in the hand's frame of where nothing that
        is seen is string, (7,).
    """

    image: np.ndarray
    left: int
    top: int
    background: np.ndarray
    plane: PixelMap
    hand_box: np.ndarray


class Looks(NamedTuple):
    """How the string looks.

    Attributes
    ----------
    half_m
        Half its visible width, the lens's blur included.
    contrast
        Line score of a clear piece of it, grey levels.
    tip_excess_m
        How far its visible end is beyond the tip's mass point: half its width, or the radius of a ball.
    ball_level
        Grey level of the ball at its tip; NaN where there is none.
    polarity
        1 if it is brighter than the background, -1 if darker, 0 if either.
    noise
        Standard deviation of what has not changed, grey levels.
    level
        Grey level of its middle in the picture; NaN where that is not known.
    """

    half_m: float
    contrast: float
    tip_excess_m: float = 0.0
    ball_level: float = float("nan")
    polarity: float = 0.0
    noise: float = 1.0
    level: float = float("nan")

    @property
    def has_ball(self) -> bool:
        """Tell whether a ball hangs at the tip."""
        return bool(np.isfinite(self.ball_level))


@njit(cache=True)
def levels_at(picture: Picture, u: float, v: float) -> tuple[float, float]:
    """Return the grey levels of picture and background between pixels; outside, the nearest edge's."""
    image, background = picture.image, picture.background
    rows, columns = image.shape
    u = min(max(u - picture.left, 0.0), columns - 1.001)
    v = min(max(v - picture.top, 0.0), rows - 1.001)
    i, j = int(v), int(u)
    fv, fu = v - i, u - j
    w00, w01, w10, w11 = (1 - fv) * (1 - fu), (1 - fv) * fu, fv * (1 - fu), fv * fu
    now = w00 * image[i, j] + w01 * image[i, j + 1] + w10 * image[i + 1, j] + w11 * image[i + 1, j + 1]
    i, j = i + picture.top, j + picture.left
    was = w00 * background[i, j] + w01 * background[i, j + 1]
    was += w10 * background[i + 1, j] + w11 * background[i + 1, j + 1]
    return now, was


@njit(cache=True)
def is_outside(picture: Picture, u: float, v: float, margin: float) -> bool:
    """Tell whether a pixel is outside the picture, or nearer than `margin` to its edge."""
    rows, columns = picture.image.shape
    j, i = u - picture.left, v - picture.top
    return not (margin <= j < columns - 1 - margin and margin <= i < rows - 1 - margin)


@njit(cache=True)
def near_box(x: float, y: float, box: np.ndarray, margin_m: float) -> bool:
    """Tell whether a place (m) may be within `margin_m` of a box; quicker than `inside_box`."""
    reach = np.hypot(max(-box[3], box[5]), max(-box[4], box[6])) + margin_m
    return (x - box[0]) ** 2 + (y - box[1]) ** 2 <= reach * reach


@njit(cache=True)
def inside_box(x: float, y: float, box: np.ndarray) -> bool:
    """Tell whether a place (m) lies in a box: x, y and angle of its frame, low x, low y, high x, high y.

    The hand's markers are full of thin lines, and the hand hides the string: what is seen there is none.
    """
    cosine, sine = np.cos(box[2]), np.sin(box[2])
    dx, dy = x - box[0], y - box[1]
    along, left = cosine * dx + sine * dy, -sine * dx + cosine * dy
    return box[3] <= along <= box[5] and box[4] <= left <= box[6]


@njit(cache=True)
def is_covered(
    picture: Picture, u: float, v: float, nu: float, nv: float, half_px: float, noise: float
) -> bool:
    """Tell whether both flanks of a line at a pixel, with normal (nu, nv), differ from the background."""
    least = max(COVER_NOISES * noise, LEAST_COVER)
    for side in (-1.0, 1.0):
        changed = 0.0
        for a in range(3):
            d = side * (half_px + GAP_PX + 1.0 + a)
            now, was = levels_at(picture, u + d * nu, v + d * nv)
            changed += (now - was) / 3.0
        if abs(changed) < least:
            return False
    return True


@njit(cache=True)
def is_blind(picture: Picture, u: float, v: float, looks: Looks) -> bool:
    """Tell whether the background at a pixel is so like the string that it would not be seen there."""
    if not np.isfinite(looks.level):
        return False
    was = levels_at(picture, u, v)[1]
    spare = BLIND_SHARE * looks.contrast
    low = -np.inf if looks.polarity < 0 else looks.level - spare
    high = np.inf if looks.polarity > 0 else looks.level + spare
    return low <= was <= high


@njit(cache=True)
def hidden_nodes(
    picture: Picture, nodes: np.ndarray, normals: np.ndarray, half_px: np.ndarray, looks: Looks
) -> np.ndarray:
    """Tell which nodes (K,) cannot be seen: behind hand or arm, before what is like the string, or outside.

    The arm is what has changed on both sides of where the string would be.
    """
    plane = picture.plane
    aside_m = 0.5 * plane.metre_per_pixel
    hidden = np.zeros(len(nodes), dtype=np.bool_)
    for k in range(len(nodes)):
        x, y = nodes[k]
        u, v = to_pixel(x, y, plane)
        hidden[k] = inside_box(x, y, picture.hand_box) or is_outside(picture, u, v, 1.0)
        if not hidden[k]:
            u1, v1 = to_pixel(x + aside_m * normals[k, 0], y + aside_m * normals[k, 1], plane)
            hidden[k] = is_covered(picture, u, v, 2 * (u1 - u), 2 * (v1 - v), half_px[k], looks.noise)
            hidden[k] |= is_blind(picture, u, v, looks)
    return hidden
