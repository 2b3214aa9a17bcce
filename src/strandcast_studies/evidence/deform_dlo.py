"""Cables moved in space by two robots: outside the planar string model, with an interface for such models.

A model must implement `Predictor`. The two predictors here have no physics: their errors are the baseline.

The string model would need:

- a third coordinate: it is the last axis of the arrays, so that their form would not change; the bend would
  become a vector, the clamp a direction in space, the blocks of the banded system 3 x 3;
- a second driven end: the last two points prescribed like the hand, their changes on the right-hand side;
- twist, for ends rotated about their own axes.
"""

from pathlib import Path
from typing import Protocol

import numpy as np

from strandcast.dynamics.parameters import Array
from strandcast_studies.evidence.figure import Figure

FRAME_S = 0.01
DRIVEN_VERTICES = (0, 1, -2, -1)
CABLES = ("DLO1", "DLO4")
GLITCH_M_S = 5.0  # faster jumps of a vertex are marker errors; chosen


class Predictor(Protocol):
    """Predicts a cable's vertices from its start and the motion of its clamped ends."""

    def __call__(self, start_m: Array, ends_m: Array) -> Array:
        """Return vertices (F, n, 3) [m].

        Parameters
        ----------
        start_m
            (2, n, 3) vertices in the first two frames [m], 10 ms apart: shape and velocity.
        ends_m
            (F, 4, 3) driven vertices 0, 1, n-2, n-1 in all frames [m].
        """
        ...


def held(start_m: Array, ends_m: Array) -> Array:
    """Predict that only the clamped ends move."""
    path = np.repeat(start_m[:1], len(ends_m), axis=0)
    path[:, DRIVEN_VERTICES] = ends_m
    return path


def carried(start_m: Array, ends_m: Array) -> Array:
    """Predict that each vertex moves with the ends, interpolated by its place along the cable."""
    first = start_m[0]
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(first, axis=0), axis=1))]
    share = (along / along[-1])[:, None]
    left, right = (ends_m[:, k] - ends_m[0, k] for k in (0, -1))
    path = first + (1.0 - share) * left[:, None] + share * right[:, None]
    path[:, DRIVEN_VERTICES] = ends_m
    return np.asarray(path)


TRIVIAL: dict[str, Predictor] = {"shape_held": held, "carried_by_the_ends": carried}


def mean_error_m(predict: Predictor, sequences: Array) -> float:
    """Return the mean absolute coordinate error [m] over all frames and free vertices, open loop.

    The sequences are (S, F, n, 3). Vertices that jump faster than `GLITCH_M_S` are not counted.
    """
    free = np.delete(np.arange(sequences.shape[2]), DRIVEN_VERTICES)
    errors = []
    for measured in sequences.astype(float):
        miss = np.abs(predict(measured[:2], measured[:, DRIVEN_VERTICES]) - measured)[:, free]
        jump = np.linalg.norm(np.diff(measured[:, free], axis=0, prepend=measured[:1, free]), axis=2)
        errors.append(miss[jump <= GLITCH_M_S * FRAME_S].ravel())
    return float(np.concatenate(errors).mean())


def measure(folder: Path) -> list[Figure]:
    """Return the figures of the predictors without physics, on the evaluation sequences of both cables."""
    figures = []
    for cable in CABLES:
        sequences = np.load(folder / f"{cable}_eval.npy")
        for name, predict in TRIVIAL.items():
            figures.append(
                Figure(
                    f"deform_dlo.coordinate.{cable}.{name}",
                    1e3 * mean_error_m(predict, sequences),
                    "mm",
                    note="baseline without physics; the string model is planar and driven at one end",
                    detail={"sequences": len(sequences), "seconds": FRAME_S * sequences.shape[1]},
                )
            )
    return figures
