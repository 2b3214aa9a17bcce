"""How the clamp holds the string: its free length, and how far beside the clamp's middle it comes out.

The arm's file says where the clamp is, but a string lies a millimetre or two off its middle, and its length
was measured with a ruler. From frame to frame the string leaves the clamp in other directions, and so the way
from the clamp's middle along the string to its end varies with them: that tells both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

ASIDE_M = 0.0015  # prior standard deviation of where the string comes out, across the clamp
LENGTH_SHARE = 0.02  # prior standard deviation of the length, of itself
END_M = 0.0005  # least standard deviation of one frame's way
ALIKE = 30  # neighbouring frames err alike: so many count as one
SHORT_SHARE = 0.15  # of a frame's weight, where its way is shorter than expected
HUBER = 1.5
ROUNDS = 15
LEAST_FRAMES = 5
UNTOLD_M = 0.0004  # least standard deviation of the length: of what the clamp hides, the way is not seen


class Grasp(NamedTuple):
    """How the string is held.

    Attributes
    ----------
    length_m, length_sigma_m
        From where it comes out of the clamp to the tip's mass point, and its standard deviation.
    aside_m, aside_sigma_m
        Where it comes out, to the left of the clamp's middle in the hand's frame.
    frames
        That taught it.
    """

    length_m: float
    length_sigma_m: float
    aside_m: float
    aside_sigma_m: float
    frames: int


def learn_grasp(given_m: float, ways_m: np.ndarray, directions_rad: np.ndarray) -> Grasp:
    """Learn length and grasp.

    Parameters
    ----------
    given_m
        The length as the experiment gives it.
    ways_m
        (F,) from the clamp's middle straight to where the string is first seen and along it to its tip.
    directions_rad
        (F,) direction in which the string leaves, in the hand's frame.

    Notes
    -----
    ``way = length + aside · sin(direction)``, robustly (Huber), with broad priors: where all directions are
    alike, length and grasp cannot be told apart, and the deviations say so. A string that bends where the
    clamp hides it takes a longer way than the straight one, so ways that come out short count for less.
    """
    spreads = np.array([LENGTH_SHARE * given_m, ASIDE_M])
    if len(ways_m) < LEAST_FRAMES:
        return Grasp(given_m, float(spreads[0]), 0.0, ASIDE_M, len(ways_m))
    design = np.column_stack([np.ones(len(ways_m)), np.sin(directions_rad)])
    start = np.array([given_m, 0.0])
    solution = np.array([float(np.median(ways_m)), 0.0])
    for _ in range(ROUNDS):
        off = ways_m - design @ solution
        scale = max(1.48 * float(np.median(np.abs(off))), END_M)
        weight = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(off), 1e-12)) / scale**2 / ALIKE
        weight *= np.where(off < 0, SHORT_SHARE, 1.0)
        matrix = design.T @ (weight[:, None] * design) + np.diag(spreads**-2)
        solution = start + np.linalg.solve(matrix, design.T @ (weight * (ways_m - design @ start)))
    sigma = np.sqrt(np.diag(np.linalg.inv(matrix)) + UNTOLD_M**2)
    return Grasp(float(solution[0]), float(sigma[0]), float(solution[1]), float(sigma[1]), len(ways_m))
