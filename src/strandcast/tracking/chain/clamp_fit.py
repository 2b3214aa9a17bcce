"""How the clamp holds the string: its free length, and where it leaves beside the clamp's centre line.

The arm's file gives the clamp's place, but a string lies a millimetre or two off its centre, and its length
was measured with a ruler. From frame to frame the string leaves the clamp in different directions, so the
path from the clamp's centre along the string to its end varies with them: that identifies both.
"""

from typing import NamedTuple

import numpy as np

LATERAL_OFFSET_M = 0.0015  # chosen: prior standard deviation of the offset across the clamp
LENGTH_SHARE = 0.02  # chosen: prior standard deviation of the length, relative
END_M = 0.0005  # chosen: least standard deviation of one frame's path length
ALIKE = 30  # chosen: neighbouring frames have similar errors; this many count as one
SHORT_SHARE = 0.15  # chosen: of a frame's weight, if its path is shorter than expected
HUBER = 1.5  # in robust standard deviations; usual
ROUNDS = 15  # of reweighting; enough to converge
LEAST_FRAMES = 5
HIDDEN_M = 0.0004  # chosen: least standard deviation, since the path inside the clamp is not visible


class ClampFit(NamedTuple):
    """How the clamp holds the string, with standard deviations."""

    length_m: float  # from where it leaves the clamp to the tip's mass point
    length_sigma_m: float
    lateral_offset_m: float  # where it leaves, to the left of the clamp's centre in the hand's frame
    lateral_offset_sigma_m: float
    frames: int  # used


def fit_clamp(given_m: float, paths_m: np.ndarray, directions_rad: np.ndarray) -> ClampFit:
    """Fit free length and lateral offset, given the declared length.

    Parameters
    ----------
    paths_m
        (F,) from the clamp's centre straight to the string's first visible node, and along it to the tip.
    directions_rad
        (F,) direction in which the string leaves, in the hand's frame.

    Notes
    -----
    ``path = length + offset · sin(direction)``, robustly (Huber), with broad priors: where all directions are
    similar, length and offset cannot be separated, and the standard deviations say so. A string that bends
    where the clamp hides it takes a longer path than the straight one, so short paths count for less.
    """
    prior = np.array([LENGTH_SHARE * given_m, LATERAL_OFFSET_M])
    if len(paths_m) < LEAST_FRAMES:
        return ClampFit(given_m, float(prior[0]), 0.0, LATERAL_OFFSET_M, len(paths_m))
    design = np.column_stack([np.ones(len(paths_m)), np.sin(directions_rad)])
    start = np.array([given_m, 0.0])
    solution = np.array([float(np.median(paths_m)), 0.0])
    for _ in range(ROUNDS):
        off = paths_m - design @ solution
        scale = max(1.48 * float(np.median(np.abs(off))), END_M)
        weight = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(off), 1e-12)) / scale**2 / ALIKE
        weight *= np.where(off < 0, SHORT_SHARE, 1.0)
        matrix = design.T @ (weight[:, None] * design) + np.diag(prior**-2)
        solution = start + np.linalg.solve(matrix, design.T @ (weight * (paths_m - design @ start)))
    sigma = np.sqrt(np.diag(np.linalg.inv(matrix)) + HIDDEN_M**2)
    return ClampFit(float(solution[0]), float(sigma[0]), float(solution[1]), float(sigma[1]), len(paths_m))
