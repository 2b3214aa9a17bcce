"""What of one frame the string is looked for in, and what is known of its looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.tracking.pixelmap import PixelMap, to_pixel
from strandcast.tracking.sighting import inside_box


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
    """

    half_m: float
    contrast: float
    tip_excess_m: float = 0.0
    ball_level: float = np.nan
    polarity: float = 0.0

    @property
    def has_ball(self) -> bool:
        """Tell whether a ball hangs at the tip."""
        return bool(np.isfinite(self.ball_level))


def hidden_nodes(picture: Picture, nodes: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Tell which nodes (K,) cannot be seen: behind the hand, or outside the picture."""
    _, origin, step, uv = map_of(picture)
    rows, columns = picture.image.shape
    hidden = np.zeros(len(nodes), dtype=bool)
    for k, (x, y) in enumerate(nodes):
        u, v = to_pixel(x, y, origin, step, uv)
        hidden[k] = inside_box(x, y, box) or not (1 <= u < columns - 2 and 1 <= v < rows - 2)
    return hidden
