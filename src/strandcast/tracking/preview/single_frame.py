"""The string in one frame, detected without other frames, for a preview."""

from dataclasses import dataclass

import numpy as np

from strandcast.core.pose import Pose
from strandcast.tracking.chain.detection import detect_string
from strandcast.tracking.chain.frames import FrameInput
from strandcast.tracking.chain.links import node_normals
from strandcast.tracking.chain.measure import levels_on, width_at_half
from strandcast.tracking.chain.profiles import STEP_PX, sample_across
from strandcast.tracking.chain.search_window import SearchWindow
from strandcast.tracking.tracker import StringHint

PROFILE_PX = 12.0  # to each side of the string
CLEAR = 0.5  # least quality of a node in the profile


@dataclass(frozen=True)
class StringInFrame:
    """The string as one frame alone shows it."""

    nodes_m: np.ndarray  # its course from the clamp to the tip, (M + 1, 2)
    quality: np.ndarray  # how clearly each node is visible, 0 to 1, (M + 1,)
    points_m: np.ndarray  # mass points, 0 the hand, (n + 1, 2)
    profile: np.ndarray  # median change of grey level across it (K,)
    offsets_px: np.ndarray  # of the profile's samples (K,)
    width_px: float  # at half height
    level: float  # median grey level
    behind: float  # and that of the background there
    polarity: float  # 1 if brighter than the background, -1 if darker, 0 if both

    @property
    def contrast(self) -> float:
        """Return the height of its profile, grey levels."""
        return float(np.abs(self.profile).max())


def string_in_frame(
    picture: SearchWindow, hand: Pose, string: StringHint, polarity: float | None
) -> StringInFrame | None:
    """Detect the string in a single frame; None where nothing long and thin leaves the clamp.

    `polarity` is 1 for a string brighter than the background, -1 for a darker one, None to measure it.
    """
    found = detect_string(0, FrameInput(picture, 0.0, hand.position_m), string, polarity)
    if found is None:
        return None
    nodes = found.fit.nodes()
    profile, offsets = mean_profile(picture, nodes, found.fit.heading, found.fit.reward)
    width = width_at_half(np.abs(profile), len(profile) // 2) * STEP_PX
    shown, behind = levels_on(picture, nodes[found.fit.reward >= CLEAR])
    return StringInFrame(
        nodes_m=nodes,
        quality=found.fit.reward,
        points_m=nodes[:: len(found.fit.heading) // string.points],
        profile=profile,
        offsets_px=offsets,
        width_px=width,
        level=float(np.median(shown)) if len(shown) else float("nan"),
        behind=float(np.median(behind)) if len(behind) else float("nan"),
        polarity=found.appearance.polarity,
    )


def mean_profile(
    picture: SearchWindow, nodes_m: np.ndarray, heading: np.ndarray, quality: np.ndarray
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
