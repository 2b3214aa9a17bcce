"""The arm as bars that hide and foul the string: its links, and the plate that carries the hand's markers."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from strandcast.arm.kinematics import hand_pose
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
    chain, clamp = arm.chain, arm.clamp
    along = [marker.place_m[0] for marker in arm.markers]
    plate = np.array([min(along), max(along)]) if along else np.zeros(0)
    found = _bars(
        np.ascontiguousarray(q, float).reshape(-1, q.shape[-1]),
        chain.angles_rad,
        chain.signs.astype(float),
        chain.lengths_m,
        np.asarray(chain.origin_m, float),
        np.asarray(clamp.offset_m, float),
        clamp.angle_rad,
        plate,
    )
    return found.reshape(*q.shape[:-1], *found.shape[1:])


@njit(cache=True, parallel=True)
def _bars(
    q: np.ndarray,
    angles_rad: np.ndarray,
    signs: np.ndarray,
    lengths_m: np.ndarray,
    origin_m: np.ndarray,
    offset_m: np.ndarray,
    clamp_rad: float,
    plate_m: np.ndarray,
) -> np.ndarray:
    """Return both ends (N, S, 2, 2) of the links, and of the plate between two places along the string."""
    count, joints = q.shape
    ends = np.empty((count, joints + len(plate_m) // 2, 2, 2))
    for k in prange(count):
        x, y, angle, cos, sin = origin_m[0], origin_m[1], 0.0, 1.0, 0.0
        for j in range(joints):
            angle += angles_rad[j] + signs[j] * q[k, j]
            cos, sin = math.cos(angle), math.sin(angle)
            ends[k, j, 0, 0], ends[k, j, 0, 1] = x, y
            x, y = x + lengths_m[j] * cos, y + lengths_m[j] * sin
            ends[k, j, 1, 0], ends[k, j, 1, 1] = x, y
        x, y = x + offset_m[0] * cos - offset_m[1] * sin, y + offset_m[0] * sin + offset_m[1] * cos
        angle += clamp_rad
        for end in range(len(plate_m)):
            ends[k, joints, end, 0] = x + plate_m[end] * math.cos(angle)
            ends[k, joints, end, 1] = y + plate_m[end] * math.sin(angle)
    return ends


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
