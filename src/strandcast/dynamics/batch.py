"""The inputs of a simulation, and the contiguous arrays that the kernels take."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strandcast.core.strings import FAR_OFFSET, REST_TORSION, UNKNOWNS, StringBatch
from strandcast.dynamics.candidates import AS_GIVEN, HANGING, RESPACED, SETTLED, Candidates, StartArrays
from strandcast.dynamics.elements import (
    CLAMP_TURN,
    COLUMN_OF,
    FIXED,
    GRAVITY,
    HALF_WIDTH,
    IN_PLANE,
    SPACING,
    SWAY,
    SWAY_RATE,
)
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.observe import Outputs
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.spatial.clamps import POSE
from strandcast.dynamics.spatial.strings import IN_SPACE, SPATIAL_FIXED, in_space


class HandPath(NamedTuple):
    """Path of the hand; the simulation starts at its first sample, and the hand rests at the last one.

    Attributes
    ----------
    time_s
        (T,) increasing times [s].
    pose
        (T, 3) x, y [m] and unwrapped angle [rad], or (B, T, 3) for a path of each string's own. In space,
        (T, 9) or (B, T, 9): x, y, z [m], z upwards, the direction in which the clamp holds the string, and a
        normal to it that turns with the clamp (`strandcast.dynamics.spatial.clamps` makes them). (…, 18): the
        same of a second clamp at the string's end, its direction away from that clamp.
    """

    time_s: Array
    pose: Array


class StringStart(NamedTuple):
    """How all strings of a batch start.

    Attributes
    ----------
    points_m
        (n, 2 or 3) positions of points 1…n at the first sample [m]; None: hanging at rest, clamped in the
        hand.
    velocity_m_s
        (n, 2 or 3) velocities [m/s]; None: at rest.
    respace
        Keep only the directions of `points_m`, and give the segments the lengths of a string at rest. Between
        two clamps the lengths are kept.
    settle
        In space, seek each string's own rest shape from `points_m`; velocities belong to that shape.
    """

    points_m: Array | None = None
    velocity_m_s: Array | None = None
    respace: bool = True
    settle: bool = False


HANGING_AT_REST = StringStart()


class MeasuredPoints(NamedTuple):
    """Measured points that simulated strings are compared with.

    Attributes
    ----------
    time_s
        (F,) times [s].
    points_m
        (F, n, 2 or 3) points 1…n [m], anything where their weight is 0.
    per_metre
        (F, n) weights of the distances.
    """

    time_s: Array
    points_m: Array
    per_metre: Array


class Batch(NamedTuple):
    """B candidates and their throw, as `strandcast.dynamics.integrate.integrate` takes them."""

    model: StringModel
    candidates: Candidates
    hand: HandPath
    start: StartArrays
    steps: int
    outputs: Outputs

    def observing(self, **outputs: Any) -> Batch:
        """Return this batch with other outputs."""
        return self._replace(outputs=self.outputs._replace(**outputs))

    def take(self, rows: NDArray[np.int64]) -> Batch:
        """Return the candidates `rows`, with arrays of their own for the positions."""
        hand, out = self.hand, self.outputs.out
        return self._replace(
            candidates=Candidates(*(column[rows] for column in self.candidates)),
            hand=hand if len(hand.pose) == 1 else hand._replace(pose=hand.pose[rows]),
        ).observing(out=out[rows] if len(out) else out)


def make_batch(
    model: StringModel, strings: StringBatch, hand: HandPath, out_time_s: Array, start: StringStart
) -> Batch:
    """Return checked arrays of a simulation with outputs at `out_time_s` (F,) [s] and no observer yet."""
    strings = strings.applied()
    n, count = model.points, len(strings)
    time_s, pose, out_s = (np.ascontiguousarray(a, dtype=float) for a in (*hand, out_time_s))
    pose = pose[None] if pose.ndim == 2 else pose
    masses = rows_of(strings.masses, count, n)
    at = (out_s - time_s[0]) / model.dt_s
    _check(count, time_s, pose, at)
    spatial = in_space(pose)
    if start.settle and not spatial:
        raise ValueError("strings are settled from a given shape in space only")
    if strings.sides(FAR_OFFSET).any() and pose.shape[2] <= POSE:
        raise ValueError("only a second clamp has an offset: the path is of one")
    axes = 3 if spatial else 2
    steps = max(int(np.ceil(at[-1] - 1e-9)), 1) if len(at) else 1
    turn, sway = strings.disturbances.clamp_turn_rad, strings.disturbances.sway
    if spatial and (sway.any() or turn.any()):
        raise ValueError("disturbances of a throw are for strings in the plane")
    if not spatial and (strings.in_space or strings[REST_TORSION].any()):
        raise ValueError("a string in the plane has one rest curl and the model's length")
    parameters = rows_of(strings.parameters, count, 10)
    if spatial and model.reading == "sign" and (parameters[:, [2, 3]] != parameters[:, [4, 5]]).any():
        raise ValueError("a bend in space has no sign: h and sh are the same, or the reading is another")
    columns = SPATIAL_FIXED if spatial else FIXED
    fixed = np.zeros((count, columns))
    for name, column in (COLUMN_OF | (IN_SPACE if spatial else IN_PLANE)).items():
        if name in strings.values:
            per = model.spacing_m if UNKNOWNS[name].unit == "rad/m" else 1.0
            fixed[:, column] += strings[name] * per
    fixed[:, [SPACING, GRAVITY, HALF_WIDTH]] = model.spacing_m, model.gravity_m_s2, model.switch()
    fixed[:, CLAMP_TURN] += turn
    fixed[:, [SWAY, SWAY_RATE]] = sway
    return Batch(
        model,
        Candidates(
            parameters,
            masses,
            rows_of(strings.bend_factor, count, n),
            rows_of(fixed, count, columns),
            np.zeros((count, axes)),
        ),
        HandPath(time_s, pose),
        StartArrays(
            _mode(start),
            np.zeros((n, 2) if axes == 2 else (0, 3))
            if start.points_m is None
            else rows_of(start.points_m, n, axes),
            np.zeros((n, axes)) if start.velocity_m_s is None else rows_of(start.velocity_m_s, n, axes),
        ),
        steps,
        Outputs(
            np.clip(at, 0.0, float(steps)),
            np.empty((0, n, axes)),
            np.empty((0, n)),
            np.empty((0, 0, 0, 0)),
        ),
    )


def _mode(start: StringStart) -> int:
    if start.points_m is None:
        return HANGING
    if start.settle:
        return SETTLED
    return RESPACED if start.respace else AS_GIVEN


def rows_of(values: Array, rows: int, columns: int) -> Array:
    """Return `values` as a contiguous array of that shape; the kernels check no bounds."""
    array = np.ascontiguousarray(values, dtype=float)
    if array.shape != (rows, columns):
        raise ValueError(f"expected an array of shape ({rows}, {columns}), got {array.shape}")
    return array


def _check(count: int, time_s: Array, pose: Array, at: Array) -> None:
    if pose.shape[0] not in (1, count) or pose.shape[1:] not in (
        (len(time_s), columns) for columns in (3, 9, 18)
    ):
        raise ValueError(f"{count} candidates and {len(time_s)} times do not fit hand poses {pose.shape}")
    if len(time_s) < 2 or not np.all(np.diff(time_s) > 0):
        raise ValueError("the hand's times must increase")
    if len(at) and (at[0] < -1e-6 or not np.all(np.diff(at) >= 0)):
        raise ValueError("output times must increase and not precede the hand's first sample")
