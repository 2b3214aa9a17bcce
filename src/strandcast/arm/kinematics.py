"""Planar forward kinematics: positions of the links and poses of the hand, from the joint angles."""

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numba import njit

from strandcast.arm.settings import ArmKeys, Clamp
from strandcast.arm.urdf import posed
from strandcast.core.pose import Pose, wrapped
from strandcast.threads import over_ranges

SHORTEST_LINK_M = 1e-9  # beyond rounding; chosen


class PlanarChain(NamedTuple):
    """The moving joints as a planar chain.

    Link j has length ``lengths_m[j]`` and points along the sum over i <= j of
    ``angles_rad[i] + signs[i] * q[i]``.

    Attributes
    ----------
    origin_m
        (2,) position of the first moving joint in the plane [m].
    lengths_m
        (J,) from each joint to the next, the last one to the clamp's link [m].
    angles_rad
        (J,) angle of each link relative to the one before, all joints at zero [rad].
    signs
        (J,) +1 where a positive joint angle is counter-clockwise for the camera, -1 where it is clockwise.
    """

    origin_m: np.ndarray
    lengths_m: np.ndarray
    angles_rad: np.ndarray
    signs: np.ndarray


def planar_chain(model: mujoco.MjModel, keys: ArmKeys) -> PlanarChain:
    """Return the chain of the moving joints, the other joints held; see `checks.geometry_problems`."""
    data, plane = posed(model, keys.throw.held), keys.throw.plane()
    joints = [data.joint(name) for name in keys.throw.joints]
    points = np.array([joint.xanchor for joint in joints] + [data.body(keys.clamp.link).xpos]) @ plane.T
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    # A link of zero length continues in the direction of the link before.
    directions = np.zeros(len(joints) + 1)
    for j, (step, length) in enumerate(zip(steps, lengths, strict=True)):
        directions[j + 1] = np.arctan2(step[1], step[0]) if length > SHORTEST_LINK_M else directions[j]
    signs = np.array([np.sign(joint.xaxis @ np.cross(plane[0], plane[1])) for joint in joints])
    return PlanarChain(points[0], lengths, wrapped(np.diff(directions)), signs)


def link_angles(chain: PlanarChain, q: np.ndarray) -> np.ndarray:
    """Return the directions of the links [rad], not wrapped: (..., J) from joint angles (..., J)."""
    return np.cumsum(chain.angles_rad + chain.signs * np.asarray(q, float), axis=-1)


def link_points(chain: PlanarChain, q: np.ndarray) -> np.ndarray:
    """Return positions (..., J+1, 2) of the joints and the last link's end [m] from angles (..., J) [rad]."""
    return _points(chain, link_angles(chain, q))


def _points(chain: PlanarChain, angles: np.ndarray) -> np.ndarray:
    """Return the same from the links' directions (..., J) [rad]."""
    steps = chain.lengths_m[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    points = np.empty((*angles.shape[:-1], angles.shape[-1] + 1, 2))
    points[..., 0, :] = chain.origin_m
    points[..., 1:, :] = chain.origin_m + np.cumsum(steps, axis=-2)
    return points


def hand_pose(chain: PlanarChain, clamp: Clamp, q: np.ndarray) -> Pose:
    """Return the hand's poses (...) at joint angles (..., J) [rad].

    They are where the string leaves the clamp, and the direction in which it leaves, not wrapped.
    """
    angles = link_angles(chain, q)
    angle = angles[..., -1]
    along, left = clamp.offset_m
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = np.moveaxis(_points(chain, angles)[..., -1, :], -1, 0)
    position_m = np.stack([x + along * cos - left * sin, y + along * sin + left * cos], axis=-1)
    return Pose(position_m, angle + clamp.angle_rad)


def link_capsules(q: np.ndarray, chain: PlanarChain, clamp: Clamp, plate_m: np.ndarray) -> np.ndarray:
    """Return both ends of each link and of a plate [m]: (..., S, 2, 2) from joint angles (..., J) [rad].

    The plate is between two places along the string, `plate_m` (2,) from the clamp [m], or none.
    """
    rows = np.ascontiguousarray(q, float).reshape(-1, q.shape[-1])
    ends = np.empty((len(rows), rows.shape[1] + len(plate_m) // 2, 2, 2))
    given = rows, chain, np.array(clamp.offset_m), clamp.angle_rad, plate_m
    over_ranges(len(rows), lambda first, last: _capsules(first, last, *given, ends))
    return ends.reshape(*q.shape[:-1], *ends.shape[1:])


@njit(cache=True, nogil=True)
def _capsules(
    first: int,
    last: int,
    q: np.ndarray,
    arm: PlanarChain,
    offset_m: np.ndarray,
    clamp_rad: float,
    plate_m: np.ndarray,
    ends: np.ndarray,
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
        x, y = x + offset_m[0] * cos - offset_m[1] * sin, y + offset_m[0] * sin + offset_m[1] * cos
        angle += clamp_rad
        for end in range(len(plate_m)):
            ends[k, joints, end, 0] = x + plate_m[end] * math.cos(angle)
            ends[k, joints, end, 1] = y + plate_m[end] * math.sin(angle)


def hand_poses(
    q: np.ndarray, zero_rad: np.ndarray, longer_m: np.ndarray, chain: PlanarChain, clamp: Clamp
) -> np.ndarray:
    """Return the hand's poses (P * K, T, 3) of joint paths with K strings; see `arm.load.Arm.hand_poses`."""
    poses = np.empty((len(q) * len(longer_m), q.shape[1], 3))
    given = q, zero_rad, longer_m, chain, np.array(clamp.offset_m), clamp.angle_rad
    over_ranges(len(poses), lambda first, last: _hand_poses(first, last, *given, poses))
    return poses


@njit(cache=True, nogil=True)
def _hand_poses(
    first: int,
    last: int,
    q: np.ndarray,
    zero_rad: np.ndarray,
    longer_m: np.ndarray,
    arm: PlanarChain,
    offset_m: np.ndarray,
    clamp_rad: float,
    poses: np.ndarray,
) -> None:
    """Fill the poses `first` to `last`; see `hand_poses`."""
    _, count, joints = q.shape
    strings = len(longer_m)
    for b in range(first, last):
        p, k = b // strings, b % strings
        for t in range(count):
            angle, x, y = 0.0, arm.origin_m[0], arm.origin_m[1]
            cos, sin = 1.0, 0.0
            for j in range(joints):
                angle += arm.angles_rad[j] + arm.signs[j] * (q[p, t, j] + zero_rad[k, j])
                cos, sin = math.cos(angle), math.sin(angle)
                x, y = x + arm.lengths_m[j] * cos, y + arm.lengths_m[j] * sin
            x, y = x + offset_m[0] * cos - offset_m[1] * sin, y + offset_m[0] * sin + offset_m[1] * cos
            angle += clamp_rad
            poses[b, t, 0] = x + longer_m[k] * math.cos(angle)
            poses[b, t, 1] = y + longer_m[k] * math.sin(angle)
            poses[b, t, 2] = angle
