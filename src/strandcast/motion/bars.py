"""The arm as bars that hide and foul the string: its links, and the plate that carries the hand's markers."""

from __future__ import annotations

import numpy as np

from strandcast.arm.kinematics import hand_pose, link_points
from strandcast.arm.load import Arm

PLATE_RIM_M = 0.015  # beyond the markers' edge
NEAR_HAND_M = 0.06  # string this near to the hand cannot be far from it
HANGING_SPACING_M = 0.015
LONGER = 1.05  # what a string may hang out further than told


def bars(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Return both ends of each link, and of the markers' middles if there are any: (..., S, 2, 2) [m].

    Parameters
    ----------
    q
        (..., J) joint angles [rad].
    """
    joints = link_points(arm.chain, q)
    links = np.stack([joints[..., :-1, :], joints[..., 1:, :]], axis=-2)
    if not arm.markers:
        return links
    pose = hand_pose(arm.chain, arm.clamp, q)
    turn = np.stack([np.cos(pose[..., 2]), np.sin(pose[..., 2])], axis=-1)
    along = [marker.place_m[0] for marker in arm.markers]
    plate = [pose[..., :2] + place * turn for place in (min(along), max(along))]
    return np.concatenate([links, np.stack(plate, axis=-2)[..., None, :, :]], axis=-3)


def bar_radii(arm: Arm, clearance_m: float) -> np.ndarray:
    """Return (S,) how near to each bar the string may come [m]."""
    radii = np.full(len(arm.chain.lengths_m), clearance_m)
    if not arm.markers:
        return radii
    return np.append(radii, PLATE_RIM_M + max(abs(m.place_m[1]) + 0.5 * m.size_m for m in arm.markers))


def start_blame(arm: Arm, length_m: float, box: np.ndarray, clearance_m: float, q0: np.ndarray) -> np.ndarray:
    """Tell how wrong a start posture is: how deep the hanging string is in the bars, or out of the box.

    The string hangs straight down from the hand, as long as it is: no model's stretch enters.

    Parameters
    ----------
    length_m
        The string's free length [m].
    box
        (2, 2) low and high of x and y [m].
    clearance_m
        How near to the links it may hang [m].
    q0
        (P, J) postures [rad].

    Returns
    -------
    (P,) [m], 0 where nothing is wrong.
    """
    hand = hand_pose(arm.chain, arm.clamp, q0)[:, :2]
    down = np.append(np.arange(NEAR_HAND_M, length_m, HANGING_SPACING_M), LONGER * length_m)
    hanging = hand[:, None] - down[:, None] * np.array([0.0, 1.0])
    away = _distances(hanging, bars(arm, q0))
    deep = np.maximum(bar_radii(arm, clearance_m) - away, 0.0).max(axis=(1, 2))
    shown = np.concatenate([hand[:, None], hanging], axis=1)
    out = np.maximum(box[:, 0] - shown, shown - box[:, 1]).max(axis=(1, 2))
    return np.asarray(np.maximum(deep, np.maximum(out, 0.0)))


def _distances(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return (P, D, S) distances of points (P, D, 2) to segments (P, S, 2, 2)."""
    start, step = ends[:, None, :, 0], (ends[:, :, 1] - ends[:, :, 0])[:, None]
    from_start = points[:, :, None] - start
    share = (from_start * step).sum(axis=-1) / np.maximum((step**2).sum(axis=-1), 1e-300)
    return np.asarray(np.linalg.norm(from_start - np.clip(share, 0.0, 1.0)[..., None] * step, axis=-1))
