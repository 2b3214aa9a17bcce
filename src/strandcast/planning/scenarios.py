"""Strings in disturbed throws."""

from dataclasses import replace

import numpy as np
from scipy.linalg import hadamard

from strandcast.core.disturbances import (
    GRASP_ANGLE_RAD,
    GRASP_LENGTH_M,
    JOINT_ZERO_RAD,
    SWAY_RAD,
    SWAY_RAD_S,
    Disturbances,
)
from strandcast.core.strings import StringBatch


def disturbed(strings: StringBatch, count: int, joints: int, scale: float = 1.0) -> StringBatch:
    """Return `count` strings: the given ones in turn, each with different disturbances.

    The disturbances are the rows of a two-level design (Hadamard), each one standard deviation either way:
    if they are small, the mean square of the misses over a whole design is exactly the square of the
    undisturbed miss plus the variance.

    Parameters
    ----------
    count
        How many; a multiple of the design's size (8 for an arm of up to three joints) uses it fully.
    joints
        Number J of joints.
    scale
        Of the disturbances: 1 for a typical rig.
    """
    levels = scale * _levels(joints)
    levels = levels[np.arange(count) % len(levels)]
    chosen = strings.take([k % len(strings) for k in range(count)])
    drawn = Disturbances(levels[:, 0], levels[:, 1], levels[:, 2:4], levels[:, 4:])
    return replace(chosen, disturbances=drawn)


def crossed(strings: StringBatch, joints: int, scale: float = 1.0) -> StringBatch:
    """Return every string with every disturbance of the design, string by string; see `disturbed`."""
    rows = len(_levels(joints))
    every = strings.take(np.repeat(np.arange(len(strings)), rows))
    return disturbed(every, len(every), joints, scale)


def _levels(joints: int) -> np.ndarray:
    """Return the design's disturbances (R, 4 + J), each one standard deviation either way."""
    sizes = np.array([GRASP_ANGLE_RAD, GRASP_LENGTH_M, SWAY_RAD, SWAY_RAD_S, *[JOINT_ZERO_RAD] * joints])
    runs = 1 << int(np.ceil(np.log2(len(sizes) + 1)))
    design = hadamard(runs)[:, 1 : len(sizes) + 1]
    # A second design with all signs reversed removes quadratic effects from the mean, too.
    return np.asarray(sizes * np.concatenate([design, -design]))
