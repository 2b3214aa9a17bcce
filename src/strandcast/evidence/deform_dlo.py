"""Cables that two robots move in space: outside the planar string model, and the seam where one would go.

A `Predictor` is all that a model has to be. Here are two that know no physics: their errors are the numbers
that a model has to beat.

What the string model lacks for it:

- a third coordinate: its arrays end in the coordinate, so shapes stay as they are; the bend becomes a vector,
  the clamp a direction in space, the blocks of the banded system 3 x 3;
- a second driven end: the last two points prescribed as the hand is, their known changes on the right side;
- twist, for ends that are turned about their own axes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np

from strandcast.evidence.figure import Figure
from strandcast.string.parameters import Array

FRAME_S = 0.01
DRIVEN_VERTICES = (0, 1, -2, -1)
CABLES = ("DLO1", "DLO4")
GLITCH_M_S = 5.0


class Predictor(Protocol):
    """Where a cable's vertices are, from how it started and how its clamped ends were moved."""

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
    """Nothing moves but the clamped ends."""
    path = np.repeat(start_m[:1], len(ends_m), axis=0)
    path[:, DRIVEN_VERTICES] = ends_m
    return path


def carried(start_m: Array, ends_m: Array) -> Array:
    """Each vertex moves with the ends, by its place between them along the cable."""
    first = start_m[0]
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(first, axis=0), axis=1))]
    share = (along / along[-1])[:, None]
    left, right = (ends_m[:, k] - ends_m[0, k] for k in (0, -1))
    path = first + (1.0 - share) * left[:, None] + share * right[:, None]
    path[:, DRIVEN_VERTICES] = ends_m
    return np.asarray(path)


TRIVIAL: dict[str, Predictor] = {"shape_held": held, "carried_by_the_ends": carried}


def mean_error_m(predict: Predictor, sequences: Array) -> float:
    """Mean |coordinate| error [m] over all frames and free vertices of sequences (S, F, n, 3), open loop.

    Vertices that jump faster than `GLITCH_M_S` are marker glitches and not counted.
    """
    free = np.delete(np.arange(sequences.shape[2]), DRIVEN_VERTICES)
    errors = []
    for seen in sequences.astype(float):
        miss = np.abs(predict(seen[:2], seen[:, DRIVEN_VERTICES]) - seen)[:, free]
        jump = np.linalg.norm(np.diff(seen[:, free], axis=0, prepend=seen[:1, free]), axis=2)
        errors.append(miss[jump <= GLITCH_M_S * FRAME_S].ravel())
    return float(np.concatenate(errors).mean())


def measure(folder: Path) -> list[Figure]:
    """Figures of the predictors without physics, on the evaluation sequences of both cables."""
    figures = []
    for cable in CABLES:
        sequences = np.load(folder / f"{cable}_eval.npy")
        for name, predict in TRIVIAL.items():
            figures.append(
                Figure(
                    f"deform_dlo.coordinate.{cable}.{name}",
                    1e3 * mean_error_m(predict, sequences),
                    "mm",
                    note="a number to beat; the string model is planar and driven at one end",
                    detail={"sequences": len(sequences), "seconds": FRAME_S * sequences.shape[1]},
                )
            )
    return figures
