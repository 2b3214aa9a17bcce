"""Board photos grouped by pose: repeated photos of one pose share its errors and count once."""

from collections.abc import Sequence

import numpy as np

from strandcast.camera.views import BoardCorners

# Chosen: rms displacement of the shared corners, relative to the board's extent in the picture, up to which
# two photos show one pose. A board on a stand stays within 0.1 %; a tilt by 5 degrees moves its corners by
# about 1 %, but a tilt also moves the board's centre, so that 1 % separates deliberate poses.
SAME_POSE = 0.01
LEAST_SHARED = 4  # corners that both photos must show to be compared


def pose_groups(views: Sequence[BoardCorners]) -> np.ndarray:
    """Return the number of the distinct pose of each photo (n,), counted from 0 in the photos' order.

    A photo belongs to the first earlier photo, itself the first of its pose, that it repeats: a slow film
    of a moving board is not chained into one pose.
    """
    groups = np.empty(len(views), int)
    first: list[BoardCorners] = []
    for place, view in enumerate(views):
        repeated = (number for number, other in enumerate(first) if _same_pose(view, other))
        groups[place] = next(repeated, len(first))
        if groups[place] == len(first):
            first.append(view)
    return groups


def _same_pose(one: BoardCorners, other: BoardCorners) -> bool:
    """Return whether the corners shown in both photos are at the same places in the picture."""
    same = np.linalg.norm(one.board_m[:, None] - other.board_m[None], axis=2) < 1e-9
    mine, theirs = np.nonzero(same)
    if len(mine) < LEAST_SHARED:
        return False
    moved_px = one.picture_px[mine] - other.picture_px[theirs]
    extent_px = np.linalg.norm(np.ptp(one.picture_px, axis=0))
    return bool(np.sqrt((moved_px**2).sum(axis=1).mean()) < SAME_POSE * extent_px)
