"""Strings in disturbed throws."""

from dataclasses import replace

import numpy as np
import scipy

from strandcast.core.disturbances import DISTURBING, TYPICAL_SIZES, Disturbances
from strandcast.core.strings import CLAMP_OFFSET, StringBatch

# Of a search for a new motion, each in another throw: the whole design of an arm with three joints.
STRINGS = 16


def disturbed(
    strings: StringBatch, count: int, joints: int, sizes: np.ndarray = TYPICAL_SIZES
) -> StringBatch:
    """Return `count` strings: the given ones in turn, each with different disturbances.

    The disturbances are the rows of a two-level design (Hadamard), each one standard deviation either way:
    if they are small, the mean square of the misses over a whole design is exactly the square of the
    undisturbed miss plus the variance.

    Parameters
    ----------
    count
        How many; a multiple of the design's size (8 for an arm of up to three joints) uses it fully.
    sizes
        (1, 5) standard deviations, in the order of `DISTURBING`.
    """
    return _with_levels(strings.take([k % len(strings) for k in range(count)]), joints, sizes)


def _with_levels(strings: StringBatch, joints: int, sizes: np.ndarray) -> StringBatch:
    """Return strings with the rows of the design in turn."""
    signs = _signs(joints)
    signs = signs[np.arange(len(strings)) % len(signs)]
    if strings.in_space:
        return _levels_in_space(strings, signs, sizes)
    repeats = [1] * (len(DISTURBING) - 1) + [joints]
    levels = np.repeat(sizes, repeats, axis=1) * signs
    drawn = Disturbances(levels[:, 0], levels[:, 1], levels[:, 2:4], levels[:, 4:])
    return replace(strings, disturbances=drawn)


def _levels_in_space(strings: StringBatch, signs: np.ndarray, sizes: np.ndarray) -> StringBatch:
    """Return strings in space, turned in the clamp to the left and up, longer, and with joints' zeros off.

    The columns of the design that are sway in the plane are the turn upwards, and none.
    """
    angle, longer, _, _, zero = sizes.T
    turns = angle[:, None] * signs[:, [0, 2]]
    none = np.zeros(len(strings))
    still = np.zeros((len(strings), 2))
    drawn = Disturbances(none, longer * signs[:, 1], still, zero[:, None] * signs[:, 4:])
    turned = strings.with_values(clamp_offset_rad=strings.sides(CLAMP_OFFSET) + turns)
    return replace(turned, disturbances=drawn)


def crossed(strings: StringBatch, joints: int, sizes: np.ndarray = TYPICAL_SIZES) -> StringBatch:
    """Return every string with every disturbance of the design, string by string; see `disturbed`."""
    member = np.repeat(np.arange(len(strings)), len(_signs(joints)))
    return _with_levels(strings.take(member), joints, sizes)


def _signs(joints: int) -> np.ndarray:
    """Return the design (R, 4 + J): 1 or -1 for each disturbance."""
    columns = len(DISTURBING) - 1 + joints
    runs = 1 << int(np.ceil(np.log2(columns + 1)))
    design = scipy.linalg.hadamard(runs)[:, 1 : columns + 1]
    # A second design with all signs reversed removes quadratic effects from the mean, too.
    return np.asarray(np.concatenate([design, -design]))
