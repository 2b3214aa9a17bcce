"""The arm as capsules that hide and foul the string: its links, and the plate with the hand's markers."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.arm.kinematics import PlanarChain, hand_pose
from strandcast.arm.load import AnyArm, Arm
from strandcast.arm.settings import Clamp
from strandcast.arm.spatial import SpatialArm, capsules_in_space, hand_path
from strandcast.threads import over_ranges

PLATE_RIM_M = 0.015  # of the plate beyond the markers' edge; chosen
NEAR_HAND_M = 0.06  # string this near to the hand cannot be far from it; chosen
HANGING_SPACING_M = 0.015  # between the places of the hanging string that are checked; chosen
LONGER = 1.05  # how much longer than specified a string may be; chosen


class PlanarArm(NamedTuple):
    """Chain and clamp for kernels; see `strandcast.arm.kinematics` for the columns."""

    angles_rad: np.ndarray
    signs: np.ndarray
    lengths_m: np.ndarray
    origin_m: np.ndarray
    offset_m: np.ndarray
    clamp_rad: float


def planar_arm(chain: PlanarChain, clamp: Clamp) -> PlanarArm:
    """Return chain and clamp for kernels."""
    return PlanarArm(
        chain.angles_rad,
        chain.signs.astype(float),
        chain.lengths_m,
        np.asarray(chain.origin_m, float),
        np.asarray(clamp.offset_m, float),
        clamp.angle_rad,
    )


def capsules(arm: AnyArm, q: np.ndarray) -> np.ndarray:
    """Return both ends of each link, and of the plate between the outer markers: (..., S, 2, 2 or 3) [m].

    Parameters
    ----------
    q
        (..., J) joint angles [rad].
    """
    if isinstance(arm, SpatialArm):
        return capsules_in_space(arm.chain, q)
    assert isinstance(arm, Arm)
    along = [marker.place_m[0] for marker in arm.markers]
    plate = np.array([min(along), max(along)]) if along else np.zeros(0)
    rows, planar = np.ascontiguousarray(q, float).reshape(-1, q.shape[-1]), planar_arm(arm.chain, arm.clamp)
    ends = np.empty((len(rows), rows.shape[1] + len(plate) // 2, 2, 2))
    over_ranges(len(rows), lambda first, last: _capsules(first, last, rows, planar, plate, ends))
    return ends.reshape(*q.shape[:-1], *ends.shape[1:])


@njit(cache=True, nogil=True)
def _capsules(
    first: int, last: int, q: np.ndarray, arm: PlanarArm, plate_m: np.ndarray, ends: np.ndarray
) -> None:
    """Fill both ends (N, S, 2, 2) of the links, and of the plate between two places along the string."""
    joints = q.shape[1]
    for k in range(first, last):
        x, y, angle, cos, sin = arm.origin_m[0], arm.origin_m[1], 0.0, 1.0, 0.0
        for j in range(joints):
            angle += arm.angles_rad[j] + arm.signs[j] * q[k, j]
            cos, sin = math.cos(angle), math.sin(angle)
            ends[k, j, 0, 0], ends[k, j, 0, 1] = x, y
            x, y = x + arm.lengths_m[j] * cos, y + arm.lengths_m[j] * sin
            ends[k, j, 1, 0], ends[k, j, 1, 1] = x, y
        offset_m = arm.offset_m
        x, y = x + offset_m[0] * cos - offset_m[1] * sin, y + offset_m[0] * sin + offset_m[1] * cos
        angle += arm.clamp_rad
        for end in range(len(plate_m)):
            ends[k, joints, end, 0] = x + plate_m[end] * math.cos(angle)
            ends[k, joints, end, 1] = y + plate_m[end] * math.sin(angle)


def capsule_radii(arm: AnyArm, clearance_m: float) -> np.ndarray:
    """Return (S,) how near to each capsule the string may come [m]."""
    radii = np.full(len(arm.joints), clearance_m)
    if not isinstance(arm, Arm) or not arm.markers:
        return radii
    return np.append(radii, PLATE_RIM_M + max(abs(m.place_m[1]) + 0.5 * m.size_m for m in arm.markers))


def start_violation_m(
    arm: AnyArm,
    length_m: float,
    box: np.ndarray,
    clearance_m: float,
    q0: np.ndarray,
    clear_of: tuple[np.ndarray, float] | None = None,
) -> np.ndarray:
    """Return how deep the hanging string is in the capsules, out of the box, or at the target, at the start.

    The string hangs straight down from the hand; no model's stretch enters.

    Parameters
    ----------
    length_m
        The string's free length [m].
    box
        (2 or 3, 2) low and high of each coordinate [m].
    clearance_m
        How near to the links it may hang [m].
    q0
        (P, J) postures [rad].
    clear_of
        Places (A, 2 or 3) of the target, and how far from them the string must hang [m].

    Returns
    -------
    (P,) [m], 0 where a start posture is allowed.
    """
    if isinstance(arm, SpatialArm):
        hand = hand_path(arm.chain, q0)[:, :3]
    else:
        assert isinstance(arm, Arm)
        hand = hand_pose(arm.chain, arm.clamp, q0).position_m
    upwards = np.eye(hand.shape[1])[-1]
    down = np.append(np.arange(NEAR_HAND_M, length_m, HANGING_SPACING_M), LONGER * length_m)
    hanging = hand[:, None] - down[:, None] * upwards
    away = _distances(hanging, capsules(arm, q0))
    deep = np.maximum(capsule_radii(arm, clearance_m) - away, 0.0).max(axis=(1, 2))
    shown = np.concatenate([hand[:, None], hanging], axis=1)
    out = np.maximum(box[:, 0] - shown, shown - box[:, 1]).max(axis=(1, 2))
    wrong = np.maximum(deep, np.maximum(out, 0.0))
    if clear_of is not None:
        places_m, clear_m = clear_of
        apart_m = places_m - hand[:, None]
        apart_m[..., -1] += np.clip(-apart_m[..., -1], 0.0, LONGER * length_m)
        wrong = np.maximum(wrong, clear_m - np.linalg.norm(apart_m, axis=-1).min(axis=1))
    return np.asarray(wrong)


def _distances(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return (P, D, S) distances of points (P, D, 2 or 3) to segments (P, S, 2, 2 or 3)."""
    start, step = ends[:, None, :, 0], (ends[:, :, 1] - ends[:, :, 0])[:, None]
    from_start = points[:, :, None] - start
    share = (from_start * step).sum(axis=-1) / np.maximum((step**2).sum(axis=-1), 1e-300)
    return np.asarray(np.linalg.norm(from_start - np.clip(share, 0.0, 1.0)[..., None] * step, axis=-1))
