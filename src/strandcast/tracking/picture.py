"""What of one frame the string is looked for in, and what is known of its looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from strandcast.tracking.pixelmap import PixelMap, to_pixel
from strandcast.tracking.sighting import inside_box, is_blind, is_covered

BLIND_SHARE = 0.4  # of the contrast, that the background must differ from the string for it to be seen


@dataclass(frozen=True)
class Picture:
    """What of one frame the string is looked for in: grey picture, background, the plane's pixel map.

    `hand_box` (low x, low y, high x, high y), in the hand's frame, is where nothing that is seen is string.
    """

    image: np.ndarray
    background: np.ndarray
    pixels: PixelMap
    hand_box: np.ndarray


def hand_box(hand: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return the hand's box where the hand is, as `inside_box` takes it, (7,)."""
    return np.concatenate([hand, box])


def map_of(picture: Picture) -> tuple[float, np.ndarray, float, np.ndarray]:
    """Return the pixel map as the kernels take it."""
    pixels = picture.pixels
    return pixels.metre_per_pixel, pixels.origin_m, pixels.step_m, pixels.uv


@dataclass(frozen=True)
class Looks:
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
    ball_level: float = np.nan
    polarity: float = 0.0
    noise: float = 1.0
    level: float = np.nan

    @property
    def blind(self) -> np.ndarray:
        """Return the lowest and the highest grey level of a background before which it is not seen, (2,)."""
        if not np.isfinite(self.level):
            return np.array([np.inf, np.inf])
        low = -np.inf if self.polarity < 0 else self.level - BLIND_SHARE * self.contrast
        high = np.inf if self.polarity > 0 else self.level + BLIND_SHARE * self.contrast
        return np.array([low, high])

    @property
    def has_ball(self) -> bool:
        """Tell whether a ball hangs at the tip."""
        return bool(np.isfinite(self.ball_level))


@njit(cache=True)
def hidden_nodes(
    image: np.ndarray,
    background: np.ndarray,
    nodes: np.ndarray,
    normals: np.ndarray,
    half_px: np.ndarray,
    noise: float,
    blind: np.ndarray,
    box: np.ndarray,
    metre_per_pixel: float,
    origin: np.ndarray,
    step: float,
    uv: np.ndarray,
) -> np.ndarray:
    """Tell which nodes (K,) cannot be seen: behind hand or arm, before what is like the string, or outside.

    The arm is what has changed on both sides of where the string would be.
    """
    rows, columns = image.shape
    hidden = np.zeros(len(nodes), dtype=np.bool_)
    for k in range(len(nodes)):
        x, y = nodes[k]
        u, v = to_pixel(x, y, origin, step, uv)
        hidden[k] = inside_box(x, y, box) or not (1 <= u < columns - 2 and 1 <= v < rows - 2)
        if not hidden[k]:
            aside_m = 0.5 * metre_per_pixel
            u1, v1 = to_pixel(x + aside_m * normals[k, 0], y + aside_m * normals[k, 1], origin, step, uv)
            hidden[k] = is_covered(image, background, u, v, 2 * (u1 - u), 2 * (v1 - v), half_px[k], noise)
            hidden[k] |= is_blind(background, u, v, blind)
    return hidden
