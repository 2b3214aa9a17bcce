"""The string in one frame, found without any other frame's help: what a preview shows of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.tracking.chain import node_normals
from strandcast.tracking.follower import Sight
from strandcast.tracking.looks import levels_on, sight, width_at_half
from strandcast.tracking.passes import chain_of
from strandcast.tracking.picture import Picture
from strandcast.tracking.result import StringHint
from strandcast.tracking.sighting import STEP_PX, sample_across

PROFILE_PX = 12.0  # to each side of the string
CLEAR = 0.5  # quality of a node that is part of the mean profile


@dataclass(frozen=True)
class SingleSighting:
    """The string as one frame alone shows it.

    Attributes
    ----------
    nodes_m
        Its course (M + 1, 2), from the clamp to the tip.
    quality
        How well each node is seen, 0 to 1, (M + 1,).
    points_m
        Its mass points (n + 1, 2), 0 the hand.
    profile, offsets_px
        Mean change of grey level across it (K,), and where (K,); NaN where too little of it is clear.
    width_px
        Its width at half height.
    level, behind
        Its grey level and that of the background there, medians.
    polarity
        1 if it is brighter than the background, -1 if darker, 0 if either.
    noise
        Standard deviation of what has not changed, grey levels.
    """

    nodes_m: np.ndarray
    quality: np.ndarray
    points_m: np.ndarray
    profile: np.ndarray
    offsets_px: np.ndarray
    width_px: float
    level: float
    behind: float
    polarity: float
    noise: float

    @property
    def contrast(self) -> float:
        """Return the height of its profile, grey levels."""
        return float(np.abs(self.profile).max())


def find_alone(
    picture: Picture, hand: np.ndarray, string: StringHint, polarity: float | None
) -> SingleSighting | None:
    """Find the string in a frame of its own; None where nothing long and thin leaves the clamp.

    Parameters
    ----------
    picture
        The frame, its background and the pixel map.
    hand
        Pose x_m, y_m, angle_rad of the hand.
    string
        What is known of the string.
    polarity
        1 for a string brighter than the background, -1 for a darker one, None to find out.
    """
    links, every = chain_of(string)
    at = Sight(picture, 0.0, hand, hand[:2])
    found = sight(0, at, links, string.length_m / links, string.thickness_m, polarity)
    if found is None:
        return None
    nodes = found.fit.nodes()
    profile, offsets = mean_profile(picture, nodes, found.fit.heading, found.fit.reward)
    width = width_at_half(np.abs(profile), len(profile) // 2) * STEP_PX
    shown, behind = levels_on(picture, nodes[found.fit.reward >= CLEAR])
    return SingleSighting(
        nodes, found.fit.reward, nodes[::every], profile, offsets, width,
        float(np.median(shown)) if len(shown) else float("nan"),
        float(np.median(behind)) if len(behind) else float("nan"),
        found.looks.polarity, found.looks.noise,
    )  # fmt: skip


def mean_profile(
    picture: Picture, nodes_m: np.ndarray, heading: np.ndarray, quality: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the median change (K,) across the clear nodes of the string, and the offsets (K,) [px]."""
    half = int(PROFILE_PX / STEP_PX)
    offsets = STEP_PX * np.arange(-half, half + 1)
    clear = quality >= CLEAR
    if clear.sum() < 5:
        return np.zeros(2 * half + 1), offsets
    pitch_m = STEP_PX * picture.plane.metre_per_pixel
    places, normals = nodes_m[clear], node_normals(heading)[clear]
    rows, columns = picture.image.shape
    behind = picture.background[picture.top : picture.top + rows, picture.left : picture.left + columns]
    empty = picture._replace(image=np.ascontiguousarray(behind))
    now, was = (sample_across(one, places, normals, pitch_m, half, 0, 1.0)[0] for one in (picture, empty))
    change = now - was
    flanks = np.concatenate([change[:, : half // 2], change[:, -(half // 2) :]], axis=1)
    return np.median(change - np.median(flanks, axis=1)[:, None], axis=0), offsets
