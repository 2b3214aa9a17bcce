"""Where the hand and the links are in the plane of the throw, from the joint angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class PlanarChain:
    """The moving joints as a planar chain.

    Link j has length ``lengths_m[j]`` and points along the sum over i <= j of
    ``angles_rad[i] + signs[i] * q[i]``.

    Attributes
    ----------
    origin_m
        (2,) place of the first moving joint in the plane [m].
    lengths_m
        (J,) from each joint to the next, the last one to the clamp's link [m].
    angles_rad
        (J,) angle of each link against the one before, all joints at zero [rad].
    signs
        (J,) +1 where a positive joint angle is counter-clockwise for the camera, -1 where it is clockwise.
    """

    origin_m: np.ndarray
    lengths_m: np.ndarray
    angles_rad: np.ndarray
    signs: np.ndarray


@dataclass(frozen=True, eq=False)
class Clamp:
    """How the hand holds the string: from the last link's end, in its direction.

    Attributes
    ----------
    offset_m
        (2,) where the string leaves, along the last link and to its left [m].
    angle_rad
        Direction in which the string leaves, against the last link [rad].
    swallowed_m
        String inside the clamp [m]: free length = string length - this.
    """

    offset_m: np.ndarray
    angle_rad: float
    swallowed_m: float = 0.0


def link_angles(chain: PlanarChain, q: np.ndarray) -> np.ndarray:
    """Return the directions of the links [rad], not wrapped: (..., J) from joint angles (..., J)."""
    return np.cumsum(chain.angles_rad + chain.signs * np.asarray(q, float), axis=-1)


def link_points(chain: PlanarChain, q: np.ndarray) -> np.ndarray:
    """Return the joints' places and the last link's end [m]: (..., J+1, 2) from angles (..., J) [rad]."""
    angles = link_angles(chain, q)
    steps = chain.lengths_m[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    points = np.empty((*angles.shape[:-1], angles.shape[-1] + 1, 2))
    points[..., 0, :] = chain.origin_m
    points[..., 1:, :] = chain.origin_m + np.cumsum(steps, axis=-2)
    return points


def hand_pose(chain: PlanarChain, clamp: Clamp, q: np.ndarray) -> np.ndarray:
    """Return the hand's pose from the joint angles.

    Parameters
    ----------
    q
        (..., J) joint angles [rad].

    Returns
    -------
    (..., 3): x [m], y [m] of the place where the string leaves the clamp, and the direction in which it
    leaves [rad], not wrapped.
    """
    angle = link_angles(chain, q)[..., -1]
    along, left = clamp.offset_m
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = np.moveaxis(link_points(chain, q)[..., -1, :], -1, 0)
    return np.stack(
        [x + along * cos - left * sin, y + along * sin + left * cos, angle + clamp.angle_rad], axis=-1
    )
