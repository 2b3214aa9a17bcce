"""The strings that the thrown one may be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from scipy.linalg import hadamard

# What differs from throw to throw (one standard deviation): how the string is grasped, how it sways at the
# start, where the joints' zeros lie.
GRASP_ANGLE_RAD = float(np.radians(3.0))
GRASP_LENGTH_M = 0.002
SWAY_RAD = 0.010
SWAY_RAD_S = 0.050
JOINT_ZERO_RAD = 0.001


def _none() -> np.ndarray:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class Strings:
    """K strings, the best first.

    Attributes
    ----------
    parameters, masses
        (K, 10) and (K, n).
    curl_rad_m, clamp_offset_rad, longer_m
        (K,) bend at rest [rad/m], turn of the clamp [rad], length that hangs out beyond the nominal one [m];
        zero if not given.
    bend_friction
        (K,) dry friction of a joint [N m/kg]; zero if not given.
    bend_factor
        (K, n) multiplier of bending at joints 0…n-1; one if not given.
    sway
        (K, 2) turn of the string about the hand at the start [rad], and its rate [rad/s]; zero if not given.
    joint_zero_rad
        (K, J) what is added to the joints' angles; (K, 0), none, if not given.
    """

    parameters: np.ndarray
    masses: np.ndarray
    curl_rad_m: np.ndarray = field(default_factory=_none)
    clamp_offset_rad: np.ndarray = field(default_factory=_none)
    longer_m: np.ndarray = field(default_factory=_none)
    bend_friction: np.ndarray = field(default_factory=_none)
    bend_factor: np.ndarray = field(default_factory=_none)
    sway: np.ndarray = field(default_factory=_none)
    joint_zero_rad: np.ndarray = field(default_factory=_none)

    def __post_init__(self) -> None:
        for name in ("curl_rad_m", "clamp_offset_rad", "longer_m", "bend_friction"):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(len(self)))
        if not len(self.bend_factor):
            object.__setattr__(self, "bend_factor", np.ones_like(self.masses, dtype=float))
        if not len(self.sway):
            object.__setattr__(self, "sway", np.zeros((len(self), 2)))
        if not len(self.joint_zero_rad):
            object.__setattr__(self, "joint_zero_rad", np.zeros((len(self), 0)))

    def __len__(self) -> int:
        return len(self.parameters)

    def take(self, members: Sequence[int] | np.ndarray) -> Strings:
        """Return some of the strings."""
        at = np.asarray(members, int)
        return Strings(*(getattr(self, column.name)[at] for column in fields(self)))

    def first(self, count: int) -> Strings:
        """Return the best `count` strings, or all if there are fewer."""
        return self.take(range(min(count, len(self))))


def disturbed(strings: Strings, count: int, joints: int, scale: float = 1.0) -> Strings:
    """Return `count` strings, those given in turn, each thrown with other disturbances.

    The disturbances are the rows of a two-level design (Hadamard), each one standard deviation either way:
    for small ones the mean square of the misses over a whole design is the square of the undisturbed miss
    plus the variance, without chance.

    Parameters
    ----------
    count
        How many; a multiple of the design's size (8 for an arm of up to three joints) uses it fully.
    joints
        Number J of joints.
    scale
        Of the disturbances: 1 for a usual rig.
    """
    levels = scale * _levels(joints)
    levels = levels[np.arange(count) % len(levels)]
    chosen = strings.take([k % len(strings) for k in range(count)])
    return replace(
        chosen,
        clamp_offset_rad=chosen.clamp_offset_rad + levels[:, 0],
        longer_m=chosen.longer_m + levels[:, 1],
        sway=chosen.sway + levels[:, 2:4],
        joint_zero_rad=levels[:, 4:],
    )


def crossed(strings: Strings, joints: int, scale: float = 1.0) -> Strings:
    """Return every string with every disturbance of the design, string by string; see `disturbed`."""
    rows = len(_levels(joints))
    every = strings.take(np.repeat(np.arange(len(strings)), rows))
    return disturbed(every, len(every), joints, scale)


def _levels(joints: int) -> np.ndarray:
    """Return the design's disturbances (R, 4 + J), each one standard deviation either way."""
    sizes = np.array([GRASP_ANGLE_RAD, GRASP_LENGTH_M, SWAY_RAD, SWAY_RAD_S, *[JOINT_ZERO_RAD] * joints])
    runs = 1 << int(np.ceil(np.log2(len(sizes) + 1)))
    design = hadamard(runs)[:, 1 : len(sizes) + 1]
    # A second design with all signs turned takes what is quadratic out of the mean, too.
    return np.asarray(sizes * np.concatenate([design, -design]))
