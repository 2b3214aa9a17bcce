"""The chain's motion from frame to frame: where it will be, and how wide the motion blurs it."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.fit import ChainModel
from strandcast.tracking.chain.frames import FrameInput
from strandcast.tracking.chain.links import place_nodes
from strandcast.tracking.chain.search_window import SearchWindow

WIDEST_BLUR_PX = 6.0  # chosen: most of half the visible width


@dataclass(frozen=True, eq=False)
class ChainState:
    """The chain in one frame: time, start (2,), headings (M,)."""

    time_s: float
    root: np.ndarray
    heading: np.ndarray


def still_half_px(appearance: Appearance, links: int, window: SearchWindow) -> np.ndarray:
    """Return half the visible width at each node (links + 1,) of a string at rest."""
    return np.full(links + 1, appearance.half_m / window.plane.metre_per_pixel)


def moving_half_px(
    string: ChainModel, frame: FrameInput, last: ChainState, heading: np.ndarray, exposure_s: float
) -> np.ndarray:
    """Return half the visible width (M + 1,) in a frame, blurred by the motion since the last state."""
    half_px: np.ndarray = blurred_half_px(
        string.appearance.half_m,
        frame.window.plane.metre_per_pixel,
        place_nodes(last.root, last.heading, string.link_m),
        place_nodes(frame.clamp_m, heading, string.link_m),
        heading,
        min(1.0, exposure_s / max(abs(frame.time_s - last.time_s), 1e-9)),
    )
    return half_px


@njit(cache=True)
def extrapolate(before: np.ndarray, last: np.ndarray, share: float) -> np.ndarray:
    """Return headings (M,) extrapolated by `share` of their last change, smoothed along the string."""
    count = len(last)
    weights = (1.0 / 16, 4.0 / 16, 6.0 / 16, 4.0 / 16, 1.0 / 16)
    out = np.empty(count)
    for j in range(count):
        change = 0.0
        for a in range(5):
            k = min(max(j + a - 2, 0), count - 1)
            change += weights[a] * (last[k] - before[k])
        out[j] = last[j] + share * change
    return out


@njit(cache=True)
def blurred_half_px(
    half_m: float, metre_per_pixel: float, was: np.ndarray, now: np.ndarray, heading: np.ndarray, share: float
) -> np.ndarray:
    """Return half the visible width at each node (M + 1,): the string's, plus half its motion blur.

    The nodes (M + 1, 2) move from where they were to where they are now; `share` is the exposure over the
    time between these frames.
    """
    count = len(heading)
    half_px = np.empty(count + 1)
    for k in range(count + 1):
        angle = heading[min(k, count - 1)]
        across = -np.sin(angle) * (now[k, 0] - was[k, 0]) + np.cos(angle) * (now[k, 1] - was[k, 1])
        half_px[k] = min((half_m + 0.5 * abs(across) * share) / metre_per_pixel, WIDEST_BLUR_PX)
    half_px[0] = half_m / metre_per_pixel
    return half_px
