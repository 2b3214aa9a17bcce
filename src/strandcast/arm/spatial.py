"""Forward kinematics in space: poses in which the hand holds the string, and the links."""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numba import njit

from strandcast.arm.settings import SpatialArmKeys, SpatialClamp
from strandcast.arm.urdf import posed
from strandcast.threads import over_ranges

Vector = np.ndarray | tuple[float, float, float]  # within kernels; a tuple takes no memory
HAND_POSE = 9  # place, direction, normal: as `strandcast.dynamics.batch.HandPath` takes them


class SpatialChain(NamedTuple):
    """The moving joints and the hand with all moving joints at zero, in the frame of the URDF's root link.

    Attributes
    ----------
    anchors_m, axes
        (J, 3) a place on each joint's axis [m], and its unit vector, in the sense of a positive angle.
    hand_m, direction, normal
        (3,) where the string leaves the clamp [m], the unit vector in which it does, and one at right angles.
    """

    anchors_m: np.ndarray
    axes: np.ndarray
    hand_m: np.ndarray
    direction: np.ndarray
    normal: np.ndarray


def spatial_chain(model: mujoco.MjModel, keys: SpatialArmKeys) -> SpatialChain:
    """Return the chain of the moving joints and the hand, the other joints held."""
    data = posed(model, keys.throw.held)
    joints = [data.joint(name) for name in keys.throw.joints]
    link = data.body(keys.clamp.link)
    frame = link.xmat.reshape(3, 3)
    axes = clamp_axes(keys.clamp)
    return SpatialChain(
        np.array([joint.xanchor for joint in joints]),
        np.array([joint.xaxis for joint in joints]),
        link.xpos + frame @ np.array(keys.clamp.offset_m),
        frame @ axes[0],
        frame @ axes[1],
    )


def clamp_axes(clamp: SpatialClamp) -> np.ndarray:
    """Return direction, normal and their vector product as rows (3, 3) in the frame of the clamp's link."""
    along = np.array(clamp.direction) / np.linalg.norm(clamp.direction)
    normal = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    normal /= np.linalg.norm(normal)
    return np.stack([along, normal, np.cross(along, normal)])


def hand_poses_in_space(
    chain: SpatialChain, q: np.ndarray, zero_rad: np.ndarray, longer_m: np.ndarray
) -> np.ndarray:
    """Return the hand's poses (P * K, T, 9) of joint paths with K strings; see `arm.load.Arm.hand_poses`."""
    poses = np.empty((len(q) * len(longer_m), q.shape[1], HAND_POSE))
    given = chain, np.ascontiguousarray(q, float), np.ascontiguousarray(zero_rad, float), longer_m
    over_ranges(len(poses), lambda first, last: _hand_poses(first, last, *given, poses))
    return poses


def capsules_in_space(chain: SpatialChain, q: np.ndarray) -> np.ndarray:
    """Return both ends of each link [m], the last at the hand: (..., J, 2, 3) from angles (..., J) [rad]."""
    rows = np.ascontiguousarray(q, float).reshape(-1, q.shape[-1])
    ends = np.empty((len(rows), rows.shape[1], 2, 3))
    over_ranges(len(rows), lambda first, last: _capsules(first, last, chain, rows, ends))
    return ends.reshape(*q.shape[:-1], *ends.shape[1:])


@njit(cache=True)
def turn_about(
    anchor: np.ndarray, axis: np.ndarray, angle: float, turn: np.ndarray, move: np.ndarray
) -> None:
    """Compose a frame (x to turn x + move) with a rotation about an axis that is given at zero angles."""
    cos, sin = math.cos(angle), math.sin(angle)
    ax, ay, az = axis[0], axis[1], axis[2]
    for r in range(3):
        x, y, z = turn[r, 0], turn[r, 1], turn[r, 2]
        along = (1.0 - cos) * (x * ax + y * ay + z * az)
        turn[r, 0] = cos * x + along * ax + sin * (y * az - z * ay)
        turn[r, 1] = cos * y + along * ay + sin * (z * ax - x * az)
        turn[r, 2] = cos * z + along * az + sin * (x * ay - y * ax)
        gone = (x - turn[r, 0]) * anchor[0] + (y - turn[r, 1]) * anchor[1]
        move[r] += gone + (z - turn[r, 2]) * anchor[2]


@njit(cache=True)
def _reset(turn: np.ndarray, move: np.ndarray) -> None:
    """Make a frame the root's."""
    for r in range(3):
        move[r] = 0.0
        for c in range(3):
            turn[r, c] = 1.0 if r == c else 0.0


@njit(cache=True)
def turned(turn: np.ndarray, vector: Vector, r: int) -> float:
    """Return component r of a turned vector."""
    component: float = turn[r, 0] * vector[0] + turn[r, 1] * vector[1] + turn[r, 2] * vector[2]
    return component


@njit(cache=True, nogil=True)
def _hand_poses(
    first: int,
    last: int,
    chain: SpatialChain,
    q: np.ndarray,
    zero_rad: np.ndarray,
    longer_m: np.ndarray,
    poses: np.ndarray,
) -> None:
    """Fill the poses `first` to `last`; see `hand_poses_in_space`."""
    strings = len(longer_m)
    turn, move = np.empty((3, 3)), np.empty(3)
    for b in range(first, last):
        p, k = b // strings, b % strings
        for t in range(q.shape[1]):
            _reset(turn, move)
            for j in range(q.shape[2]):
                turn_about(chain.anchors_m[j], chain.axes[j], q[p, t, j] + zero_rad[k, j], turn, move)
            for r in range(3):
                along = turned(turn, chain.direction, r)
                poses[b, t, r] = turned(turn, chain.hand_m, r) + move[r] + longer_m[k] * along
                poses[b, t, 3 + r] = along
                poses[b, t, 6 + r] = turned(turn, chain.normal, r)


@njit(cache=True, nogil=True)
def _capsules(first: int, last: int, chain: SpatialChain, q: np.ndarray, ends: np.ndarray) -> None:
    """Fill both ends (N, J, 2, 3) of the links."""
    joints = q.shape[1]
    turn, move = np.empty((3, 3)), np.empty(3)
    for k in range(first, last):
        _reset(turn, move)
        for j in range(joints):
            turn_about(chain.anchors_m[j], chain.axes[j], q[k, j], turn, move)
            end = chain.anchors_m[j + 1] if j + 1 < joints else chain.hand_m
            for r in range(3):
                ends[k, j, 0, r] = turned(turn, chain.anchors_m[j], r) + move[r]
                ends[k, j, 1, r] = turned(turn, end, r) + move[r]
