"""Planar forward kinematics: positions of the links and poses of the hand, from the joint angles."""

from dataclasses import dataclass

import numpy as np

from strandcast.arm.settings import Clamp
from strandcast.core.pose import Pose


@dataclass(frozen=True, eq=False)
class PlanarChain:
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


def link_angles(chain: PlanarChain, q: np.ndarray) -> np.ndarray:
    """Return the directions of the links [rad], not wrapped: (..., J) from joint angles (..., J)."""
    return np.cumsum(chain.angles_rad + chain.signs * np.asarray(q, float), axis=-1)


def link_points(chain: PlanarChain, q: np.ndarray) -> np.ndarray:
    """Return positions (..., J+1, 2) of the joints and the last link's end [m] from angles (..., J) [rad]."""
    angles = link_angles(chain, q)
    steps = chain.lengths_m[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    points = np.empty((*angles.shape[:-1], angles.shape[-1] + 1, 2))
    points[..., 0, :] = chain.origin_m
    points[..., 1:, :] = chain.origin_m + np.cumsum(steps, axis=-2)
    return points


def hand_pose(chain: PlanarChain, clamp: Clamp, q: np.ndarray) -> Pose:
    """Return the hand's poses from the joint angles.

    Parameters
    ----------
    q
        (..., J) joint angles [rad].

    Returns
    -------
    Poses (...): where the string leaves the clamp, and the direction in which it leaves, not wrapped.
    """
    angle = link_angles(chain, q)[..., -1]
    along, left = clamp.offset_m
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = np.moveaxis(link_points(chain, q)[..., -1, :], -1, 0)
    position_m = np.stack([x + along * cos - left * sin, y + along * sin + left * cos], axis=-1)
    return Pose(position_m, angle + clamp.angle_rad)
